"""Discrete synthesis of a texture that turns: what pixels propose to their neighbours is carried by Jacobians.

Sources lie between the exemplar's pixels, since steps between the pixels of a turned result are no whole pixels of
the exemplar; rounded, they would stretch it.
"""

from __future__ import annotations

import math

import numba
import numpy as np

from texloom.stages.kernels.compaction.oriented import sample
from texloom.stages.kernels.core.row_distance import two_row_distance
from texloom.stages.kernels.kcoherence.discrete import DIMENSIONS, round_vector
from texloom.stages.kernels.patchmatch.search import random_bits

_HALF = (np.int8(0),) * (DIMENSIONS // 2)


@numba.njit(cache=True, nogil=True)
def _continuations(old, inverse, shape, together, wrap, y, x, own, continued):
    """Find the places that continue a pixel's own source or those around it.

    Places that are near each other are one, their mean without the pixel's own.

    Parameters
    ----------
    shape : rows and columns of the exemplar.
    own : (9, 2) float32, output, places; that of the pixel itself first, if its source is in the exemplar
    continued : (9,) int64, output, of how many neighbours each is the continuation

    Returns
    -------
    int, number of places; int, number of neighbours.
    """
    height, width = old.shape[0], old.shape[1]
    count, around = 0, -1
    sums = np.zeros((9, 2), np.float32)
    for turn in range(9):
        at = (turn + 4) % 9  # the pixel itself comes first
        dy, dx = at // 3 - 1, at % 3 - 1
        ny, nx = y + dy, x + dx
        if wrap:
            ny, nx = ny % height, nx % width
        elif ny < 0 or ny >= height or nx < 0 or nx >= width:
            continue
        around += 1
        row = old[ny, nx, 0] - inverse[y, x, 0] * dy - inverse[y, x, 1] * dx
        column = old[ny, nx, 1] - inverse[y, x, 2] * dy - inverse[y, x, 3] * dx
        if row < 0 or row > shape[0] - 1 or column < 0 or column > shape[1] - 1:
            continue
        same = 0
        while same < count and (abs(own[same, 0] - row) >= together or abs(own[same, 1] - column) >= together):
            same += 1
        if same == count:
            own[count, 0], own[count, 1] = row, column
            continued[count] = 0
            count += 1
        if turn > 0:
            sums[same, 0] += row
            sums[same, 1] += column
            continued[same] += 1
    for i in range(count):
        if continued[i] > 0:
            own[i, 0] = sums[i, 0] / np.float32(continued[i])
            own[i, 1] = sums[i, 1] / np.float32(continued[i])
    return count, around


@numba.njit(cache=True, nogil=True)
def _project(old, texture, channels, given, basis, jacobian, inverse, radius, wrap, y, x, wanted):
    """Set ``wanted`` to the vector of the neighbourhood around a pixel, read along its Jacobian.

    At every position stands what the source of the nearest pixel continues to there; so reading blurs nothing that
    hangs together.
    """
    height, width = old.shape[0], old.shape[1]
    values = np.empty(channels, np.int16)
    sums = np.zeros(DIMENSIONS, np.float32)
    half = np.float32(0.5)
    at = 0
    for i in range(-radius, radius + 1):
        for j in range(-radius, radius + 1):
            row = np.float32(y) + jacobian[y, x, 0] * np.float32(i) + jacobian[y, x, 1] * np.float32(j)
            column = np.float32(x) + jacobian[y, x, 2] * np.float32(i) + jacobian[y, x, 3] * np.float32(j)
            ny, nx = math.floor(row + half), math.floor(column + half)
            down, across = row - np.float32(ny), column - np.float32(nx)
            if wrap:
                ny, nx = ny % height, nx % width
            elif ny < 0 or ny >= height or nx < 0 or nx >= width:
                ny, nx = min(max(ny, 0), height - 1), min(max(nx, 0), width - 1)
                down, across = np.float32(0), np.float32(0)
            sample(
                texture, channels,
                old[ny, nx, 0] + inverse[ny, nx, 0] * down + inverse[ny, nx, 1] * across,
                old[ny, nx, 1] + inverse[ny, nx, 2] * down + inverse[ny, nx, 3] * across,
                values, 0,
            )  # fmt: skip
            for k in range(channels + given.shape[2]):
                value = np.float32(values[k]) if k < channels else given[ny, nx, k - channels]
                for d in range(DIMENSIONS):
                    sums[d] += value * basis[at, d]
                at += 1
    round_vector(sums, wanted)


@numba.njit(cache=True, nogil=True)
def move_turned(
    old, new, texture, channels, given, vectors, basis, candidates, price, jacobian, inverse, radius, together,
    parity, tries, broken, edges_only, wrap, key, first, last,
):  # fmt: skip
    """Choose the sources of the pixels of one parity in rows ``first`` to ``last``.

    As `texloom.stages.kernels.kcoherence.discrete.move_pixels`, but that neighbourhoods of the result are read
    along its Jacobians, that a neighbour's source is continued along them, and that the exemplar's neighbourhoods
    are interpolated between pixels.

    Parameters
    ----------
    old, new : (H, W, 2) float32, sources before and after
    texture : (h, w * channels) int16, what is copied
    given : (H, W, k) float32, control of the target, which is not copied
    vectors : (h, w * DIMENSIONS) int16, neighbourhoods of the exemplar
    basis : ((2 * radius + 1)**2 * (channels + k), DIMENSIONS) float32, from a neighbourhood to its vector
    candidates : (h, w, s, 2) int32, places that look like a pixel
    price : (h, w) int64, of every place
    jacobian, inverse : (H, W, 4) float32, from the exemplar's px to the result's, and back
    together : float32, px by which places to continue may differ and still be one
    parity : 0..3, which of every 2x2 pixels
    tries : random places tried for a pixel
    broken : int64, price of every neighbour that is not continued
    edges_only : bool, pixels that continue all their neighbours only take the mean of what those propose
    wrap : bool, the target is a torus; else its border repeats
    key : uint64, of the random numbers

    Returns
    -------
    int, sum of what the chosen cost; int, of it the prices of their places; int, number of pixels that chose.
    """
    rows, columns = price.shape
    many = candidates.shape[2]
    wanted = np.empty((2, DIMENSIONS // 2), np.int16)
    there = np.empty((2, DIMENSIONS // 2), np.int16)
    own, continued = np.empty((9, 2), np.float32), np.empty(9, np.int64)
    zero, lowest, farthest = np.float32(0), np.float32(rows - 1), np.float32(columns - 1)
    energy, paid, chosen = np.int64(0), np.int64(0), np.int64(0)
    for y in range(first + (first + parity // 2) % 2, last, 2):
        for x in range(parity % 2, old.shape[1], 2):
            count, around = _continuations(old, inverse, price.shape, together, wrap, y, x, own, continued)
            if edges_only and count == 1:
                new[y, x, 0], new[y, x, 1] = own[0, 0], own[0, 1]
                continue
            _project(old, texture, channels, given, basis, jacobian, inverse, radius, wrap, y, x, wanted)
            best, best_price = np.int64(2**62), np.int64(0)
            for attempt in range(count * (1 + many) + tries):
                unlike = around
                if attempt < count:
                    row, column = own[attempt, 0], own[attempt, 1]
                    unlike -= continued[attempt]
                elif attempt < count * (1 + many):
                    i, which = (attempt - count) // many, (attempt - count) % many
                    # as far from the pixel's middle as what it stands for
                    r, c = np.int64(np.rint(own[i, 0])), np.int64(np.rint(own[i, 1]))
                    row = np.float32(candidates[r, c, which, 0] - r) + own[i, 0]
                    column = np.float32(candidates[r, c, which, 1] - c) + own[i, 1]
                    row, column = min(max(row, zero), lowest), min(max(column, zero), farthest)
                else:
                    bits = random_bits(key, y * old.shape[1] + x, attempt - count * (1 + many))
                    row = np.float32((bits >> np.uint64(32)) % np.uint64(rows))
                    column = np.float32((bits & np.uint64(0xFFFFFFFF)) % np.uint64(columns))
                here = price[np.int64(np.rint(row)), np.int64(np.rint(column))]
                sample(vectors, DIMENSIONS, row, column, there.reshape(-1), 0)
                total = two_row_distance(wanted, np.uint64(0), there, np.uint64(0), _HALF) + here + broken * unlike
                if total < best:
                    best, best_price = total, here
                    new[y, x, 0], new[y, x, 1] = row, column
            energy += best
            paid += best_price
            chosen += 1
    return energy, paid, chosen
