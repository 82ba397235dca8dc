"""Per-pixel synthesis for CUDA: all subpasses of an update in one launch, bit-identical to `correction`.

What is to be done is a list of steps, each a rectangle of independent pixels of one level; the whole grid waits for
a step to end before it begins the next. The arrays of all levels are joined into flat ones, and steps hold where
each begins. Rows of tables are read as 64-bit words, four of their 16-bit numbers at a time.

The arguments are explained in `arguments`.
"""

from typing import Any, NamedTuple

import numpy as np
from numba import config, cuda

from texloom.stages.kernels.core.compiled import Locator
from texloom.stages.kernels.core.kernel_folder import taken_folder
from texloom.stages.kernels.patchmatch.search import random_bits
from texloom.stages.kernels.per_pixel.pixel import (
    Neighbourhood,
    agreeing,
    child,
    columns_to,
    from_neighbour,
    piece_at,
    piece_place,
    place_at,
    place_beside,
    predict,
    rows_to,
    sampled_level,
    set_offsets,
    similar,
    snap,
)

START, REFINE, CORRECT, PAINT, HALVE, FOLLOW = range(6)
"""kinds of steps: the coarsest level from pieces, another from the next coarser, a subpass of a correction; new
control from outside, control of the next coarser level, and what the result is given of it"""

STEP = np.dtype(
    [
        (name, np.int64)
        for name in (
            "kind", "top", "bottom", "left", "right", "stride",  # the pixels, every one or every second
            "first", "rows", "columns",  # the level's arrays: number of their first pixel, and their shape
            "row", "column", "wrap",  # origin in the endless result; where they wrap: 1 down, 2 across, 3 both
            "before", "vertical", "horizontal", "diagonal", "after",  # where states begin
            "coarse", "coarse_columns", "coarse_row", "coarse_column",
            "level", "amplitude", "tolerance", "watched",  # watched: changes count
            "fine", "fine_rows", "fine_columns", "plane", "plane_columns",  # control read and written
        )
    ]
    + [("key", np.uint64), ("strength", np.float32)],
    align=True,
)  # fmt: skip
"""one step; control is a flat array of (rows, columns, planes)"""

_THREADS = 128
_BLOCKS = 128  # Numba warns of fewer; more only wait


class ResultPyramid(NamedTuple):
    """All levels of the result, each array flat and level after level."""

    changed: Any
    """(4,) int32, top, bottom, left, right of the pixels that change in watched steps; widened"""
    states: Any
    """int32 places, or int64 positions where texture is distorted; all states of each level"""
    given: Any
    """(pixels, d - 8, at least 1) int16"""
    pinned: Any
    """as ``states``, (pixels,); (1,) where none is fixed"""


class ControlPyramid(NamedTuple):
    """Control planes of all levels."""

    planes: Any
    """flat float32, 0..1"""
    staged: Any
    """flat float32, new control from outside, which becomes (value - ``lows``) / ``spans`` for each plane"""
    lows: Any
    spans: Any


@cuda.jit(device=True)
def _number(word, lane):
    """One of the four numbers in a word."""
    return np.int32((word << (48 - 16 * lane)) >> 48)


@cuda.jit(device=True)
def _distance(wanted, values, row, first, last):
    """Squared distance of words ``first`` to ``last`` of a row of ``values`` from those of ``wanted``."""
    total = np.int64(0)
    for word in range(first, last):
        four = values[row, word]
        for lane in range(4):
            difference = np.int32(wanted[4 * word + lane] - _number(four, lane))
            total += np.int64(difference) * np.int64(difference)
    return total


@cuda.jit(device=True)
def _control_distance(given, pixel, values, row, words):
    """Squared distance of the control at a row of ``values`` from that given to a pixel."""
    total = np.int64(0)
    for word in range(2, words):
        four = values[row, word]
        for lane in range(4):
            difference = np.int32(_number(four, lane) - given[pixel, 4 * word + lane - 8])
            total += np.int64(difference) * np.int64(difference)
    return total


@cuda.jit(device=True)
def _start(step, y, x, result, exemplar, distortion, pieces, repetition):
    """A pixel of the coarsest level; see `texloom.stages.kernels.per_pixel.correction.start`."""
    local, words = y * step["columns"] + x, len(exemplar.run) // 4
    base = sampled_level(step["level"], step["first"] + local, distortion) * exemplar.rows * exemplar.pitch
    least, best = np.int64(2**62), np.int64(0)
    piece, row, column = piece_at(step["row"] + y, step["column"] + x, pieces.block)
    for attempt in range(pieces.tries if words > 2 else 1):
        bits = np.uint64(
            random_bits(step["key"], np.uint64(piece), attempt)
        )  # integers of the simulator are signed
        stored = piece_place(
            bits, row, column, step["first"] + local, local, step["level"], exemplar, distortion, pieces, repetition
        )
        at = base + place_at(stored, exemplar, distortion)
        distance = _control_distance(result.given, step["first"] + local, exemplar.values, at, words)
        if distance < least:
            least, best = distance, stored
            if distance <= step["tolerance"]:
                break
    return best


@cuda.jit(device=True)
def _refine(step, y, x, result, exemplar, distortion):
    """A child of a pixel of the next coarser level, displaced."""
    row, column = step["row"] + y, step["column"] + x
    at = ((row >> 1) - step["coarse_row"]) * step["coarse_columns"] + (column >> 1) - step["coarse_column"]
    parent, pixel = np.int64(result.states[step["coarse"] + at]), step["first"] + y * step["columns"] + x
    return child(parent, row, column, pixel, step["level"], step["amplitude"], step["key"], exemplar, distortion)


@cuda.jit(device=True)
def _describe_pixel(same, own, sampled, around, exemplar, contributions, distortion, wanted):
    """Put what describes a pixel by its neighbours into the first 8 of ``wanted``."""
    base, length = sampled * exemplar.rows * exemplar.pitch, np.int64(1) << sampled
    for k in range(8):
        wanted[k] = 0
    if same and distortion is None:
        for word in range(2):
            four = exemplar.values[base + own, word]
            for lane in range(4):
                wanted[4 * word + lane] = _number(four, lane)
        return
    rows_a_side = contributions.shape[0] // 8
    for i in range(8):
        row = base + place_beside(i, length, around, exemplar, distortion) + i * rows_a_side
        for word in range(2):
            four = contributions[row, word]
            for lane in range(4):
                wanted[4 * word + lane] += _number(four, lane)


@cuda.jit(device=True)
def _most_similar(own, base, length, around, exemplar, distortion, bonuses, wanted):
    """Compare predicted places and candidates with what is wanted; the first of equals."""
    words = len(exemplar.run) // 4
    least, best = np.int64(2**62), own
    for u in range(9):
        stored = own if u == 0 else around.predicted[u - 1]
        agree = agreeing(stored, around, distortion)
        row = base + place_at(stored, exemplar, distortion)
        distance = _distance(wanted, exemplar.values, row, 0, 2) * (256 - bonuses.coherence * agree)
        distance += _distance(wanted, exemplar.values, row, 2, words) * (256 - bonuses.control * agree)
        if distance >> 8 < least:
            least, best = distance >> 8, stored
    for k in range(1, exemplar.candidates.shape[1]):
        for u in range(9):
            stored = similar(own if u == 0 else around.stored[u - 1], k, base, exemplar, distortion)
            if u > 0:
                stored = from_neighbour(stored, u - 1, length, around, exemplar, distortion)
            row = base + place_at(stored, exemplar, distortion)
            distance = _distance(wanted, exemplar.values, row, 0, words)
            if distance < least:
                least, best = distance, stored
    return best


@cuda.jit(device=True)
def _correct(step, y, x, result, exemplar, contributions, distortion, bonuses):
    """The place that suits a pixel's neighbours best; see `texloom.stages.kernels.per_pixel.correction.correct`."""
    local, words = y * step["columns"] + x, len(exemplar.run) // 4
    pixel = step["first"] + local
    around = Neighbourhood(
        cuda.local.array(8, np.int64), cuda.local.array(8, np.int64), cuda.local.array(8, np.float32),
        cuda.local.array(8, np.float32), cuda.local.array(8, np.int64),
    )  # fmt: skip
    wanted = cuda.local.array(16, np.int32)
    own = np.int64(result.states[step["before"] + local])
    for u in range(8):
        down, across = rows_to(u), columns_to(u)
        source = step["horizontal"] if down == 0 else step["vertical"] if across == 0 else step["diagonal"]
        around.stored[u] = np.int64(result.states[source + local + down * step["columns"] + across])
    sampled = sampled_level(step["level"], pixel, distortion)
    base, length = sampled * exemplar.rows * exemplar.pitch, np.int64(1) << sampled
    if distortion is not None:
        set_offsets(around, pixel, length, distortion)
    same = predict(around, own, length, exemplar, distortion)
    if same:
        row = base + place_at(own, exemplar, distortion)
        if _control_distance(result.given, pixel, exemplar.values, row, words) <= step["tolerance"]:
            return own
    _describe_pixel(same, own, sampled, around, exemplar, contributions, distortion, wanted)
    for k in range(len(exemplar.run) - 8):
        wanted[8 + k] = result.given[pixel, k]
    best = _most_similar(own, base, length, around, exemplar, distortion, bonuses, wanted)
    return snap(best, base, exemplar, distortion)


@cuda.jit(device=True)
def _store(step, y, x, stored, states, changed):
    """Store what a pixel has become, in borders that wrap too."""
    rows, columns, after = step["rows"], step["columns"], step["after"]
    if states[after + y * columns + x] == stored:
        return
    states[after + y * columns + x] = stored
    if step["wrap"]:
        beyond_y, beyond_x = y, x
        if step["wrap"] & 1:
            beyond_y = rows - 1 if y == 1 else 0 if y == rows - 2 else y
        if step["wrap"] & 2:
            beyond_x = columns - 1 if x == 1 else 0 if x == columns - 2 else x
        states[after + beyond_y * columns + x] = stored
        states[after + y * columns + beyond_x] = stored
        states[after + beyond_y * columns + beyond_x] = stored
    if step["watched"]:
        if y < changed[0]:
            cuda.atomic.min(changed, 0, np.int32(y))
        if y + 1 > changed[1]:
            cuda.atomic.max(changed, 1, np.int32(y + 1))
        if x < changed[2]:
            cuda.atomic.min(changed, 2, np.int32(x))
        if x + 1 > changed[3]:
            cuda.atomic.max(changed, 3, np.int32(x + 1))


@cuda.jit(device=True)
def _control(step, y, x, index, given, control):
    """A pixel of control: taken over, or averaged, or given to the result."""
    count = control.lows.size
    kind = step["kind"]
    if kind == PAINT:
        for k in range(count):
            value = (control.staged[index * count + k] - control.lows[k]) / control.spans[k]
            value = min(max(value, np.float32(0)), np.float32(1))
            control.planes[step["plane"] + (y * step["plane_columns"] + x) * count + k] = value
        return
    top, left = 2 * y, 2 * x
    if kind == FOLLOW:
        top = min(max(y + step["row"], 0), step["fine_rows"] - 1)
        left = min(max(x + step["column"], 0), step["fine_columns"] - 1)
    bottom, right = min(top + 1, step["fine_rows"] - 1), min(left + 1, step["fine_columns"] - 1)
    for k in range(count):
        upper = step["fine"] + top * step["fine_columns"] * count + k
        if kind == FOLLOW:
            value = control.planes[upper + left * count] * step["strength"]
            given[step["first"] + y * step["columns"] + x, k] = np.int16(round(value))
        else:
            lower = step["fine"] + bottom * step["fine_columns"] * count + k
            total = control.planes[upper + left * count] + control.planes[upper + right * count]
            total += control.planes[lower + left * count] + control.planes[lower + right * count]
            control.planes[step["plane"] + (y * step["plane_columns"] + x) * count + k] = np.float32(0.25) * total


@cuda.jit(device=True)
def _run(steps, result, control, exemplar, contributions, pieces, repetition, bonuses, distortion):
    grid = cuda.cg.this_grid()
    thread, threads = cuda.grid(1), cuda.gridsize(1)
    own = cuda.shared.array(4, np.int32)
    if cuda.threadIdx.x == 0:
        for side in range(4):
            own[side] = result.changed[side]
    cuda.syncthreads()
    for number in range(steps.size):
        step = steps[number]
        kind, stride = step["kind"], step["stride"]
        down = (step["bottom"] - step["top"] + stride - 1) // stride
        across = (step["right"] - step["left"] + stride - 1) // stride
        for index in range(thread, down * across, threads):
            y, x = step["top"] + index // across * stride, step["left"] + index % across * stride
            if kind > CORRECT:
                _control(step, y, x, index, result.given, control)
                continue
            stored = np.int64(-1)
            if result.pinned.size > 1:
                stored = np.int64(result.pinned[step["first"] + y * step["columns"] + x])
            if stored < 0:
                if kind == START:
                    stored = _start(step, y, x, result, exemplar, distortion, pieces, repetition)
                elif kind == REFINE:
                    stored = _refine(step, y, x, result, exemplar, distortion)
                else:
                    stored = _correct(step, y, x, result, exemplar, contributions, distortion, bonuses)
            _store(step, y, x, stored, result.states, own)
        grid.sync()
    cuda.syncthreads()
    if cuda.threadIdx.x == 0:
        cuda.atomic.min(result.changed, 0, own[0])
        cuda.atomic.max(result.changed, 1, own[1])
        cuda.atomic.min(result.changed, 2, own[2])
        cuda.atomic.max(result.changed, 3, own[3])


def _kept(kernel: Any) -> Any:
    """Keep what is compiled of a kernel where those for CPUs are kept."""
    if config.ENABLE_CUDASIM or taken_folder() is None:
        return kernel
    from numba.cuda.dispatcher import CUDACache, CUDACacheImpl

    class Parts(CUDACacheImpl):  # type: ignore[misc]
        _locator_classes = (Locator,)

    class Cache(CUDACache):  # type: ignore[misc]
        _impl_class = Parts

    kernel._cache = Cache(kernel.py_func)
    return kernel


@_kept
@cuda.jit
def planar(steps, result, control, exemplar, contributions, pieces, repetition, bonuses):
    """Do all steps, where no texture is distorted; to be started with `launch`.

    Parameters
    ----------
    steps : (n,) of `STEP`
    result : `ResultPyramid`
    control : `ControlPyramid`
    exemplar, pieces, repetition, bonuses : see `arguments`
    contributions : (8 n, 2) int64, words of 4 numbers: what each of n places contributes as a neighbour on each
        side, in turn
    """
    _run(steps, result, control, exemplar, contributions, pieces, repetition, bonuses, None)


@_kept
@cuda.jit
def distorted(steps, result, control, exemplar, contributions, pieces, repetition, bonuses, distortion):
    """Do all steps, where texture is distorted; as `planar`, and ``distortion`` is of the pixels of all levels."""
    _run(steps, result, control, exemplar, contributions, pieces, repetition, bonuses, distortion)


def resident_blocks(kernel: Any, arguments: tuple[Any, ...]) -> int:
    """How many blocks of a kernel the GPU can run at once, so that they can wait for each other."""
    if config.ENABLE_CUDASIM:
        return 1
    types = tuple(kernel.typeof_pyval(argument) for argument in arguments)
    return int(kernel.compile(types).max_cooperative_grid_blocks(_THREADS))


def launch(kernel: Any, arguments: tuple[Any, ...], pixels: int, most: int) -> None:
    """Start a kernel whose largest step has so many pixels, on at most so many blocks."""
    threads = 2 if config.ENABLE_CUDASIM else _THREADS
    if config.ENABLE_CUDASIM:  # functions shared with CPUs are compiled there too, and take NumPy's arrays
        arguments = tuple(_on_host(part) if isinstance(part, tuple) else part for part in arguments)
    kernel[min(most, max(_BLOCKS, -(-pixels // threads))), threads](*arguments)


def _on_host(argument: Any) -> Any:
    parts = (np.asarray(part) if hasattr(part, "copy_to_host") else part for part in argument)
    return type(argument)(*parts)
