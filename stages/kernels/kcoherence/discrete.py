"""Discrete synthesis: every pixel moves to the exemplar pixel that continues its neighbours best."""

from __future__ import annotations

import numba
import numpy as np

from texloom.stages.kernels.core.row_distance import two_row_distance
from texloom.stages.kernels.patchmatch.search import random_bits

DIMENSIONS = 16
"""of the space that neighbourhoods are compared in; held as two rows of half as many 16-bit values"""

LARGEST = 8000
"""value in that space; differences and their squared sums then fit 16 and 32 bits"""

_HALF = (np.int8(0),) * (DIMENSIONS // 2)
_FARTHEST = np.float32(LARGEST)


@numba.njit(cache=True, nogil=True)
def round_vector(vector, rows):
    """Hold a vector, (DIMENSIONS,) float32, as two rows of int16, (2, DIMENSIONS / 2)."""
    for d in range(DIMENSIONS):
        value = np.rint(min(max(vector[d], -_FARTHEST), _FARTHEST))
        rows[d // (DIMENSIONS // 2), d % (DIMENSIONS // 2)] = np.int16(value)


@numba.njit(cache=True, nogil=True)
def move_pixels(
    old, new, texture, given, vectors, basis, candidates, price, radius, parity, tries, broken, edges_only,
    wrap, key, first, last,
):  # fmt: skip
    """Choose the sources of the pixels of one parity in rows ``first`` to ``last``.

    Each of the 3x3 pixels around proposes the exemplar pixel that continues its source, and the places that look
    like that one. Taken is what costs least: the squared distance of the neighbourhoods, the price of the place,
    and ``broken`` for each of its neighbours that it does not continue.

    Parameters
    ----------
    old, new : (H, W, 2) int32, sources before and after
    texture : (h, w, c) float32, what is copied
    given : (H, W, k) float32, control of the target, which is not copied
    vectors : (h * w * 2, DIMENSIONS / 2) int16, neighbourhoods of the exemplar, two rows a pixel; see `LARGEST`
    basis : ((2 * radius + 1)**2 * (c + k), DIMENSIONS) float32, from a neighbourhood to its vector
    candidates : (h, w, s, 2) int32, places that look like a pixel
    price : (h, w) int64, of every place
    parity : 0..3, which of every 2x2 pixels
    tries : random places tried for a pixel
    broken : int64
    edges_only : bool, pixels that continue all their neighbours stay
    wrap : bool, the target is a torus; else its border repeats
    key : uint64, of the random numbers

    Returns
    -------
    int, sum of what the chosen cost; int, of it the prices of their places; int, number of pixels that chose.
    """
    height, width = old.shape[0], old.shape[1]
    rows, columns, colours = texture.shape
    controls = given.shape[2]
    sums = np.empty(DIMENSIONS, np.float32)
    wanted = np.empty((2, DIMENSIONS // 2), np.int16)
    start = np.uint64(0)
    # places that continue neighbours, and how many each
    own_rows, own_columns = np.empty(9, np.int64), np.empty(9, np.int64)
    continued = np.empty(9, np.int64)
    energy, paid, chosen = np.int64(0), np.int64(0), np.int64(0)
    for y in range(first + (first + parity // 2) % 2, last, 2):
        for x in range(parity % 2, width, 2):
            count, around = 0, -1
            for turn in range(9):
                place = (turn + 4) % 9  # the pixel itself comes first
                dy, dx = place // 3 - 1, place % 3 - 1
                ny, nx = y + dy, x + dx
                if wrap:
                    ny, nx = ny % height, nx % width
                elif ny < 0 or ny >= height or nx < 0 or nx >= width:
                    continue
                around += 1
                r, c = np.int64(old[ny, nx, 0]) - dy, np.int64(old[ny, nx, 1]) - dx
                if r < 0 or r >= rows or c < 0 or c >= columns:
                    continue
                known = False
                for i in range(count):
                    if own_rows[i] == r and own_columns[i] == c:
                        continued[i] += 1
                        known = True
                if not known:
                    own_rows[count], own_columns[count] = r, c
                    continued[count] = 0 if turn == 0 else 1
                    count += 1
            if edges_only and count == 1:
                new[y, x, 0], new[y, x, 1] = old[y, x, 0], old[y, x, 1]
                continue

            for d in range(DIMENSIONS):
                sums[d] = np.float32(0)
            at = 0
            for dy in range(-radius, radius + 1):
                ny = (y + dy) % height if wrap else min(max(y + dy, 0), height - 1)
                for dx in range(-radius, radius + 1):
                    nx = (x + dx) % width if wrap else min(max(x + dx, 0), width - 1)
                    r, c = old[ny, nx, 0], old[ny, nx, 1]
                    for k in range(colours):
                        value = texture[r, c, k]
                        for d in range(DIMENSIONS):
                            sums[d] += value * basis[at, d]
                        at += 1
                    for k in range(controls):
                        value = given[ny, nx, k]
                        for d in range(DIMENSIONS):
                            sums[d] += value * basis[at, d]
                        at += 1
            round_vector(sums, wanted)

            best = np.int64(2**62)
            best_row, best_column = np.int64(0), np.int64(0)
            for i in range(count):
                r, c = own_rows[i], own_columns[i]
                there = np.uint64((r * columns + c) * DIMENSIONS)
                total = two_row_distance(wanted, start, vectors, there, _HALF) + price[r, c]
                total += broken * (around - continued[i])
                if total < best:
                    best, best_row, best_column = total, r, c
            for attempt in range(count * candidates.shape[2] + tries):
                if attempt < count * candidates.shape[2]:
                    i, which = attempt // candidates.shape[2], attempt % candidates.shape[2]
                    r = np.int64(candidates[own_rows[i], own_columns[i], which, 0])
                    c = np.int64(candidates[own_rows[i], own_columns[i], which, 1])
                else:
                    bits = random_bits(key, y * width + x, attempt - count * candidates.shape[2])
                    r = np.int64((bits >> np.uint64(32)) % np.uint64(rows))
                    c = np.int64((bits & np.uint64(0xFFFFFFFF)) % np.uint64(columns))
                there = np.uint64((r * columns + c) * DIMENSIONS)
                total = two_row_distance(wanted, start, vectors, there, _HALF) + price[r, c] + broken * around
                if total < best:
                    best, best_row, best_column = total, r, c
            new[y, x, 0], new[y, x, 1] = best_row, best_column
            energy += best
            paid += price[best_row, best_column]
            chosen += 1
    return energy, paid, chosen
