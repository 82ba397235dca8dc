"""Inverse texture synthesis: matching a texture and its compaction both ways, and choosing the latter's pixels.

Features are int16, pixels in rows of ``width * channels`` values. A neighbourhood is named by its top-left pixel. A
tuple ``run`` of as many zeros as a neighbourhood's row has values makes that number known to the compiler.
"""

from __future__ import annotations

import numba
import numpy as np

from texloom.stages.kernels.patchmatch.search import patch_distance


@numba.njit(cache=True, nogil=True)
def improve_inverse(texture, compaction, step, size, run, proposed, match, distance, first, last):
    """Give texture neighbourhoods of grid rows ``first`` to ``last`` the better of their match and a proposal.

    Parameters
    ----------
    texture, compaction : (h, w * channels), (H, W * channels) int16
    step : int, px between neighbourhoods of the grid
    proposed : (2, p, q) int32, a place in the compaction for each; negative where there is no neighbourhood
    match : (2, p, q) int32, changed in place
    distance : (p, q) int64, output
    """
    channels = len(run) // size
    pitch, other_pitch = np.uint64(texture.shape[1]), np.uint64(compaction.shape[1])
    for y in range(first, last):
        for x in range(match.shape[2]):
            if proposed[0, y, x] < 0:
                match[0, y, x], match[1, y, x] = -1, -1
                distance[y, x] = 0
                continue
            start = np.uint64(y * step) * pitch + np.uint64(x * step * channels)
            best = np.int64(2**62)
            for attempt in range(2):
                row, column = match[0, y, x], match[1, y, x]
                if attempt == 1:
                    if row == proposed[0, y, x] and column == proposed[1, y, x]:
                        continue
                    row, column = proposed[0, y, x], proposed[1, y, x]
                there = np.uint64(row) * other_pitch + np.uint64(column * channels)
                found = patch_distance(texture, start, compaction, there, size, run, best)
                if found < best:
                    best = found
                    match[0, y, x], match[1, y, x] = row, column
            distance[y, x] = best


@numba.njit(cache=True, nogil=True)
def propagate_inverse(texture, compaction, step, size, run, wrap, known, fresh, match, distance, first, last):
    """Let texture neighbourhoods of grid rows ``first`` to ``last`` try their four neighbours' matches, shifted.

    Parameters
    ----------
    wrap : bool, the compaction is a torus, which here goes on for a neighbourhood less one beyond its last pixels
    known : (2, p, q) int32, the matches as they were
    fresh : (p, q) bool, those that were not tried yet
    match, distance : (2, p, q) int32 and (p, q) int64, the same and their distances, changed in place

    See `improve_inverse` for the others.
    """
    channels = len(run) // size
    pitch, other_pitch = np.uint64(texture.shape[1]), np.uint64(compaction.shape[1])
    down, across = compaction.shape[0] - size + 1, compaction.shape[1] // channels - size + 1
    for y in range(first, last):
        for x in range(match.shape[2]):
            if match[0, y, x] < 0:
                continue
            start = np.uint64(y * step) * pitch + np.uint64(x * step * channels)
            for side in range(4):
                dy = (side - 1) if side % 2 == 0 else 0
                dx = (side - 2) if side % 2 == 1 else 0
                if y + dy < 0 or y + dy >= match.shape[1] or x + dx < 0 or x + dx >= match.shape[2]:
                    continue
                if known[0, y + dy, x + dx] < 0 or not fresh[y + dy, x + dx]:
                    continue
                row, column = known[0, y + dy, x + dx] - dy * step, known[1, y + dy, x + dx] - dx * step
                if wrap:
                    row, column = row % down, column % across
                if row < 0 or row >= down or column < 0 or column >= across:
                    continue
                if row == match[0, y, x] and column == match[1, y, x]:
                    continue
                there = np.uint64(row) * other_pitch + np.uint64(column * channels)
                found = patch_distance(texture, start, compaction, there, size, run, distance[y, x])
                if found < distance[y, x]:
                    distance[y, x] = found
                    match[0, y, x], match[1, y, x] = row, column


@numba.njit(cache=True, nogil=True)
def improve_forward(texture, compaction, source, candidates, size, run, match, distance, first, last):
    """Match compaction neighbourhoods of rows ``first`` to ``last`` with the texture by k-coherence [Tong2002]_.

    Candidates are the match so far and what looks like the sources of the nine pixels in the middle, shifted.

    Parameters
    ----------
    source : (2, H, W) int32, the texture pixel of each compaction pixel
    candidates : (p, q, k) int32, see `texloom.stages.analysis.k_coherence`; all -1 where there is no neighbourhood
    match : (2, P, Q) int32, changed in place
    distance : (P, Q) int64, output

    See `improve_inverse` for the others.
    """
    channels = len(run) // size
    middle = size // 2
    down, across = candidates.shape[0], candidates.shape[1]
    pitch, other_pitch = np.uint64(compaction.shape[1]), np.uint64(texture.shape[1])
    for y in range(first, last):
        for x in range(match.shape[2]):
            start = np.uint64(y) * pitch + np.uint64(x * channels)
            there = np.uint64(match[0, y, x]) * other_pitch + np.uint64(match[1, y, x] * channels)
            best = patch_distance(compaction, start, texture, there, size, run, np.int64(2**62))
            for beside in range(9):
                dy, dx = beside // 3 - 1, beside % 3 - 1
                own_row = source[0, y + middle + dy, x + middle + dx] - middle
                own_column = source[1, y + middle + dy, x + middle + dx] - middle
                inside = 0 <= own_row < down and 0 <= own_column < across
                for i in range(candidates.shape[2] if inside else 1):
                    row, column = own_row - dy, own_column - dx
                    if i > 0:
                        alike = candidates[own_row, own_column, i]
                        if alike < 0:
                            break
                        row, column = alike // across - dy, alike % across - dx
                    if row < 0 or row >= down or column < 0 or column >= across or candidates[row, column, 0] < 0:
                        continue
                    if row == match[0, y, x] and column == match[1, y, x]:
                        continue
                    there = np.uint64(row) * other_pitch + np.uint64(column * channels)
                    found = patch_distance(compaction, start, texture, there, size, run, best)
                    if found < best:
                        best = found
                        match[0, y, x], match[1, y, x] = row, column
            distance[y, x] = best


@numba.njit(cache=True, nogil=True)
def inverse_votes(texture, step, size, run, match, sums, counts, first, last):
    """Add the pixels of texture neighbourhoods of grid rows ``first`` to ``last`` where they are matched.

    Parameters
    ----------
    match : (2, p, q) int32, places in the compaction; negative where there is none
    sums, counts : (H, W * channels) and (H, W) int64, added to
    """
    channels = len(run) // size
    for y in range(first, last):
        for x in range(match.shape[2]):
            row, column = match[0, y, x], match[1, y, x]
            if row < 0:
                continue
            for i in range(size):
                given = texture[y * step + i, x * step * channels : x * step * channels + len(run)]
                into = sums[row + i, column * channels : column * channels + len(run)]
                for k in range(given.size):
                    into[k] += given[k]
                for j in range(size):
                    counts[row + i, column + j] += 1


@numba.njit(cache=True, nogil=True)
def forward_votes(texture, size, run, match, sums, counts):
    """Add the texture neighbourhoods that compaction neighbourhoods are matched with where these stand.

    Parameters
    ----------
    match : (2, P, Q) int32, places in the texture
    sums, counts : (H, W * channels) and (H, W) int64, added to
    """
    channels = len(run) // size
    for y in range(match.shape[1]):
        for x in range(match.shape[2]):
            row, column = match[0, y, x], match[1, y, x]
            for i in range(size):
                given = texture[row + i, column * channels : column * channels + len(run)]
                into = sums[y + i, x * channels : x * channels + len(run)]
                for k in range(given.size):
                    into[k] += given[k]
                for j in range(size):
                    counts[y + i, x + j] += 1


@numba.njit(cache=True, nogil=True)
def _difference(texture, width, channels, row, column, other_row, other_column):
    """Squared difference of two texture pixels; 0 where one is outside."""
    height = texture.shape[0]
    if row < 0 or row >= height or column < 0 or column >= width:
        return np.float32(0)
    if other_row < 0 or other_row >= height or other_column < 0 or other_column >= width:
        return np.float32(0)
    far = np.float32(0)
    for k in range(channels):
        one = np.float32(texture[row, column * channels + k])
        difference = one - np.float32(texture[other_row, other_column * channels + k])
        far += difference * difference
    return far


@numba.njit(cache=True, nogil=True)
def seam(texture, width, channels, row, column, other_row, other_column, dy, dx):
    """What is visible where a pixel from (row, column) meets one from (other_row, other_column) at (dy, dx) beside.

    Each is compared with what the texture has beside the other's source; 0 where the sources are neighbours too.
    """
    if other_row - row == dy and other_column - column == dx:
        return np.float32(0)
    one = _difference(texture, width, channels, row + dy, column + dx, other_row, other_column)
    return one + _difference(texture, width, channels, row, column, other_row - dy, other_column - dx)


@numba.njit(cache=True, nogil=True)
def seam_sum(texture, channels, wrap, source):
    """Sum of `seam` over all pairs of pixels side by side and one below the other; float64."""
    total = 0.0
    height, width, across = source.shape[1], source.shape[2], texture.shape[1] // channels
    for y in range(height):
        for x in range(width):
            for side in range(2):
                v, u = y + side, x + 1 - side
                if wrap:
                    v, u = v % height, u % width
                if v < height and u < width:
                    one, other = source[:, y, x], source[:, v, u]
                    total += seam(texture, across, channels, one[0], one[1], other[0], other[1], side, 1 - side)
    return total


@numba.njit(cache=True, nogil=True)
def choose_pixels(texture, inside, wanted, weights, seam_weight, candidates, size, wrap, source):
    """Set the source of each compaction pixel in turn to the cheapest candidate.

    Candidates are the source so far and what looks like the sources of the pixel and its eight neighbours, shifted.

    Parameters
    ----------
    texture : (h, w * channels) int16
    inside : (h, w) bool, the pixels that may be copied
    wanted : (H, W, channels) float32
    weights : (H, W) float32, price of a squared difference from what is wanted
    seam_weight : float32, price of `seam` with each of the four neighbours
    candidates : (p, q, k) int32, see `texloom.stages.analysis.k_coherence`
    wrap : bool, the compaction is a torus
    source : (2, H, W) int32, changed in place
    """
    channels = wanted.shape[2]
    middle = size // 2
    down, across = candidates.shape[0], candidates.shape[1]
    height, width = texture.shape[0], texture.shape[1] // channels
    own_height, own_width = source.shape[1], source.shape[2]
    for y in range(own_height):
        for x in range(own_width):
            best, best_row, best_column = np.float32(np.inf), source[0, y, x], source[1, y, x]
            for beside in range(9):
                # the pixel itself first, so that it stays where nothing is better
                dy, dx = (beside + 4) % 9 // 3 - 1, (beside + 4) % 9 % 3 - 1
                v, u = y + dy, x + dx
                if wrap:
                    v, u = v % own_height, u % own_width
                if v < 0 or v >= own_height or u < 0 or u >= own_width:
                    continue
                own_row, own_column = source[0, v, u], source[1, v, u]
                known = 0 <= own_row - middle < down and 0 <= own_column - middle < across
                for i in range(candidates.shape[2] if known else 1):
                    row, column = own_row - dy, own_column - dx
                    if i > 0:
                        alike = candidates[own_row - middle, own_column - middle, i]
                        if alike < 0:
                            break
                        row, column = alike // across + middle - dy, alike % across + middle - dx
                    if row == best_row and column == best_column and best < np.inf:
                        continue
                    if row < 0 or row >= height or column < 0 or column >= width or not inside[row, column]:
                        continue
                    price = np.float32(0)
                    for k in range(channels):
                        difference = np.float32(texture[row, column * channels + k]) - wanted[y, x, k]
                        price += difference * difference
                    price *= weights[y, x]
                    if seam_weight > 0:
                        for side in range(4):
                            down_by = (side - 1) if side % 2 == 0 else 0
                            across_by = (side - 2) if side % 2 == 1 else 0
                            if price >= best:
                                break
                            v, u = y + down_by, x + across_by
                            if wrap:
                                v, u = v % own_height, u % own_width
                            if 0 <= v < own_height and 0 <= u < own_width:
                                price += seam_weight * seam(
                                    texture,
                                    width,
                                    channels,
                                    row,
                                    column,
                                    source[0, v, u],
                                    source[1, v, u],
                                    down_by,
                                    across_by,
                                )
                    if price < best:
                        best, best_row, best_column = price, row, column
            source[0, y, x], source[1, y, x] = best_row, best_column
