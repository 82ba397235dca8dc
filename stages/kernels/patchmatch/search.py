"""PatchMatch over an integer correspondence, with a price on every exemplar patch.

Features are int16 fixed point, pixels in rows of ``width * channels`` values, so distances are exact integers and
results do not depend on the processor. A correspondence is two int32 arrays ``row`` and ``column`` of shape
(patches down, patches across): the exemplar patch (by its top-left pixel) that a target patch is matched with.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cache, partial
from typing import Any, NamedTuple

import numba
import numpy as np

from texloom.stages.kernels.core.row_distance import two_row_distance

_DRAWS = 5  # positions drawn for one try until one passes the rule against overused patches


@numba.njit(cache=True, nogil=True, inline="always")
def random_bits(key, position, counter):
    """64 random bits that depend on nothing but the arguments (the finaliser of SplitMix64)."""
    bits = key + np.uint64(position) * np.uint64(0x9E3779B97F4A7C15)
    bits += np.uint64(counter) * np.uint64(0xD1B54A32D192ED03)
    bits = (bits ^ (bits >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
    bits = (bits ^ (bits >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
    return bits ^ (bits >> np.uint64(31))


@numba.njit(cache=True, nogil=True)
def occurrence_price(row, column, patch_size, price_per_use, counts, price):
    """Fill ``price`` with the occurrence map's mean over each exemplar patch, times ``price_per_use``.

    The occurrence map counts for each exemplar pixel the target patches that cover it [Kaspar2015]_ (3); its mean
    over a patch is (6). Both are box sums, so the mean over all patches costs a few passes over the exemplar.

    Parameters
    ----------
    row, column : (p, q) int32, the correspondence.
    price_per_use : float64, price of one use of every pixel of a patch.
    counts : (h, w) int64 work space, h and w the exemplar's patches down and across.
    price : (h, w) int64, output.
    """
    height, width = counts.shape
    counts[:] = 0
    for y in range(row.shape[0]):
        for x in range(row.shape[1]):
            counts[row[y, x], column[y, x]] += 1
    # A patch at distance (dy, dx) shares (patch_size - |dy|) * (patch_size - |dx|) pixels: two tents, one an axis.
    reach = patch_size - 1
    line = np.zeros(max(height, width) + 2 * reach + 1, np.int64)
    for y in range(height):
        _tent(counts[y], line, reach)
    for x in range(width):
        _tent(counts[:, x], line, reach)
    scale = price_per_use / patch_size**2
    for y in range(height):
        for x in range(width):
            price[y, x] = np.int64(np.rint(counts[y, x] * scale))


@numba.njit(cache=True, nogil=True)
def _tent(values, line, reach):
    """Replace ``values`` by their sums under a tent of half width ``reach`` + 1 and height ``reach`` + 1."""
    size = values.size
    side = reach + 1
    # box sums that end at i, for i from 0 to size + reach
    total = np.int64(0)
    for i in range(size + reach):
        if i < size:
            total += values[i]
        if i >= side:
            total -= values[i - side]
        line[i] = total
    # box sums of the box sums that begin at i
    total = np.int64(0)
    for i in range(side):
        total += line[i]
    for i in range(size):
        values[i] = total
        total += (line[i + side] if i + side < size + reach else 0) - line[i]


@numba.njit(cache=True, nogil=True)
def patch_distance(target, target_start, exemplar, exemplar_start, patch_size, run, limit):
    """Sum of squared differences of two patches, or anything at or above ``limit`` as soon as it is reached."""
    target_pitch, exemplar_pitch = np.uint64(target.shape[1]), np.uint64(exemplar.shape[1])
    total = np.int64(0)
    for _ in range(patch_size // 2):
        total += two_row_distance(target, target_start, exemplar, exemplar_start, run)
        if total >= limit:
            return total
        target_start += target_pitch + target_pitch
        exemplar_start += exemplar_pitch + exemplar_pitch
    if patch_size % 2:
        for i in range(len(run)):
            difference = np.int64(target.flat[target_start + i]) - np.int64(exemplar.flat[exemplar_start + i])
            total += difference * difference
    return total


@numba.njit(cache=True, nogil=True)
def _distances(patch_size, run, target, exemplar, row, column, distance, first, last):
    """Fill ``distance[first:last]`` (int64) with the distance of each target patch to its match."""
    target_pitch, exemplar_pitch = np.uint64(target.shape[1]), np.uint64(exemplar.shape[1])
    channels = len(run) // patch_size
    for y in range(first, last):
        for x in range(row.shape[1]):
            distance[y, x] = patch_distance(
                target,
                np.uint64(y) * target_pitch + np.uint64(x * channels),
                exemplar,
                np.uint64(row[y, x]) * exemplar_pitch + np.uint64(column[y, x] * channels),
                patch_size,
                run,
                np.int64(2**62),
            )


@numba.njit(cache=True, nogil=True)
def _sweep(
    patch_size,
    run,
    target,
    exemplar,
    row,
    column,
    distance,
    price,
    own_price,
    overused,
    unused_row,
    unused_column,
    first,
    last,
    forward,
    wrap,
    radius,
    tries,
    fill_tries,
    key,
):
    """One scan of PatchMatch over the target patches of rows ``first`` to ``last``.

    Propagation from the two neighbours behind, then random search around the match, then tries at little used
    places. A patch whose four neighbours all agree with it is left alone.

    Parameters
    ----------
    patch_size, run : see `patch_kernels`
    target, exemplar : (H, W * channels), (h, w * channels) int16
        The target is padded by a patch less one where ``wrap`` is set.
    row, column : (p, q) int32, changed in place
    distance : (p, q) int64, distance of the current matches, kept up to date
    price : (h - patch_size + 1, w - patch_size + 1) int64
    own_price : int64, what a new match adds to its own price
    overused : int64, price beyond which random search refuses a place that is not better than the current one
    unused_row, unused_column : (m,) int32, places drawn in proportion to how little they are used
    forward : bool, direction of the scan
    wrap : bool, the target is a torus
    radius : int, half side of the square for random search, pixels
    tries, fill_tries : int, random tries around the match, and at little used places
    key : uint64, of the random numbers

    Returns
    -------
    int, number of matches that changed.
    """
    down, across = row.shape
    rows, columns = price.shape
    target_pitch, exemplar_pitch = np.uint64(target.shape[1]), np.uint64(exemplar.shape[1])
    channels = len(run) // patch_size
    step = 1 if forward else -1
    changed = 0
    for i in range(last - first):
        y = first + i if forward else last - 1 - i
        for j in range(across):
            x = j if forward else across - 1 - j
            best_row, best_column = row[y, x], column[y, x]

            coherent = True
            for side in range(4):
                dy = (side - 1) if side % 2 == 0 else 0
                dx = (side - 2) if side % 2 == 1 else 0
                ny, nx = y + dy, x + dx
                if wrap:
                    ny = ny + down if ny < 0 else (ny - down if ny >= down else ny)
                    nx = nx + across if nx < 0 else (nx - across if nx >= across else nx)
                elif ny < 0 or ny >= down or nx < 0 or nx >= across:
                    continue
                if row[ny, nx] - dy != best_row or column[ny, nx] - dx != best_column:
                    coherent = False
                    break
            if coherent:
                continue

            start = np.uint64(y) * target_pitch + np.uint64(x * channels)
            best_distance = distance[y, x]
            best = best_distance + price[best_row, best_column]
            old_row, old_column = best_row, best_column
            old_price = price[old_row, old_column]

            for side in range(2):
                ny = y - step if side == 0 else y
                nx = x if side == 0 else x - step
                if wrap:
                    ny = ny + down if ny < 0 else (ny - down if ny >= down else ny)
                    nx = nx + across if nx < 0 else (nx - across if nx >= across else nx)
                elif ny < 0 or ny >= down or nx < 0 or nx >= across:
                    continue
                r = row[ny, nx] + (step if side == 0 else 0)
                c = column[ny, nx] + (0 if side == 0 else step)
                if r < 0 or r >= rows or c < 0 or c >= columns or (r == best_row and c == best_column):
                    continue
                charge = price[r, c] + own_price
                if charge >= best:
                    continue
                there = np.uint64(r) * exemplar_pitch + np.uint64(c * channels)
                found = patch_distance(target, start, exemplar, there, patch_size, run, best - charge)
                if found + charge < best:
                    best, best_distance, best_row, best_column = found + charge, found, r, c

            patch = y * across + x
            for attempt in range(tries + fill_tries):
                if attempt < tries:
                    usable = False
                    for draw in range(_DRAWS):
                        bits = random_bits(key, patch, attempt * _DRAWS + draw)
                        low_r, high_r = max(0, best_row - radius), min(rows - 1, best_row + radius)
                        low_c, high_c = max(0, best_column - radius), min(columns - 1, best_column + radius)
                        r = low_r + np.int64((bits >> np.uint64(32)) % np.uint64(high_r - low_r + 1))
                        c = low_c + np.int64((bits & np.uint64(0xFFFFFFFF)) % np.uint64(high_c - low_c + 1))
                        if price[r, c] <= overused or price[r, c] < old_price:
                            usable = True
                            break
                    if not usable:
                        continue
                else:
                    bits = random_bits(key, patch, attempt * _DRAWS)
                    place = np.int64(bits % np.uint64(unused_row.size))
                    r, c = np.int64(unused_row[place]), np.int64(unused_column[place])
                charge = price[r, c] + own_price
                if charge >= best:
                    continue
                there = np.uint64(r) * exemplar_pitch + np.uint64(c * channels)
                found = patch_distance(target, start, exemplar, there, patch_size, run, best - charge)
                if found + charge < best:
                    best, best_distance, best_row, best_column = found + charge, found, r, c

            if best_row != old_row or best_column != old_column:
                row[y, x], column[y, x], distance[y, x] = best_row, best_column, best_distance
                changed += 1
    return changed


class PatchKernels(NamedTuple):
    """The kernels for one patch size and number of channels."""

    distances: Callable[..., Any]
    sweep: Callable[..., Any]


@cache
def patch_kernels(patch_size: int, channels: int) -> PatchKernels:
    """The search for patches of ``patch_size`` x ``patch_size`` pixels with ``channels`` values each.

    The compiler has to know the length of a patch's row, which is what makes the distance fast: it is that of a
    tuple ``run``. (Kernels made in a function would know it too, but are compiled anew by every process.)
    """
    run = (np.int8(0),) * (patch_size * channels)
    return PatchKernels(partial(_distances, patch_size, run), partial(_sweep, patch_size, run))
