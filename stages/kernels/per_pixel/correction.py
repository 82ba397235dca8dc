"""Synthesis of exemplar coordinates, each pixel from its 3x3 neighbours alone, so in any order; for CPUs.

`arguments` explains places, positions and levels; `pixel` has what kernels for CUDA share. A pixel of the result is
described by the sum of what its eight neighbours contribute, vectors of 8 numbers; the sums of the exemplar's own
pixels are in `ExemplarTables.values`.

References
----------
[LefebvreHoppe2005]_ sections 3 and 4; [LefebvreHoppe2006]_ section 3.
"""

import numpy as np

from texloom.stages.kernels.core.compiled import compiled, inner
from texloom.stages.kernels.core.short_vectors import (
    copy_eight,
    fetch_early,
    squared_distance,
    sum_of_eight,
    sum_of_projections,
)
from texloom.stages.kernels.patchmatch.search import random_bits
from texloom.stages.kernels.per_pixel.pixel import (
    Neighbourhood,
    agreeing,
    child,
    from_neighbour,
    piece_at,
    piece_place,
    place_at,
    place_beside,
    predict,
    sampled_level,
    set_offsets,
    similar,
    snap,
)
from texloom.stages.kernels.per_pixel.positions import HELPER

_HALF = (0,) * 8  # of a row of `ExemplarTables.values`: control is the second
_MATRIX = (0,) * 4
_UNCHANGED = (2**31, 0, 2**31, 0)


@compiled
def describe(appearance, sides, margin, step, values, first, last):
    """Fill rows ``first`` to ``last`` of the exemplar's pixels with the sums that describe them.

    Parameters
    ----------
    appearance : (rows, pitch, 8) int16, of one level
    sides : (32, 16) int16, of this level, see `Appearance.sides`
    margin : places around the pixels, ``step`` or more
    values : (rows, pitch, d) int16, output; the first 8 of each
    """
    pitch, eights = values.shape[1], values.shape[2] // 8
    for row in range(first + margin, last + margin):
        for column in range(margin, pitch - margin):
            at = np.int64(row * pitch + column)
            up, down = at - step * pitch, at + step * pitch
            around = (up - step, up, up + step, at - step, at + step, down - step, down, down + step)
            sum_of_projections(values, at * eights, appearance, around, sides, np.int64(0))


@compiled
def contribute(appearance, sides, first_side, out, first, last):
    """Fill rows ``first`` to ``last`` of ``out`` with what appearances add to a sum in which they are one side.

    Parameters
    ----------
    appearance, out : (n, 8) int16
    sides, first_side : as for `texloom.stages.kernels.core.short_vectors.sum_of_projections`
    """
    for place in range(first, last):
        row = np.int64(place)
        sum_of_projections(out, row, appearance, (row,), sides, np.int64(first_side))


@inner(**HELPER)
def _widened(changed, y, x):
    """A rectangle (top, bottom, left, right) that holds a pixel too."""
    top, bottom, left, right = changed
    return min(top, y), max(bottom, y + 1), min(left, x), max(right, x + 1)


@compiled(**HELPER)
def _control_distance(given, pixel, stored, base, exemplar, distortion):
    """Squared distance of the control at a place from that given to a pixel."""
    if len(exemplar.run) == 8:
        return np.int64(0)
    at = place_at(stored, exemplar, distortion)
    return squared_distance(given, np.int64(pixel), exemplar.values, 2 * (base + at) + 1, _HALF)


@compiled
def start(level, exemplar, distortion, pieces, repetition, tolerance, key, area):
    """Fill pixels of the coarsest level with square pieces of the exemplar from random places.

    Where the exemplar repeats, every pixel is moved by less than a repetition, to the place of the phase that the
    result has there, so that pieces continue each other. Under control every piece is a choice of
    ``pieces.tries`` places, and each of its pixels takes the first whose control is as wanted, else the nearest.

    Parameters
    ----------
    level : `LevelState`; fills its first state
    exemplar, distortion, pieces, repetition : see `arguments`; distortion is None where there is none
    tolerance : squared distance from the wanted control that counts as none
    key : uint64, of random numbers
    area : (top, bottom, left, right), pixels of the arrays

    Returns
    -------
    top, bottom, left, right of the pixels that have changed; top is larger than bottom where none has.
    """
    now, columns, pinned, given = level.states[0], level.states.shape[2], level.pinned, level.given
    tries = 1 if len(exemplar.run) == 8 else pieces.tries
    changed = _UNCHANGED
    for y in range(area[0], area[1]):
        for x in range(area[2], area[3]):
            pixel = y * columns + x
            base = sampled_level(level.number, pixel, distortion) * exemplar.rows * exemplar.pitch
            piece, row, column = piece_at(level.row + y, level.column + x, pieces.block)
            least, best = np.int64(2**62), np.int64(0)
            if pinned.size and pinned[y, x] >= 0:
                tries_here, best = 0, np.int64(pinned[y, x])
            else:
                tries_here = tries
            for attempt in range(tries_here):
                bits = random_bits(key, piece, attempt)
                stored = piece_place(
                    bits, row, column, pixel, pixel, level.number, exemplar, distortion, pieces, repetition
                )
                distance = _control_distance(given, pixel, stored, base, exemplar, distortion)
                if distance < least:
                    least, best = distance, stored
                    if distance <= tolerance:
                        break
            if now[y, x] != best:
                now[y, x] = best
                changed = _widened(changed, y, x)
    return changed


@compiled
def refine(level, coarse, exemplar, distortion, amplitude, key, area):
    """Fill pixels of a level with those that the next coarser level has there, displaced at random.

    Parameters
    ----------
    level, coarse : `LevelState`; from the last state of ``coarse`` to the first of ``level``
    exemplar, distortion, key, area : see `start`
    amplitude : greatest displacement, 2**-16 px, of texture where that is distorted

    Returns
    -------
    as `start`.
    """
    now, columns, parents, pinned = level.states[0], level.states.shape[2], coarse.states[-1], level.pinned
    changed = _UNCHANGED
    for y in range(area[0], area[1]):
        row = level.row + y
        for x in range(area[2], area[3]):
            if pinned.size and pinned[y, x] >= 0:
                stored = np.int64(pinned[y, x])
            else:
                column = level.column + x
                parent = np.int64(parents[(row >> 1) - coarse.row, (column >> 1) - coarse.column])
                stored = child(
                    parent, row, column, y * columns + x, level.number, amplitude, key, exemplar, distortion
                )
            if now[y, x] != stored:
                now[y, x] = stored
                changed = _widened(changed, y, x)
    return changed


@inner(**HELPER)
def _read_neighbours(vertical, horizontal, diagonal, y, x, stored):
    """Fill what is stored at a pixel's neighbours, in scan order."""
    stored[0], stored[2] = diagonal[y - 1, x - 1], diagonal[y - 1, x + 1]
    stored[5], stored[7] = diagonal[y + 1, x - 1], diagonal[y + 1, x + 1]
    stored[1], stored[6] = vertical[y - 1, x], vertical[y + 1, x]
    stored[3], stored[4] = horizontal[y, x - 1], horizontal[y, x + 1]


@inner(**HELPER)
def _differs(vertical, horizontal, diagonal, y, x, stored):
    """Nonzero if the pixel's neighbours are not ``stored``."""
    difference = (vertical[y - 1, x] ^ stored[1]) | (vertical[y + 1, x] ^ stored[6])
    difference |= (diagonal[y - 1, x - 1] ^ stored[0]) | (diagonal[y - 1, x + 1] ^ stored[2])
    difference |= (diagonal[y + 1, x - 1] ^ stored[5]) | (diagonal[y + 1, x + 1] ^ stored[7])
    return difference | (horizontal[y, x - 1] ^ stored[3]) | (horizontal[y, x + 1] ^ stored[4])


@inner(**HELPER)
def _gather_candidates(own, around, base, length, exemplar, distortion, tried):
    """Put what continues candidates of the pixel's and its neighbours' places behind the first 9 of ``tried``.

    They are anywhere in the exemplar, so rows of positions are prefetched, which are not yet moved to the pixel.
    """
    for k in range(1, exemplar.candidates.shape[1]):
        for u in range(-1, 8):
            stored = own if u < 0 else around.stored[u]
            candidate = similar(stored, k, base, exemplar, distortion)
            if distortion is not None:
                to, at = place_at(candidate, exemplar, distortion), place_at(stored, exemplar, distortion)
                fetch_early(distortion.jacobian, to, _MATRIX)
                to += place_at(own if u < 0 else around.predicted[u], exemplar, distortion) - at
                fetch_early(exemplar.values, base + to, exemplar.run)
            elif u >= 0:
                candidate = from_neighbour(candidate, u, length, around, exemplar, distortion)
            tried[9 * k + u + 1] = candidate


@compiled(**HELPER)
def _describe_pixel(same, own, sampled, around, exemplar, appearance, distortion, rows, wanted):
    """Put what describes a pixel by its neighbours into the first 8 of ``wanted``; ``rows`` is scratch space."""
    base, length = sampled * exemplar.rows * exemplar.pitch, np.int64(1) << sampled
    if same and distortion is None:
        copy_eight(wanted, np.int64(0), exemplar.values, len(exemplar.run) // 8 * (base + own))
        return
    for i in range(8):
        rows[i] = base + place_beside(i, length, around, exemplar, distortion)
    sum_of_eight(wanted, 0, appearance.vectors, rows, appearance.sides, sampled * 32)


@compiled(**HELPER)
def _most_similar(same, own, base, length, around, exemplar, distortion, bonuses, wanted, tried):
    """Compare predicted places and candidates with what is wanted; the first of equals.

    The distance with the candidate's number below it is compared, so that the least is found without a branch.
    """
    halves, zero = len(exemplar.run) // 8, np.int64(0)
    least = np.int64(2**62)
    for u in range(-1, 0 if same else 8):  # if all predict the same, once
        stored = own if u < 0 else around.predicted[u]
        agree = agreeing(stored, around, distortion)
        row = halves * (base + place_at(stored, exemplar, distortion))
        distance = squared_distance(wanted, zero, exemplar.values, row, _HALF) * (256 - bonuses.coherence * agree)
        if len(exemplar.run) > 8:
            off = squared_distance(wanted, np.int64(1), exemplar.values, row + 1, _HALF)
            distance += off * (256 - bonuses.control * agree)
        tried[u + 1] = stored
        least = min(least, (distance >> 8 << 8) | (u + 1))
    for number in range(9, tried.size):
        stored = tried[number]
        if distortion is not None and number % 9 > 0:
            stored = from_neighbour(stored, number % 9 - 1, length, around, exemplar, distortion)
            tried[number] = stored
        row = base + place_at(stored, exemplar, distortion)
        distance = squared_distance(wanted, zero, exemplar.values, row, exemplar.run)
        least = min(least, (distance << 8) | number)
    return tried[least & 255]


@compiled
def correct(level, subpass, exemplar, appearance, distortion, bonuses, tolerance, area):
    """Move every second pixel of every second row to the place that suits its neighbours best.

    The coordinates that a neighbour predicts, and those that continue what looks like a neighbour, are compared by
    their ``values`` with the sum that describes the pixel. Of equals the first is taken: the pixel's own place,
    then in scan order. A pixel that all neighbours predict stays, if its control is as wanted, and so does one that
    reads the same as in the pass before.

    Parameters
    ----------
    level : `LevelState`; reads and fills the states before and after the pass
    subpass, exemplar, appearance, bonuses : see `arguments`
    distortion, tolerance : see `start`
    area : (top, bottom, left, right); the first row and column are of this subpass

    Returns
    -------
    as `start`.
    """
    states, columns, pinned, given = level.states, level.states.shape[2], level.pinned, level.given
    number, again = subpass.number, subpass.number > 0
    before, after = states[number], states[number + 1]
    vertical, horizontal = states[number + subpass.vertical], states[number + subpass.horizontal]
    diagonal = states[number + subpass.diagonal]
    last = number - 1 if again else number
    last_before, last_vertical = states[last], states[last + subpass.vertical]
    last_horizontal, last_diagonal = states[last + subpass.horizontal], states[last + subpass.diagonal]
    around = Neighbourhood(
        np.empty(8, np.int64), np.empty(8, np.int64), np.empty(8, np.float32), np.empty(8, np.float32),
        np.empty(8, np.int64),
    )  # fmt: skip
    wanted, rows = np.empty((1, len(exemplar.run)), np.int16), np.empty(8, np.int64)
    tried = np.empty(9 * exemplar.candidates.shape[1], np.int64)
    changed = _UNCHANGED
    for y in range(area[0], area[1], 2):
        for x in range(area[2], area[3], 2):
            own, pixel = np.int64(before[y, x]), y * columns + x
            best = own
            _read_neighbours(vertical, horizontal, diagonal, y, x, around.stored)
            free = pinned.size == 0 or pinned[y, x] < 0
            if again and free:
                difference = _differs(last_vertical, last_horizontal, last_diagonal, y, x, around.stored)
                free = (difference | (last_before[y, x] ^ own)) != 0
            if free:
                sampled = sampled_level(level.number, pixel, distortion)
                base, length = sampled * exemplar.rows * exemplar.pitch, np.int64(1) << sampled
                if distortion is not None:
                    set_offsets(around, pixel, length, distortion)
                same = predict(around, own, length, exemplar, distortion)
                if same:
                    distance = _control_distance(given, pixel, own, base, exemplar, distortion)
                    free = distance > tolerance
            if free:
                _gather_candidates(own, around, base, length, exemplar, distortion, tried)
                _describe_pixel(same, own, sampled, around, exemplar, appearance, distortion, rows, wanted)
                if len(exemplar.run) > 8:
                    copy_eight(wanted, np.int64(1), given, np.int64(pixel))
                best = _most_similar(same, own, base, length, around, exemplar, distortion, bonuses, wanted, tried)
                best = snap(best, base, exemplar, distortion)
            if after[y, x] != best:
                after[y, x] = best
                changed = _widened(changed, y, x)
    return changed
