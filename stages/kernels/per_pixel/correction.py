"""Synthesis of exemplar coordinates, each pixel from its 3x3 neighbours alone, so in any order.

Coordinates are *places*: the number of a pixel in the exemplar with a margin around it, row * pitch + column. What
is known of a place at a level stands in tables, level after level of ``places`` rows each; the margin holds what
stands at the place that continues the exemplar there, so no index is ever wrapped. Levels are numbered from the
finest, 0; the pixels of level l are 2**l apart, its *step*, in the exemplar as in the result.

Where texture is distorted, a 2x2 matrix for every pixel of the exemplar (``jacobian``, from texture to exemplar
px) and one for every pixel of the result (``inverse``, from the result's px to texture, both in steps) carry an
offset from one to the other, by the midpoint rule in the exemplar; without them it is the same in both. Offsets are
then no whole pixels, and what is stored is not a place but a *position*, row << 32 | column in 1/256 px with the
margin, which stands for the nearest place. Everything but the product with the matrices is in whole numbers.

A pixel of the result is described by the sum of what its eight neighbours contribute, vectors of 8 numbers; the
sums for the exemplar's own pixels are in ``values``.
"""

from __future__ import annotations

import numba
import numpy as np

from texloom.stages.kernels.core.short_vectors import fetch_early, squared_distance, sum_of_projections
from texloom.stages.kernels.patchmatch.search import random_bits
from texloom.stages.kernels.per_pixel.positions import (
    PIXEL,
    agree,
    carried,
    number_of,
    out_of_step,
    place_of,
    settled,
    shifted,
)

_DOWN = (-1, -1, -1, 0, 0, 1, 1, 1)  # the eight neighbours
_ACROSS = (-1, 0, 1, -1, 1, -1, 0, 1)
_HALF = (0,) * 8  # of a row of ``values``: control is the second
_MATRIX = (0,) * 4


@numba.njit(cache=True, nogil=True)
def describe(appearance, sides, margin, step, values, first, last):
    """Fill rows ``first`` to ``last`` of the exemplar's pixels with the sums that describe them.

    Parameters
    ----------
    appearance : (rows, pitch, 8) int16, of one level
    sides : (32, 16) int16, of this level, see `correct`
    margin : places around the pixels, ``step`` or more
    values : (rows, pitch, d) int16, output; the first 8 of each
    """
    pitch, eights = values.shape[1], values.shape[2] // 8
    for row in range(first + margin, last + margin):
        for column in range(margin, pitch - margin):
            at = np.int64(row * pitch + column)
            up, down = at - step * pitch, at + step * pitch
            sum_of_projections(
                values,
                at * eights,
                appearance,
                (up - step, up, up + step, at - step, at + step, down - step, down, down + step),
                sides,
                np.int64(0),
            )


@numba.njit(cache=True, nogil=True)
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


@numba.njit(cache=True, nogil=True)
def start(
    now, origin_row, origin_column, given, pinned, inverse, level, jacobian, values, candidates, base, places,
    pitch, core_top, core_bottom, core_left, core_right, endless, begins, step, block, tries, tolerance, key,
    wanted, phase, generators, top, bottom, left, right,
):  # fmt: skip
    """Fill rows ``top`` to ``bottom`` of the coarsest level with square pieces of the exemplar from random places.

    Where the exemplar repeats, every pixel is moved by less than a repetition, to the place of the phase that the
    result has there, so that pieces continue each other. Under control every piece is a choice of ``tries`` places,
    and each of its pixels takes the first whose control is as wanted, else the nearest.

    Parameters
    ----------
    now : (rows, columns), output: places (int32), or positions (int64) where texture is distorted; the same is
        returned as with `correct`
    origin_row, origin_column : of ``now`` in the endless result
    given, pinned, inverse, level, jacobian, values, candidates, base, places, pitch, step, tolerance : see
        `correct`
    core_top, core_bottom, core_left, core_right : rows and columns, with the margin, that pieces are taken from,
        where texture is not distorted
    endless : bool, whether these rows and columns go on at their other end; pieces then begin anywhere
    begins : (n,) int32, the places around which they are taken where it is
    block : side of a piece, px of the level; what does not fit into a core that ends repeats its border, or where
        texture is distorted goes on elsewhere
    wanted : (rows, columns, 2) uint32, phases of the result's pixels, in 2**-32 of a repetition along each
        generator; (0, 0, 2) where the exemplar does not repeat
    phase : (places, 2) uint32, those of the exemplar
    generators : (4,) int64, two displacements by which it repeats, row and column of each, 1/256 px of texture
    """
    controls, width = given.shape[2], np.int64(given.shape[1])
    height, breadth = core_bottom - core_top, core_right - core_left
    high = np.uint64(height if endless else max(1, height - (block - 1) * step))
    wide = np.uint64(breadth if endless else max(1, breadth - (block - 1) * step))
    own_base, rows = np.int64(base), places // pitch
    changed_top, changed_bottom, changed_left, changed_right = 2**31, 0, 2**31, 0
    for y in range(top, bottom):
        row = origin_row + y
        for x in range(left, right):
            column = origin_column + x
            piece = number_of(row // block, column // block)
            down, across = (row % block) * step, (column % block) * step
            least, found = np.int64(2**62), np.int64(0)
            for attempt in range(tries if controls else 1):
                bits = random_bits(key, piece, attempt)
                if inverse is None:
                    r = np.int64((bits >> np.uint64(32)) % high) + down
                    c = np.int64((bits & np.uint64(0xFFFFFFFF)) % wide) + across
                    if endless:
                        r, c = r % height, c % breadth
                    r, c = core_top + min(r, height - 1), core_left + min(c, breadth - 1)
                    if phase.size:
                        at = r * pitch + c
                        i, j = out_of_step(wanted[y, x, 0], wanted[y, x, 1], phase[at, 0], phase[at, 1], generators)
                        r, c = r + (i + PIXEL // 2) // PIXEL, c + (j + PIXEL // 2) // PIXEL
                        r, c = min(max(r, 0), rows - 1), min(max(c, 0), pitch - 1)
                    place = np.int64(candidates[base + r * pitch + c, 0])
                    at = place
                else:
                    own_base, own_step = np.int64(level[y, x]) * places, np.int64(1) << np.int64(level[y, x])
                    begin = np.int64(begins[np.int64((bits >> np.uint64(32)) % np.uint64(begins.size))])
                    r, c = begin // pitch, begin % pitch
                    e, f = np.float32(row % block - block // 2), np.float32(column % block - block // 2)
                    u = (inverse[y, x, 0] * e + inverse[y, x, 1] * f) * own_step
                    v = (inverse[y, x, 2] * e + inverse[y, x, 3] * f) * own_step
                    place = carried((r * PIXEL << 32) | c * PIXEL, u, v, jacobian, pitch, rows)
                    place = settled(place, np.int64(candidates[own_base + place_of(place, pitch), 0]), pitch)
                    if phase.size:
                        at = place_of(place, pitch)
                        i, j = out_of_step(wanted[y, x, 0], wanted[y, x, 1], phase[at, 0], phase[at, 1], generators)
                        place = carried(place, i / PIXEL, j / PIXEL, jacobian, pitch, rows)
                        place = settled(place, np.int64(candidates[own_base + place_of(place, pitch), 0]), pitch)
                    at = place_of(place, pitch)
                far = np.int64(0)
                if controls:
                    far = squared_distance(given, y * width + x, values, 2 * (own_base + at) + 1, _HALF)
                if far < least:
                    least, found = far, place
                    if far <= tolerance:
                        break
            if pinned.size and pinned[y, x] >= 0:
                found = np.int64(pinned[y, x])
            if now[y, x] != found:
                now[y, x] = found
                changed_top, changed_bottom = min(changed_top, y), max(changed_bottom, y + 1)
                changed_left, changed_right = min(changed_left, x), max(changed_right, x + 1)
    return changed_top, changed_bottom, changed_left, changed_right


@numba.njit(cache=True, nogil=True)
def refine(
    coarse, coarse_row, coarse_column, now, origin_row, origin_column, pinned, inverse, level, jacobian, candidates,
    base, places, pitch, step, amplitude, key, top, bottom, left, right,
):  # fmt: skip
    """Fill rows ``top`` to ``bottom`` of a level from the next coarser one: four children a pixel, then jitter.

    Parameters
    ----------
    coarse : (Rows, Columns), places (int32) or positions (int64) of the coarser level, all that ``now`` comes from
    coarse_row, coarse_column, origin_row, origin_column : of ``coarse`` and ``now`` in the endless result
    now : (rows, columns), output; the same is returned as with `correct`
    pinned, inverse, level, jacobian, candidates, base, places, pitch, step : see `correct`
    amplitude : int, greatest displacement by jitter, px / 65536; at most ``step`` px
    """
    changed_top, changed_bottom, changed_left, changed_right = 2**31, 0, 2**31, 0
    own_base, own_step = np.int64(base), np.int64(step)
    for y in range(top, bottom):
        row = origin_row + y
        parent_row = (row >> 1) - coarse_row
        for x in range(left, right):
            column = origin_column + x
            place = np.int64(coarse[parent_row, (column >> 1) - coarse_column])
            bits = random_bits(key, number_of(row, column), 0)
            # rounded, with halves up
            jitter_down = ((np.int64(bits >> np.uint64(32)) - 2**31) * amplitude + 2**46) >> 47
            jitter_across = ((np.int64(bits & np.uint64(0xFFFFFFFF)) - 2**31) * amplitude + 2**46) >> 47
            if inverse is None:
                down = ((row & 1) * 2 - 1) * step // 2 if step > 1 else (row & 1) - 1
                across = ((column & 1) * 2 - 1) * step // 2 if step > 1 else (column & 1) - 1
                place = np.int64(candidates[base + place + down * pitch + across, 0])
                place = np.int64(candidates[base + place + jitter_down * pitch + jitter_across, 0])
            else:
                own_base, own_step = np.int64(level[y, x]) * places, np.int64(1) << np.int64(level[y, x])
                middle = np.float32(0.5) if step > 1 else np.float32(1)
                e, f = np.float32(row & 1) - middle, np.float32(column & 1) - middle
                u = (inverse[y, x, 0] * e + inverse[y, x, 1] * f) * own_step
                v = (inverse[y, x, 2] * e + inverse[y, x, 3] * f) * own_step
                rows = places // pitch
                place = carried(place, u, v, jacobian, pitch, rows)
                place = settled(place, np.int64(candidates[own_base + place_of(place, pitch), 0]), pitch)
                u, v = np.float32(jitter_down), np.float32(jitter_across)
                place = carried(place, u, v, jacobian, pitch, rows)
                place = settled(place, np.int64(candidates[own_base + place_of(place, pitch), 0]), pitch)
            if pinned.size and pinned[y, x] >= 0:
                place = np.int64(pinned[y, x])
            if now[y, x] != place:
                now[y, x] = place
                changed_top, changed_bottom = min(changed_top, y), max(changed_bottom, y + 1)
                changed_left, changed_right = min(changed_left, x), max(changed_right, x + 1)
    return changed_top, changed_bottom, changed_left, changed_right


@numba.njit(cache=True, nogil=True)
def correct(
    run, before, vertical, horizontal, diagonal, after, last_before, last_vertical, last_horizontal, last_diagonal,
    again, given, pinned, inverse, level, jacobian, appearance, sides, values, candidates, base, places, pitch,
    step, coherence_bonus, control_bonus, tolerance, top, bottom, left, right,
):  # fmt: skip
    """Move every second pixel of every second row to the place that suits its neighbours best.

    Places that continue a neighbour's, and those that continue what looks like a neighbour's, are compared by
    their ``values`` with the sum that describes the pixel. Of equals the first is taken: the pixel's own place,
    then in scan order. A pixel that all neighbours continue stays, if its control is as wanted.

    Parameters
    ----------
    run : a tuple of d integers, 8 or 16; its type tells the length of ``values``
    before, after : (rows, columns), places (int32) or positions (int64) before and after this pass
    vertical, horizontal, diagonal : ``before`` or ``after``: where the neighbours above and below, to the left and
        right, and the others are read from, which is ``after`` for those whose turn was earlier in this pass
    last_before, last_vertical, last_horizontal, last_diagonal : what was read in the pass before this one
    again : bool, whether there was one; a pixel that reads what it read then stays
    given : (rows, columns, d - 8) int16, control of the result
    pinned : (rows, columns), as ``before``, of the pixels that are fixed, -1 for others; (0, 0): none is fixed
    inverse : (rows, columns, 4) float32 or None, see the module
    level : (rows, columns) uint8 or None: the level of the tables for each pixel, where there is ``inverse``
    jacobian : (places, 4) float32, where there is ``inverse``
    appearance : (levels * places, 8) int16, what each place looks like
    sides : (levels * 32, 16) int16, for each level and each of the eight sides what the appearance of a neighbour
        there is projected on, see `texloom.stages.kernels.core.short_vectors.paired`
    values : (levels * places, d) int16, the sums in the exemplar, then its control; places whose neighbourhood
        is not whole are far from all
    candidates : (levels * places, k) int32, places that look alike; the first is the *home* of a place: itself
        where its neighbourhood is whole, else one like it
    base, places : first row of the level in the tables; rows a level
    pitch : places in a row of the exemplar with its margin, which is ``step`` px or wider
    step : px between the pixels of the level
    coherence_bonus, control_bonus : int, what each neighbour that agrees takes off the factors on the squared
        distances of the neighbourhood and of control, / 256; at most 31
    tolerance : squared distance from the wanted control that is as good as none
    top, bottom, left, right : the pixels; the first row and column are of this turn

    Returns
    -------
    top, bottom, left, right of the pixels that have changed; top is larger than bottom where none has.
    """
    size, width = len(run), np.int64(given.shape[1])
    halves = np.int64(size // 8)
    wanted = np.empty((1, size), np.int16)
    zero = np.int64(0)
    near = np.empty(8, np.int64)  # places of the neighbours
    seen = np.empty(8, np.int64)  # rows of ``appearance`` that stand around the pixel
    says = np.empty(8, np.int64)  # what they say of the pixel's
    ring = np.empty(8, np.int64)  # the neighbour in each direction of the texture
    offset = np.empty(8, np.int64)
    tried = np.empty(9 * candidates.shape[1], np.int64)
    # where the neighbours stand in the texture, if it is distorted
    across_u, across_v = np.zeros(8, np.float32), np.zeros(8, np.float32)
    for u in range(8):
        ring[u] = u
        offset[u] = (_DOWN[u] * pitch + _ACROSS[u]) * step
    own_base, own_step = np.int64(base), np.int64(step)
    rows = places // pitch
    changed_top, changed_bottom, changed_left, changed_right = 2**31, 0, 2**31, 0
    for y in range(top, bottom, 2):
        for x in range(left, right, 2):
            own = np.int64(before[y, x])
            best_place = own
            near[0], near[2] = diagonal[y - 1, x - 1], diagonal[y - 1, x + 1]
            near[5], near[7] = diagonal[y + 1, x - 1], diagonal[y + 1, x + 1]
            near[1], near[6] = vertical[y - 1, x], vertical[y + 1, x]
            near[3], near[4] = horizontal[y, x - 1], horizontal[y, x + 1]
            free = pinned.size == 0 or pinned[y, x] < 0
            if again and free:
                changed = (last_before[y, x] ^ own) | (last_vertical[y - 1, x] ^ near[1])
                changed |= (last_diagonal[y - 1, x - 1] ^ near[0]) | (last_diagonal[y - 1, x + 1] ^ near[2])
                changed |= (last_diagonal[y + 1, x - 1] ^ near[5]) | (last_diagonal[y + 1, x + 1] ^ near[7])
                changed |= (last_horizontal[y, x - 1] ^ near[3]) | (last_horizontal[y, x + 1] ^ near[4])
                changed |= last_vertical[y + 1, x] ^ near[6]
                free = changed != 0
            if inverse is not None and free:
                own_base, own_step = np.int64(level[y, x]) * places, np.int64(1) << np.int64(level[y, x])
                a, b, c, d = inverse[y, x, 0], inverse[y, x, 1], inverse[y, x, 2], inverse[y, x, 3]
                for u in range(8):
                    e, f = np.float32(_DOWN[u]), np.float32(_ACROSS[u])
                    across_u[u], across_v[u] = (a * e + b * f) * own_step, (c * e + d * f) * own_step
                    # the direction, by the inverse of the inverse up to a positive factor
                    sign = np.float32(1) if a * d > b * c else np.float32(-1)
                    down, across = sign * (d * e - b * f), sign * (a * f - c * e)
                    most = max(abs(down), abs(across))
                    if most > 0:
                        to = (np.int64(np.rint(down / most)) + 1) * 3 + np.int64(np.rint(across / most)) + 1
                        ring[u] = to if to < 4 else to - 1
            same = True
            for u in range(8):
                if inverse is None:
                    says[u] = near[u] - offset[u]
                elif free:
                    says[u] = carried(near[u], -across_u[u], -across_v[u], jacobian, pitch, rows)
                same = same and says[u] == own
            stays = not free
            if free and same:
                far = zero
                if size > 8:
                    at = own if inverse is None else place_of(own, pitch)
                    far = squared_distance(given, y * width + x, values, 2 * (own_base + at) + 1, _HALF)
                stays = far <= tolerance
            if not stays:
                # what looks like the neighbours is elsewhere in the exemplar, so it is asked for early
                for k in range(1, candidates.shape[1]):
                    for u in range(-1, 8):
                        whose = own if u < 0 else near[u]
                        if inverse is None:
                            place = np.int64(candidates[own_base + whose, k])
                            if u >= 0:
                                place -= offset[u]
                        else:
                            at = place_of(whose, pitch)
                            to = np.int64(candidates[own_base + at, k])
                            place = shifted(whose, to, pitch)
                            fetch_early(jacobian, to, _MATRIX)
                            to += place_of(own if u < 0 else says[u], pitch) - at
                            fetch_early(values, own_base + to, run)
                        tried[9 * k + u + 1] = place
                if same and inverse is None:
                    for k in range(8):
                        wanted[0, k] = values[own_base + own, k]
                else:
                    for i in range(8):
                        at = near[i]
                        if inverse is not None:
                            u = ring[i]
                            at = near[u]
                            s = np.float32(_DOWN[i] * own_step) - across_u[u]
                            t = np.float32(_ACROSS[i] * own_step) - across_v[u]
                            if s != 0 or t != 0:
                                at = carried(at, s, t, jacobian, pitch, rows)
                            at = place_of(at, pitch)
                        seen[i] = own_base + at
                    sum_of_projections(
                        wanted,
                        zero,
                        appearance,
                        (seen[0], seen[1], seen[2], seen[3], seen[4], seen[5], seen[6], seen[7]),
                        sides,
                        own_base // places * 32,
                    )
                for k in range(size - 8):
                    wanted[0, 8 + k] = given[y, x, k]
                # the distance with the candidate's number below it: the least is found without a branch
                least = np.int64(2**62)
                for u in range(-1, 0 if same else 8):  # if they say the same, once
                    place = own if u < 0 else says[u]
                    agreeing = zero
                    for w in range(8):
                        if inverse is None:
                            agreeing += says[w] == place
                        else:
                            agreeing += agree(says[w], place)
                    at = place if inverse is None else place_of(place, pitch)
                    far = squared_distance(wanted, zero, values, halves * (own_base + at), _HALF)
                    far *= 256 - coherence_bonus * agreeing
                    if size > 8:
                        off = squared_distance(wanted, np.int64(1), values, halves * (own_base + at) + 1, _HALF)
                        far += off * (256 - control_bonus * agreeing)
                    tried[u + 1] = place
                    least = min(least, (far >> 8 << 8) | (u + 1))
                for which in range(9, tried.size):
                    place = tried[which]
                    if inverse is not None:
                        u = which % 9 - 1
                        if u >= 0:
                            place = carried(place, -across_u[u], -across_v[u], jacobian, pitch, rows)
                            tried[which] = place
                        place = place_of(place, pitch)
                    far = squared_distance(wanted, zero, values, own_base + place, run)
                    least = min(least, (far << 8) | which)
                best_place = tried[least & 255]
                if inverse is None:
                    best_place = np.int64(candidates[own_base + best_place, 0])
                else:
                    at = place_of(best_place, pitch)
                    best_place = settled(best_place, np.int64(candidates[own_base + at, 0]), pitch)
            if after[y, x] != best_place:
                after[y, x] = best_place
                changed_top, changed_bottom = min(changed_top, y), max(changed_bottom, y + 1)
                changed_left, changed_right = min(changed_left, x), max(changed_right, x + 1)
    return changed_top, changed_bottom, changed_left, changed_right
