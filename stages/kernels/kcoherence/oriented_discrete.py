"""Discrete synthesis of an oriented texture: offsets between neighbours are transformed by Jacobians.

Sources lie between the exemplar's pixels, since steps between the pixels of an oriented result are no whole pixels
of the exemplar; rounded, they would stretch it.
"""

import math
from typing import Any, NamedTuple

import numpy as np

from texloom.stages.kernels.compaction.oriented import sample
from texloom.stages.kernels.core.compiled import compiled, inner
from texloom.stages.kernels.core.row_distance import two_row_distance
from texloom.stages.kernels.kcoherence.discrete_pixels import DIMENSIONS, round_vector
from texloom.stages.kernels.patchmatch.search import random_bits, square_step, wrap_index

_HALF = (np.int8(0),) * (DIMENSIONS // 2)


class Orientation(NamedTuple):
    """How the texture lies at every pixel of the target."""

    jacobian: Any
    """(H, W, 4) float32, from the exemplar's px to the target's"""
    inverse: Any
    """(H, W, 4) float32, from the target's px to the exemplar's"""
    merge_distance: Any
    """float32, px of the exemplar by which continuations of neighbours may differ and still be one place"""


@inner
def _continuations(old, orientation, shape, wrap, y, x, own, counts):
    """Find the places that continue a pixel's own source and those of its eight neighbours.

    Places within the merge distance are merged to the mean of those that neighbours propose. Fills ``own`` with
    places, the own source first, if it is in the exemplar, and ``counts`` with of how many neighbours each is the
    continuation; returns the number of places and that of neighbours.
    """
    height, width = old.shape[0], old.shape[1]
    _, inverse, merge_distance = orientation
    count, around = 0, -1
    sums = np.zeros((9, 2), np.float32)
    for order in range(9):
        dy, dx = square_step(order)
        ny, nx = wrap_index(y + dy, height, wrap.down), wrap_index(x + dx, width, wrap.across)
        if ny < 0 or nx < 0:
            continue
        around += 1
        row = old[ny, nx, 0] - inverse[y, x, 0] * dy - inverse[y, x, 1] * dx
        column = old[ny, nx, 1] - inverse[y, x, 2] * dy - inverse[y, x, 3] * dx
        if row < 0 or row > shape[0] - 1 or column < 0 or column > shape[1] - 1:
            continue
        same = 0
        while same < count and max(abs(own[same, 0] - row), abs(own[same, 1] - column)) >= merge_distance:
            same += 1
        if same == count:
            own[count, 0], own[count, 1] = row, column
            counts[count] = 0
            count += 1
        if order > 0:
            sums[same, 0] += row
            sums[same, 1] += column
            counts[same] += 1
    for i in range(count):
        if counts[i] > 0:
            own[i, 0] = sums[i, 0] / np.float32(counts[i])
            own[i, 1] = sums[i, 1] / np.float32(counts[i])
    return count, around


@inner
def _project(old, exemplar, control, orientation, wrap, y, x, wanted):
    """Set ``wanted`` to the vector of a pixel's neighbourhood, read along its Jacobian.

    At every position it has what continues the source of the nearest pixel; so reading does not blur pieces that
    are continuous.
    """
    height, width = old.shape[0], old.shape[1]
    texture, basis, radius = exemplar.texture, exemplar.basis, exemplar.radius
    jacobian, inverse, _ = orientation
    channels = texture.shape[1] // exemplar.penalty.shape[1]
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
            if wrap.down:
                ny %= height
            if wrap.across:
                nx %= width
            if ny < 0 or ny >= height or nx < 0 or nx >= width:
                ny, nx = min(max(ny, 0), height - 1), min(max(nx, 0), width - 1)
                down, across = np.float32(0), np.float32(0)
            sample(
                texture, channels,
                old[ny, nx, 0] + inverse[ny, nx, 0] * down + inverse[ny, nx, 1] * across,
                old[ny, nx, 1] + inverse[ny, nx, 2] * down + inverse[ny, nx, 3] * across,
                values, 0,
            )  # fmt: skip
            for k in range(channels + control.shape[2]):
                value = np.float32(values[k]) if k < channels else control[ny, nx, k - channels]
                for d in range(DIMENSIONS):
                    sums[d] += value * basis[at, d]
                at += 1
    round_vector(sums, wanted)


@compiled
def choose_oriented_sources(old, new, control, exemplar, orientation, subpass, first, last):
    """Choose the sources of the pixels of one parity in rows ``first`` to ``last``.

    As `stages.kernels.kcoherence.discrete_pixels.choose_sources`, but neighbourhoods of the target are read along
    its Jacobians, the sources of neighbours are continued along them, the exemplar's neighbourhoods are
    interpolated between pixels, and pixels that continue all their neighbours take the mean of what those propose.

    Parameters
    ----------
    old, new : (H, W, 2) float32, sources before and after
    control : (H, W, k) float32, of the target, which is not copied
    exemplar : texloom.stages.kernels.kcoherence.discrete_pixels.ExemplarNeighbourhoods, with ``texture`` as
        (h, w * c) int16 and ``vectors`` as (h, w * DIMENSIONS) int16
    orientation : Orientation
    subpass : texloom.stages.kernels.kcoherence.discrete_pixels.ParityPass

    Returns
    -------
    int, sum of the chosen costs; int, of it the penalties of pixels; int, number of pixels that chose.
    """
    vectors, candidates, penalty = exemplar.vectors, exemplar.candidates, exemplar.penalty
    parity, tries, seam_penalty, edges_only, wrap, key = subpass
    rows, columns = penalty.shape
    similar = candidates.shape[2]
    wanted = np.empty((2, DIMENSIONS // 2), np.int16)
    there = np.empty((2, DIMENSIONS // 2), np.int16)
    own, counts = np.empty((9, 2), np.float32), np.empty(9, np.int64)
    zero, last_row, last_column = np.float32(0), np.float32(rows - 1), np.float32(columns - 1)
    energy, penalties, chosen = np.int64(0), np.int64(0), np.int64(0)
    for y in range(first + (first + parity // 2) % 2, last, 2):
        for x in range(parity % 2, old.shape[1], 2):
            count, around = _continuations(old, orientation, penalty.shape, wrap, y, x, own, counts)
            if edges_only and count == 1:
                new[y, x, 0], new[y, x, 1] = own[0, 0], own[0, 1]
                continue
            _project(old, exemplar, control, orientation, wrap, y, x, wanted)
            best, best_penalty = np.int64(2**62), np.int64(0)
            for attempt in range(count * (1 + similar) + tries):
                seams = around
                if attempt < count:
                    row, column = own[attempt, 0], own[attempt, 1]
                    seams -= counts[attempt]
                elif attempt < count * (1 + similar):
                    i, which = (attempt - count) // similar, (attempt - count) % similar
                    # as far from the centre of its pixel as the place that it is a candidate of
                    r, c = np.int64(np.rint(own[i, 0])), np.int64(np.rint(own[i, 1]))
                    row = np.float32(candidates[r, c, which, 0] - r) + own[i, 0]
                    column = np.float32(candidates[r, c, which, 1] - c) + own[i, 1]
                    row, column = min(max(row, zero), last_row), min(max(column, zero), last_column)
                else:
                    bits = random_bits(key, y * old.shape[1] + x, attempt - count * (1 + similar))
                    row = np.float32((bits >> np.uint64(32)) % np.uint64(rows))
                    column = np.float32((bits & np.uint64(0xFFFFFFFF)) % np.uint64(columns))
                own_penalty = penalty[np.int64(np.rint(row)), np.int64(np.rint(column))]
                sample(vectors, DIMENSIONS, row, column, there.reshape(-1), 0)
                cost = two_row_distance(wanted, np.uint64(0), there, np.uint64(0), _HALF) + own_penalty
                cost += seam_penalty * seams
                if cost < best:
                    best, best_penalty = cost, own_penalty
                    new[y, x, 0], new[y, x, 1] = row, column
            energy += best
            penalties += best_penalty
            chosen += 1
    return energy, penalties, chosen
