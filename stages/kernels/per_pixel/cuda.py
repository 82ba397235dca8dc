"""Per-pixel synthesis for CUDA: all turns of an update in one launch, with the results of `per_pixel`, bit for bit.

What is to be done is a list of steps, each a rectangle of independent pixels of one level; the whole grid waits for
a step to end before it begins the next. The arrays of all levels stand behind each other in flat ones, and steps
say where. Rows of the tables are read as 64-bit words, four of their 16-bit numbers at a time.

The words are those of `texloom.stages.kernels.per_pixel.correction`.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numba import config, cuda
from numba.cuda import libdevice

from texloom.stages.kernels.patchmatch.search import random_bits
from texloom.stages.kernels.per_pixel.positions import (
    PIXEL,
    agree,
    moved,
    number_of,
    out_of_step,
    place_of,
    settled,
)

START, REFINE, CORRECT, PAINT, HALVE, FOLLOW = range(6)
"""kinds of steps: the coarsest level from nothing, another from the next coarser, a turn of a correction; and new
control from outside, control of the next coarser level, what the result is given of it"""

STEP = np.dtype(
    [
        (name, np.int64)
        for name in (
            "kind", "top", "bottom", "left", "right", "stride",  # the pixels, every one or every second
            "first", "rows", "columns",  # the level's arrays: number of their first pixel, and their shape
            "row", "column", "wrap",  # their origin in the endless result, and whether they have a torus' border
            "before", "vertical", "horizontal", "diagonal", "after",  # where states begin
            "coarse", "coarse_columns", "coarse_row", "coarse_column",
            "base", "step", "amplitude", "tolerance", "watched",  # watched: changes count
            "fine", "fine_rows", "fine_columns", "plane", "plane_columns",  # control read and written
        )
    ]
    + [("key", np.uint64), ("strength", np.float32)],
    align=True,
)  # fmt: skip
"""one step; control is a flat array of (rows, columns, planes)"""

_THREADS = 128
_BLOCKS = 128  # Numba warns of fewer; more only wait

# a plain product would be fused with the sum that follows
_times = np.float32.__mul__ if config.ENABLE_CUDASIM else libdevice.fmul_rn


@cuda.jit(device=True)
def _combined(a, u, b, v):
    """a u + b v of float32, each product rounded."""
    return _times(a, u) + _times(b, v)


@cuda.jit(device=True)
def _down(u):
    """Rows to neighbour number ``u``."""
    return (u + (u >> 2)) // 3 - 1


@cuda.jit(device=True)
def _across(u):
    return (u + (u >> 2)) % 3 - 1


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
def _control_distance(values, row, given, pixel, run):
    """Squared distance of the control at a row of ``values`` from that given to a pixel."""
    total = np.int64(0)
    for word in range(2, len(run) // 4):
        four = values[row, word]
        for lane in range(4):
            difference = np.int32(_number(four, lane) - given[pixel, 4 * word + lane - 8])
            total += np.int64(difference) * np.int64(difference)
    return total


@cuda.jit(device=True)
def _carried(position, u, v, jacobian, pitch, places):
    """See `texloom.stages.kernels.per_pixel.positions.carried`."""
    half, at = np.float32(0.5), place_of(position, pitch)
    down = half * _combined(jacobian[at, 0], u, jacobian[at, 1], v)
    across = half * _combined(jacobian[at, 2], u, jacobian[at, 3], v)
    at = place_of(moved(position, down, across, pitch, places // pitch), pitch)
    down = _combined(jacobian[at, 0], u, jacobian[at, 1], v)
    across = _combined(jacobian[at, 2], u, jacobian[at, 3], v)
    return moved(position, down, across, pitch, places // pitch)


@cuda.jit(device=True)
def _carried_far(position, u, v, jacobian, pitch, places):
    """The same by offsets that are float64, whose products with float32 are exact."""
    at = place_of(position, pitch)
    down, across = jacobian[at, 0] * u + jacobian[at, 1] * v, jacobian[at, 2] * u + jacobian[at, 3] * v
    at = place_of(moved(position, 0.5 * down, 0.5 * across, pitch, places // pitch), pitch)
    down, across = jacobian[at, 0] * u + jacobian[at, 1] * v, jacobian[at, 2] * u + jacobian[at, 3] * v
    return moved(position, down, across, pitch, places // pitch)


@cuda.jit(device=True)
def _start(
    step, y, x, given, inverse, sampled, jacobian, begins, values, candidates, core, endless, block, tries, run,
    wanted, phase, generators, pitch, places,
):  # fmt: skip
    """A pixel of the coarsest level."""
    row, column = step["row"] + y, step["column"] + x
    pixel = step["first"] + y * step["columns"] + x
    height, breadth = core[1] - core[0], core[3] - core[2]
    high = np.uint64(height if endless else max(1, height - (block - 1) * step["step"]))
    wide = np.uint64(breadth if endless else max(1, breadth - (block - 1) * step["step"]))
    piece = np.uint64(number_of(row // block, column // block))
    base = step["base"]
    least, found = np.int64(2**62), np.int64(0)
    for attempt in range(tries if len(run) > 8 else 1):
        bits = random_bits(step["key"], piece, attempt)
        if inverse is None:
            r = np.int64((bits >> np.uint64(32)) % high) + (row % block) * step["step"]
            c = np.int64((bits & np.uint64(0xFFFFFFFF)) % wide) + (column % block) * step["step"]
            if endless:
                r, c = r % height, c % breadth
            r, c = core[0] + min(r, height - 1), core[2] + min(c, breadth - 1)
            if phase.size > 2:
                to, at = y * step["columns"] + x, r * pitch + c
                i, j = out_of_step(wanted[to, 0], wanted[to, 1], phase[at, 0], phase[at, 1], generators)
                r, c = r + (i + PIXEL // 2) // PIXEL, c + (j + PIXEL // 2) // PIXEL
                r, c = min(max(r, 0), places // pitch - 1), min(max(c, 0), pitch - 1)
            place = np.int64(candidates[base + r * pitch + c, 0])
            at = place
        else:
            base, length = np.int64(sampled[pixel]) * places, np.int64(1) << np.int64(sampled[pixel])
            begin = np.int64(begins[np.int64((bits >> np.uint64(32)) % np.uint64(begins.size))])
            r, c = begin // pitch, begin % pitch
            e, f = np.float32(row % block - block // 2), np.float32(column % block - block // 2)
            u = _combined(inverse[pixel, 0], e, inverse[pixel, 1], f) * length
            v = _combined(inverse[pixel, 2], e, inverse[pixel, 3], f) * length
            place = _carried_far((r * PIXEL << 32) | c * PIXEL, u, v, jacobian, pitch, places)
            place = settled(place, np.int64(candidates[base + place_of(place, pitch), 0]), pitch)
            if phase.size > 2:
                to, at = y * step["columns"] + x, place_of(place, pitch)
                i, j = out_of_step(wanted[to, 0], wanted[to, 1], phase[at, 0], phase[at, 1], generators)
                place = _carried_far(place, i / PIXEL, j / PIXEL, jacobian, pitch, places)
                place = settled(place, np.int64(candidates[base + place_of(place, pitch), 0]), pitch)
            at = place_of(place, pitch)
        far = _control_distance(values, base + at, given, pixel, run)
        if far < least:
            least, found = far, place
            if far <= step["tolerance"]:
                break
    return found


@cuda.jit(device=True)
def _refine(step, y, x, states, inverse, sampled, jacobian, candidates, pitch, places):
    """A child of a pixel of the next coarser level, displaced."""
    row, column = step["row"] + y, step["column"] + x
    pixel = step["first"] + y * step["columns"] + x
    base, length = step["base"], step["step"]
    parent = ((row >> 1) - step["coarse_row"]) * step["coarse_columns"] + (column >> 1) - step["coarse_column"]
    place = np.int64(states[step["coarse"] + parent])
    bits = random_bits(step["key"], np.uint64(number_of(row, column)), 0)
    jitter_down = ((np.int64(bits >> np.uint64(32)) - 2**31) * step["amplitude"] + 2**46) >> 47
    jitter_across = ((np.int64(bits & np.uint64(0xFFFFFFFF)) - 2**31) * step["amplitude"] + 2**46) >> 47
    if inverse is None:
        down = ((row & 1) * 2 - 1) * length // 2 if length > 1 else (row & 1) - 1
        across = ((column & 1) * 2 - 1) * length // 2 if length > 1 else (column & 1) - 1
        place = np.int64(candidates[base + place + down * pitch + across, 0])
        return np.int64(candidates[base + place + jitter_down * pitch + jitter_across, 0])
    base, length = np.int64(sampled[pixel]) * places, np.int64(1) << np.int64(sampled[pixel])
    middle = np.float32(0.5) if step["step"] > 1 else np.float32(1)
    e, f = np.float32(row & 1) - middle, np.float32(column & 1) - middle
    u = _combined(inverse[pixel, 0], e, inverse[pixel, 1], f) * length
    v = _combined(inverse[pixel, 2], e, inverse[pixel, 3], f) * length
    place = _carried_far(place, u, v, jacobian, pitch, places)
    place = settled(place, np.int64(candidates[base + place_of(place, pitch), 0]), pitch)
    place = _carried(place, np.float32(jitter_down), np.float32(jitter_across), jacobian, pitch, places)
    return settled(place, np.int64(candidates[base + place_of(place, pitch), 0]), pitch)


@cuda.jit(device=True)
def _correct(
    step, y, x, states, given, inverse, sampled, jacobian, table, values, candidates, run, coherence_bonus,
    control_bonus, pitch, places,
):  # fmt: skip
    """The place that suits a pixel's neighbours best."""
    pixel = y * step["columns"] + x
    own = np.int64(states[step["before"] + pixel])
    near = cuda.local.array(8, np.int64)
    says = cuda.local.array(8, np.int64)
    wanted = cuda.local.array(16, np.int32)
    ring = cuda.local.array(8, np.int64)
    across_u = cuda.local.array(8, np.float32)
    across_v = cuda.local.array(8, np.float32)
    base, length = step["base"], step["step"]
    plus = np.float32(1)
    a = b = c = d = sign = plus
    if inverse is not None:
        at = step["first"] + pixel
        base, length = np.int64(sampled[at]) * places, np.int64(1) << np.int64(sampled[at])
        a, b, c, d = inverse[at, 0], inverse[at, 1], inverse[at, 2], inverse[at, 3]
        sign = plus if _times(a, d) > _times(b, c) else -plus
        for u in range(8):
            ring[u] = u
    same = True
    for u in range(8):
        down, across = _down(u), _across(u)
        source = step["horizontal"] if down == 0 else step["vertical"] if across == 0 else step["diagonal"]
        near[u] = np.int64(states[source + pixel + down * step["columns"] + across])
        if inverse is None:
            says[u] = near[u] - (down * pitch + across) * length
        else:
            e, f = np.float32(down), np.float32(across)  # products with -1, 0, 1 are exact
            across_u[u], across_v[u] = (a * e + b * f) * length, (c * e + d * f) * length
            to_down, to_across = sign * (d * e - b * f), sign * (a * f - c * e)
            most = max(abs(to_down), abs(to_across))
            if most > 0:
                to = (np.int64(round(to_down / most)) + 1) * 3 + np.int64(round(to_across / most)) + 1
                ring[u] = to if to < 4 else to - 1
            says[u] = _carried(near[u], -across_u[u], -across_v[u], jacobian, pitch, places)
        same = same and says[u] == own
    if same and len(run) == 8:
        return own
    at = own if inverse is None else place_of(own, pitch)
    if same and _control_distance(values, base + at, given, step["first"] + pixel, run) <= step["tolerance"]:
        return own

    for k in range(8):
        wanted[k] = 0
    if same and inverse is None:
        for word in range(2):
            four = values[base + own, word]
            for lane in range(4):
                wanted[4 * word + lane] = _number(four, lane)
    else:
        side = table.shape[0] // 8
        for i in range(8):
            at = near[i]
            if inverse is not None:
                u = ring[i]
                s = np.float32(_down(i) * length) - across_u[u]
                t = np.float32(_across(i) * length) - across_v[u]
                at = place_of(_carried(near[u], s, t, jacobian, pitch, places), pitch)
            for word in range(2):
                four = table[base + at + i * side, word]
                for lane in range(4):
                    wanted[4 * word + lane] += _number(four, lane)
    for k in range(len(run) - 8):
        wanted[8 + k] = given[step["first"] + pixel, k]

    least, best = np.int64(2**62), own
    for u in range(9):
        place = own if u == 0 else says[u - 1]
        agreeing = np.int64(0)
        for w in range(8):
            if inverse is None:
                agreeing += np.int64(says[w] == place)
            else:
                agreeing += np.int64(agree(says[w], place))
        at = place if inverse is None else place_of(place, pitch)
        far = _distance(wanted, values, base + at, 0, 2) * (256 - coherence_bonus * agreeing)
        far += _distance(wanted, values, base + at, 2, len(run) // 4) * (256 - control_bonus * agreeing)
        if far >> 8 < least:
            least, best = far >> 8, place
    for k in range(candidates.shape[1]):
        for u in range(9):
            whose = own if u == 0 else near[u - 1]
            if inverse is None:
                place = np.int64(candidates[base + whose, k])
                if u > 0:
                    place -= (_down(u - 1) * pitch + _across(u - 1)) * length
                at = place
            else:
                at = place_of(whose, pitch)
                to = np.int64(candidates[base + at, k])
                place = whose + ((to // pitch - at // pitch) * PIXEL << 32)
                place += (to % pitch - at % pitch) * PIXEL
                if u > 0:
                    place = _carried(place, -across_u[u - 1], -across_v[u - 1], jacobian, pitch, places)
                at = place_of(place, pitch)
            far = _distance(wanted, values, base + at, 0, len(run) // 4)
            if far < least:
                least, best = far, place
    at = best if inverse is None else place_of(best, pitch)
    whole = np.int64(candidates[base + at, 0])
    return whole if inverse is None else settled(best, whole, pitch)


@cuda.jit(device=True)
def _keep(step, y, x, found, states, changed):
    """Store what a pixel has become, on a torus in the border too."""
    rows, columns, after = step["rows"], step["columns"], step["after"]
    if states[after + y * columns + x] == found:
        return
    states[after + y * columns + x] = found
    if step["wrap"]:
        beyond_y = rows - 1 if y == 1 else 0 if y == rows - 2 else y
        beyond_x = columns - 1 if x == 1 else 0 if x == columns - 2 else x
        states[after + beyond_y * columns + x] = found
        states[after + y * columns + beyond_x] = found
        states[after + beyond_y * columns + beyond_x] = found
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
def _control(step, y, x, index, given, control, staged, lows, spans):
    """A pixel of control: taken over, or averaged, or given to the result."""
    count = lows.size
    kind = step["kind"]
    if kind == PAINT:
        for k in range(count):
            value = (staged[index * count + k] - lows[k]) / spans[k]
            value = min(max(value, np.float32(0)), np.float32(1))
            control[step["plane"] + (y * step["plane_columns"] + x) * count + k] = value
        return
    low, near = 2 * y, 2 * x
    if kind == FOLLOW:
        low = min(max(y + step["row"], 0), step["fine_rows"] - 1)
        near = min(max(x + step["column"], 0), step["fine_columns"] - 1)
    high, far = min(low + 1, step["fine_rows"] - 1), min(near + 1, step["fine_columns"] - 1)
    for k in range(count):
        upper = step["fine"] + low * step["fine_columns"] * count + k
        if kind == FOLLOW:
            value = control[upper + near * count] * step["strength"]
            given[step["first"] + y * step["columns"] + x, k] = np.int16(round(value))
        else:
            lower = step["fine"] + high * step["fine_columns"] * count + k
            total = control[upper + near * count] + control[upper + far * count]
            total += control[lower + near * count] + control[lower + far * count]
            control[step["plane"] + (y * step["plane_columns"] + x) * count + k] = np.float32(0.25) * total


@cuda.jit(device=True)
def _run(
    run, steps, changed, states, given, pinned, control, staged, lows, spans, table, values, candidates, core,
    endless, pitch, places, block, tries, coherence_bonus, control_bonus, wanted, phase, generators, inverse,
    sampled, jacobian, begins,
):  # fmt: skip
    grid = cuda.cg.this_grid()
    thread, threads = cuda.grid(1), cuda.gridsize(1)
    own = cuda.shared.array(4, np.int32)
    if cuda.threadIdx.x == 0:
        for side in range(4):
            own[side] = changed[side]
    cuda.syncthreads()
    for number in range(steps.size):
        step = steps[number]
        kind, stride = step["kind"], step["stride"]
        down = (step["bottom"] - step["top"] + stride - 1) // stride
        across = (step["right"] - step["left"] + stride - 1) // stride
        for index in range(thread, down * across, threads):
            y, x = step["top"] + index // across * stride, step["left"] + index % across * stride
            if kind > CORRECT:
                _control(step, y, x, index, given, control, staged, lows, spans)
                continue
            found = np.int64(-1)
            if pinned.size > 1:
                found = np.int64(pinned[step["first"] + y * step["columns"] + x])
            if found < 0:
                if kind == START:
                    found = _start(
                        step, y, x, given, inverse, sampled, jacobian, begins, values, candidates, core, endless,
                        block, tries, run, wanted, phase, generators, pitch, places,
                    )  # fmt: skip
                elif kind == REFINE:
                    found = _refine(step, y, x, states, inverse, sampled, jacobian, candidates, pitch, places)
                else:
                    found = _correct(
                        step, y, x, states, given, inverse, sampled, jacobian, table, values, candidates, run,
                        coherence_bonus, control_bonus, pitch, places,
                    )  # fmt: skip
            _keep(step, y, x, found, states, own)
        grid.sync()
    cuda.syncthreads()
    if cuda.threadIdx.x == 0:
        cuda.atomic.min(changed, 0, own[0])
        cuda.atomic.max(changed, 1, own[1])
        cuda.atomic.min(changed, 2, own[2])
        cuda.atomic.max(changed, 3, own[3])


@cuda.jit(cache=True)
def planar(
    run, steps, changed, states, given, pinned, control, staged, lows, spans, table, values, candidates, core,
    endless, pitch, places, block, tries, coherence_bonus, control_bonus, wanted, phase, generators,
):  # fmt: skip
    """Do all steps, where no texture is distorted; to be started with `launch`.

    Parameters
    ----------
    run : a tuple of d integers
    steps : (n,) of `STEP`
    changed : (4,) int32, top, bottom, left, right of the pixels that change in watched steps; widened
    states : (all states of all levels,) int32
    given : (pixels of all levels, d - 8, at least 1) int16
    pinned : (pixels of all levels,) as ``states``; (1,) where none is fixed
    control : (all levels,) float32, 0..1
    staged : (n,) float32, new control from outside, which is to be (value - ``lows``) / ``spans`` for each plane
    table : (8 n, 2) int64, words of 4 numbers: what each place contributes as a neighbour on each side, in turn
    values : (n, d / 4) int64, words of 4 numbers
    candidates, pitch, places, coherence_bonus, control_bonus : see
        `texloom.stages.kernels.per_pixel.correction.correct`
    core, endless, block, tries, generators : see `texloom.stages.kernels.per_pixel.correction.start`; two are
        tuples
    wanted, phase : (pixels of the coarsest level, 2), (places, 2) uint32, see there; (1, 2) where nothing repeats
    """
    _run(
        run, steps, changed, states, given, pinned, control, staged, lows, spans, table, values, candidates,
        core, endless, pitch, places, block, tries, coherence_bonus, control_bonus, wanted, phase, generators,
        None, None, None, None,
    )  # fmt: skip


@cuda.jit(cache=True)
def distorted(
    run, steps, changed, states, given, pinned, control, staged, lows, spans, table, values, candidates, core,
    endless, pitch, places, block, tries, coherence_bonus, control_bonus, wanted, phase, generators, inverse,
    sampled, jacobian, begins,
):  # fmt: skip
    """Do all steps; as `planar`, but ``states`` are int64 positions.

    Parameters
    ----------
    inverse, sampled : (pixels of all levels, 4) float32, (pixels of all levels,) uint8
    jacobian : (places, 4) float32
    begins : see `texloom.stages.kernels.per_pixel.correction.start`
    """
    _run(
        run, steps, changed, states, given, pinned, control, staged, lows, spans, table, values, candidates,
        core, endless, pitch, places, block, tries, coherence_bonus, control_bonus, wanted, phase, generators,
        inverse, sampled, jacobian, begins,
    )  # fmt: skip


def resident_blocks(kernel: Any, arguments: tuple[Any, ...]) -> int:
    """How many blocks of a kernel the GPU can run at once, so that they can wait for each other."""
    if config.ENABLE_CUDASIM:
        return 1
    types = tuple(kernel.typeof_pyval(argument) for argument in arguments)
    return int(kernel.compile(types).max_cooperative_grid_blocks(_THREADS))


def launch(kernel: Any, arguments: tuple[Any, ...], pixels: int, most: int) -> None:
    """Start a kernel whose largest step has so many pixels, on at most so many blocks."""
    threads = 2 if config.ENABLE_CUDASIM else _THREADS
    kernel[min(most, max(_BLOCKS, -(-pixels // threads))), threads](*arguments)
