"""Discrete synthesis: every pixel is copied from the exemplar pixel that continues its neighbours best."""

from typing import Any, NamedTuple

import numpy as np

from texloom.stages.kernels.core.compiled import compiled, inner
from texloom.stages.kernels.core.row_distance import two_row_distance
from texloom.stages.kernels.patchmatch.search import random_bits, square_step, wrap_index

DIMENSIONS = 16
"""of the space that neighbourhoods are compared in; held as two rows of half as many 16-bit values"""

LARGEST = 8000
"""value in that space; differences and their squared sums then fit 16 and 32 bits"""

_HALF = (np.int8(0),) * (DIMENSIONS // 2)
_LIMIT = np.float32(LARGEST)


class ExemplarNeighbourhoods(NamedTuple):
    """An exemplar, its neighbourhoods and occurrence penalties."""

    texture: Any
    """(h, w, c) float32, what is copied"""
    vectors: Any
    """(h * w * 2, DIMENSIONS / 2) int16, neighbourhoods, two rows a pixel; see `LARGEST`"""
    basis: Any
    """((2 * radius + 1)**2 * (c + k), DIMENSIONS) float32, from a neighbourhood to its vector"""
    candidates: Any
    """(h, w, s, 2) int32, similar pixels of each pixel"""
    penalty: Any
    """(h, w) int64, of every pixel"""
    radius: int
    """of a neighbourhood, px"""


class Repeats(NamedTuple):
    """What keeps an exemplar pixel from being copied twice near a place."""

    places: Any
    """(h, w) int32, numbers of the exemplar's pixels; copies of one in a toroidal exemplar share a number"""
    used: Any
    """(H + 2 * reach, W + 2 * reach) int32, numbers of the target's sources, and what follows its borders"""
    reach: int
    """px, to every side, within which a source should occur once"""
    penalty: Any
    """int64, for each other pixel there of the same source"""


class ParityPass(NamedTuple):
    """How the pixels of one parity choose their sources."""

    parity: int
    """0..3, which of every 2x2 pixels"""
    tries: int
    """random pixels tried"""
    seam_penalty: Any
    """int64, for each neighbour that a source does not continue"""
    edges_only: bool
    """pixels that continue all their neighbours stay"""
    wrap: Any
    """texloom.stages.vocabulary.facts.Wraps, of the target; elsewhere its border repeats"""
    key: Any
    """uint64, of the random numbers"""


@inner
def round_vector(vector, rows):
    """Round a vector, (DIMENSIONS,) float32, to two rows of int16, (2, DIMENSIONS / 2)."""
    for d in range(DIMENSIONS):
        value = np.rint(min(max(vector[d], -_LIMIT), _LIMIT))
        rows[d // (DIMENSIONS // 2), d % (DIMENSIONS // 2)] = np.int16(value)


@inner(forceinline=True)
def _continuations(old, shape, wrap, y, x, rows, columns, counts):
    """Find the exemplar pixels that continue a pixel's own source and those of its eight neighbours.

    Fills ``rows`` and ``columns`` of different pixels, the own source first, if it is in the exemplar, and of how
    many neighbours each is the continuation; returns the number of pixels and that of neighbours.
    """
    height, width = old.shape[0], old.shape[1]
    count, around = 0, -1
    for order in range(9):
        dy, dx = square_step(order)
        ny, nx = wrap_index(y + dy, height, wrap.down), wrap_index(x + dx, width, wrap.across)
        if ny < 0 or nx < 0:
            continue
        around += 1
        r, c = np.int64(old[ny, nx, 0]) - dy, np.int64(old[ny, nx, 1]) - dx
        if r < 0 or r >= shape[0] or c < 0 or c >= shape[1]:
            continue
        known = False
        for i in range(count):
            if rows[i] == r and columns[i] == c:
                counts[i] += 1
                known = True
        if not known:
            rows[count], columns[count] = r, c
            counts[count] = 0 if order == 0 else 1
            count += 1
    return count, around


@inner(forceinline=True)
def _project(old, exemplar, control, wrap, y, x, sums, wanted):
    """Set ``wanted`` to the vector of a pixel's neighbourhood; ``sums`` is (DIMENSIONS,) float32 work space."""
    height, width = old.shape[0], old.shape[1]
    texture, basis, radius = exemplar.texture, exemplar.basis, exemplar.radius
    sums[:] = np.float32(0)
    at = 0
    for dy in range(-radius, radius + 1):
        ny = (y + dy) % height if wrap.down else min(max(y + dy, 0), height - 1)
        for dx in range(-radius, radius + 1):
            nx = (x + dx) % width if wrap.across else min(max(x + dx, 0), width - 1)
            r, c = old[ny, nx, 0], old[ny, nx, 1]
            for k in range(texture.shape[2]):
                value = texture[r, c, k]
                for d in range(DIMENSIONS):
                    sums[d] += value * basis[at, d]
                at += 1
            for k in range(control.shape[2]):
                value = control[ny, nx, k]
                for d in range(DIMENSIONS):
                    sums[d] += value * basis[at, d]
                at += 1
    round_vector(sums, wanted)


@inner
def _repeat_cost(repeats, y, x, place):
    """What it costs pixel (y, x) to have the source of number ``place`` beside the pixels around that have it."""
    used, reach = repeats.used, repeats.reach
    count = np.int64(0)
    for row in range(y, y + 2 * reach + 1):
        line = used[row, x : x + 2 * reach + 1]
        equal = np.int32(0)
        for i in range(line.size):
            equal += np.int32(line[i] == place)
        count += equal
    count -= np.int64(used[y + reach, x + reach] == place)
    return repeats.penalty * count


@compiled
def choose_sources(old, new, control, exemplar, repeats, subpass, first, last):
    """Choose the sources of the pixels of one parity in rows ``first`` to ``last``.

    Each of the 3x3 pixels around proposes the exemplar pixel that continues its source, and the candidates of that
    one. The proposal of least cost is taken: the squared distance of the neighbourhoods, the penalty of the pixel,
    the seam penalty for each neighbour that it does not continue, and that of repeats near it.

    Parameters
    ----------
    old, new : (H, W, 2) int32, sources before and after
    control : (H, W, k) float32, of the target, which is not copied
    exemplar : ExemplarNeighbourhoods
    repeats : Repeats
    subpass : ParityPass

    Returns
    -------
    int, sum of the chosen costs; int, of it the penalties of pixels; int, number of pixels that chose.
    """
    vectors, candidates, penalty = exemplar.vectors, exemplar.candidates, exemplar.penalty
    parity, tries, seam_penalty, edges_only, wrap, key = subpass
    width = old.shape[1]
    rows, columns = penalty.shape
    similar = candidates.shape[2]
    sums = np.empty(DIMENSIONS, np.float32)
    wanted = np.empty((2, DIMENSIONS // 2), np.int16)
    start = np.uint64(0)
    own_rows, own_columns, counts = np.empty(9, np.int64), np.empty(9, np.int64), np.empty(9, np.int64)
    energy, penalties, chosen = np.int64(0), np.int64(0), np.int64(0)
    for y in range(first + (first + parity // 2) % 2, last, 2):
        for x in range(parity % 2, width, 2):
            count, around = _continuations(old, penalty.shape, wrap, y, x, own_rows, own_columns, counts)
            if edges_only and count == 1:
                new[y, x, 0], new[y, x, 1] = old[y, x, 0], old[y, x, 1]
                continue
            _project(old, exemplar, control, wrap, y, x, sums, wanted)
            best = np.int64(2**62)
            best_row, best_column = np.int64(0), np.int64(0)
            for i in range(count):
                r, c = own_rows[i], own_columns[i]
                there = np.uint64((r * columns + c) * DIMENSIONS)
                cost = two_row_distance(wanted, start, vectors, there, _HALF) + penalty[r, c]
                cost += seam_penalty * (around - counts[i])
                if cost < best:
                    cost += _repeat_cost(repeats, y, x, repeats.places[r, c])
                if cost < best:
                    best, best_row, best_column = cost, r, c
            for attempt in range(count * similar + tries):
                if attempt < count * similar:
                    # unsigned, since the division of signed integers takes longer
                    own, which = np.uint64(attempt) // np.uint64(similar), np.uint64(attempt) % np.uint64(similar)
                    r = np.int64(candidates[own_rows[own], own_columns[own], which, 0])
                    c = np.int64(candidates[own_rows[own], own_columns[own], which, 1])
                else:
                    bits = random_bits(key, y * width + x, attempt - count * similar)
                    r = np.int64((bits >> np.uint64(32)) % np.uint64(rows))
                    c = np.int64((bits & np.uint64(0xFFFFFFFF)) % np.uint64(columns))
                there = np.uint64((r * columns + c) * DIMENSIONS)
                cost = two_row_distance(wanted, start, vectors, there, _HALF) + penalty[r, c]
                cost += seam_penalty * around
                if cost < best:
                    cost += _repeat_cost(repeats, y, x, repeats.places[r, c])
                if cost < best:
                    best, best_row, best_column = cost, r, c
            new[y, x, 0], new[y, x, 1] = best_row, best_column
            energy += best
            penalties += penalty[best_row, best_column]
            chosen += 1
    return energy, penalties, chosen
