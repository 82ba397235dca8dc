"""PatchMatch and voting in which an exemplar patch is fitted to a target patch by a gain and a bias per channel.

Features are planes of int16 fixed point: three colour channels, two gradients of the first one, and maps. Colours
have a gain and a bias, the gradients the gain of the first channel, maps neither. Sums of products are exact
integers, so results do not depend on the order of summation.
"""

import math
from typing import Any, NamedTuple

import numpy as np

from texloom.stages.kernels.core.compiled import compiled, inner
from texloom.stages.kernels.patchmatch.search import cross_step, random_bits, wrap_index

_COLORS = 3
_GRADIENTS = 2
_FLAT = 1e-6  # standard deviation of a patch below which it has no gain


class Side(NamedTuple):
    """Features of a target or an exemplar, and of each of its (p, q) patches what does not depend on its match."""

    features: Any
    """(k, H, W) int16"""
    mean: Any
    """(3, p, q) float64, of each colour channel"""
    deviation: Any
    """(3, p, q) float64, standard deviation of each colour channel"""
    gradients: Any
    """(p, q) float64, root of the gradients' sum of squares"""
    maps: Any
    """(p, q) float64, root of the maps' sum of squares"""


class Limits(NamedTuple):
    """Bounds of gain and bias."""

    min_gain: Any
    """(3,) float64"""
    max_gain: Any
    """(3,) float64"""
    bias: Any
    """(3,) float64, largest change of a patch's mean, fixed point"""


class GainBiasScan(NamedTuple):
    """What differs between the scans of a search."""

    forward: bool
    """direction"""
    wrap: Any
    """texloom.stages.vocabulary.facts.Wraps, of the target"""
    radius: int
    """half the side of the square for random search, px"""
    tries: int
    """random tries around the match"""
    key: Any
    """uint64, of the random numbers"""


@inner(inline="always")
def _gain_and_bias(target, exemplar, limits, channel, y, x, r, c):
    """Gain and bias by which an exemplar patch gets mean and deviation of a target patch, within limits."""
    deviation = exemplar.deviation[channel, r, c]
    gain = target.deviation[channel, y, x] / deviation if deviation > _FLAT else 1.0
    gain = min(max(gain, limits.min_gain[channel]), limits.max_gain[channel])
    mean = exemplar.mean[channel, r, c]
    shift = target.mean[channel, y, x] - mean
    shift = min(max(shift, -limits.bias[channel]), limits.bias[channel])
    # The gain is about the mean; about 0 it would move the tone of bright patches beyond the limit.
    return gain, shift + (1 - gain) * mean


@inner(forceinline=True)
def _product(run, one, y, x, other, r, c):
    """Sum of the products of two patches of planes, int64."""
    size = len(run)
    total = np.int64(0)
    for i in range(size):
        first, second = one[y + i, x : x + size], other[r + i, c : c + size]
        line = np.int32(0)  # at most 32 products of values of 13 bits
        for j in range(len(run)):
            line += np.int32(first[j]) * np.int32(second[j])
        total += line
    return total


@compiled
def fitted_distance(run, target, exemplar, limits, y, x, r, c, limit):
    """Squared difference of a target patch and a fitted exemplar patch; anything at or above ``limit`` once there.

    Parameters
    ----------
    run : as many values as the side of a patch; the compiler knows their number
    target, exemplar : Side
    limits : Limits
    y, x, r, c : top-left pixels of the target's and of the exemplar's patch
    """
    pixels = len(run) * len(run)
    # First what no arrangement of the pixels changes, then what they lack in correlation, which is not negative.
    total, gain_of_first = 0.0, 1.0
    for channel in range(_COLORS):
        gain, bias = _gain_and_bias(target, exemplar, limits, channel, y, x, r, c)
        if channel == 0:
            gain_of_first = gain
        away = target.mean[channel, y, x] - gain * exemplar.mean[channel, r, c] - bias
        spread = target.deviation[channel, y, x] - gain * exemplar.deviation[channel, r, c]
        total += pixels * (away * away + spread * spread)
    slope = target.gradients[y, x] - gain_of_first * exemplar.gradients[r, c]
    rest = target.maps[y, x] - exemplar.maps[r, c]
    total += slope * slope + rest * rest
    if total >= limit:
        return total
    for channel in range(target.features.shape[0]):
        product = float(_product(run, target.features[channel], y, x, exemplar.features[channel], r, c))
        if channel < _COLORS:
            gain, _ = _gain_and_bias(target, exemplar, limits, channel, y, x, r, c)
            product -= pixels * target.mean[channel, y, x] * exemplar.mean[channel, r, c]
            full = pixels * target.deviation[channel, y, x] * exemplar.deviation[channel, r, c]
            total += 2 * gain * (full - product)
        else:
            is_gradient = channel < _COLORS + _GRADIENTS
            if channel == _COLORS:
                total += 2 * gain_of_first * target.gradients[y, x] * exemplar.gradients[r, c]
            elif channel == _COLORS + _GRADIENTS:
                total += 2 * target.maps[y, x] * exemplar.maps[r, c]
            total -= 2 * (gain_of_first if is_gradient else 1.0) * product
    return max(total, 0.0)


@compiled
def fitted_distances(run, target, exemplar, limits, row, column, distance, first, last):
    """Fill rows ``first`` to ``last`` of ``distance``, float64, with the distances of target patches to matches."""
    for y in range(first, last):
        for x in range(row.shape[1]):
            distance[y, x] = fitted_distance(
                run, target, exemplar, limits, y, x, np.int64(row[y, x]), np.int64(column[y, x]), math.inf
            )


@inner(forceinline=True)
def _neighbour_match(row, column, y, x, dy, dx, wrap):
    """The exemplar patch that continues the match of the target patch (dy, dx) beside; -1, -1 if there is none."""
    ny, nx = wrap_index(y + dy, row.shape[0], wrap.down), wrap_index(x + dx, row.shape[1], wrap.across)
    if ny < 0 or nx < 0:
        return np.int64(-1), np.int64(-1)
    return np.int64(row[ny, nx]) - dy, np.int64(column[ny, nx]) - dx


@compiled
def fitted_sweep(run, target, exemplar, limits, row, column, distance, allowed, scan, first, last):
    """One scan of PatchMatch over the target patches of rows ``first`` to ``last``.

    Propagation from the two neighbours behind, then random search around the match. A patch whose four neighbours
    all continue its match is left alone.

    Parameters
    ----------
    run, target, exemplar, limits : see `fitted_distance`
    row, column : (p, q) int32, the matches, changed in place
    distance : (p, q) float64, of the matches, changed in place
    allowed : exemplar patches that may be matches, bool
    scan : GainBiasScan

    Returns
    -------
    int, number of matches that changed.
    """
    across, wrap = row.shape[1], scan.wrap
    rows, columns = allowed.shape
    step = 1 if scan.forward else -1
    changed = 0
    for i in range(last - first):
        y = first + i if scan.forward else last - 1 - i
        for j in range(across):
            x = j if scan.forward else across - 1 - j
            best_row, best_column, best = np.int64(row[y, x]), np.int64(column[y, x]), distance[y, x]
            coherent = True
            for side in range(4):
                dy, dx = cross_step(side)
                r, c = _neighbour_match(row, column, y, x, dy, dx, wrap)
                # A match can continue beyond the exemplar, where nothing can be tried.
                if (r != best_row or c != best_column) and 0 <= r < rows and 0 <= c < columns:
                    coherent = False
            if coherent:
                continue
            for attempt in range(-2, scan.tries):
                if attempt == -2:
                    r, c = _neighbour_match(row, column, y, x, -step, 0, wrap)
                elif attempt == -1:
                    r, c = _neighbour_match(row, column, y, x, 0, -step, wrap)
                else:
                    bits = random_bits(scan.key, y * across + x, attempt)
                    low_row, low_column = max(0, best_row - scan.radius), max(0, best_column - scan.radius)
                    high_row = min(rows - 1, best_row + scan.radius)
                    high_column = min(columns - 1, best_column + scan.radius)
                    r = low_row + np.int64((bits >> np.uint64(32)) % np.uint64(high_row - low_row + 1))
                    c = low_column + np.int64(
                        (bits & np.uint64(0xFFFFFFFF)) % np.uint64(high_column - low_column + 1)
                    )
                if r < 0 or r >= rows or c < 0 or c >= columns or not allowed[r, c]:
                    continue
                if r == best_row and c == best_column:
                    continue
                away = fitted_distance(run, target, exemplar, limits, y, x, r, c, best)
                if away < best:
                    best, best_row, best_column = away, r, c
            if best_row != row[y, x] or best_column != column[y, x]:
                row[y, x], column[y, x], distance[y, x] = best_row, best_column, best
                changed += 1
    return changed


@compiled
def fit_matches(target, exemplar, limits, row, column, gain, bias, first, last):
    """Fill rows ``first`` to ``last`` of ``gain`` and ``bias``, (3, p, q) float32, with those of the matches."""
    for y in range(first, last):
        for x in range(row.shape[1]):
            for channel in range(_COLORS):
                own, added = _gain_and_bias(
                    target, exemplar, limits, channel, y, x, np.int64(row[y, x]), np.int64(column[y, x])
                )
                gain[channel, y, x], bias[channel, y, x] = own, added


@compiled
def fitted_votes(row, column, plane, gain, bias, window, wrap, sums, first, last):
    """Fill rows ``first`` to ``last`` of ``sums`` with the weighted sum of all votes for each pixel of a plane.

    Parameters
    ----------
    row, column : (p, q) int32, the matches
    plane : (h, w) float32, of the exemplar
    gain, bias : (p, q) float32, of each match
    window : (patch_size,) float32, weights along one side of a patch
    wrap : texloom.stages.vocabulary.facts.Wraps, of the target
    sums : (H, q + patch_size - 1) float32; the right margin is work space where it wraps
    """
    size, (down, across) = window.size, row.shape
    weights = window.copy()
    for y in range(first, last):
        line = sums[y]
        line[:] = 0
        for i in range(size):
            q = wrap_index(y - i, down, wrap.down)
            if q < 0:
                continue
            for j in range(size):
                weights[j] = window[i] * window[j]
            for x in range(across):
                c = column[q, x]
                source, into = plane[row[q, x] + i, c : c + size], line[x : x + size]
                own, added = gain[q, x], bias[q, x]
                for j in range(size):
                    into[j] += weights[j] * (own * source[j] + added)
        if wrap.across:
            for j in range(size - 1):
                line[j] += line[across + j]
