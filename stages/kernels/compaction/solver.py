"""Inverse texture synthesis: matching a texture and its compaction both ways, and choosing the latter's pixels.

Features are int16, pixels in rows of ``width * channels`` values. A neighbourhood is named by its top-left pixel.
"""

from typing import Any, NamedTuple

import numpy as np

from texloom.stages.kernels.core.compiled import compiled, inner
from texloom.stages.kernels.patchmatch.search import PatchShape, cross_step, patch_distance, square_step, wrap_index


class MatchedNeighbourhoods(NamedTuple):
    """Neighbourhoods of one picture, and of the one that their matches lie in."""

    shape: PatchShape
    features: Any
    """(h, w * channels) int16, whose neighbourhoods at every ``step`` px are matched"""
    others: Any
    """(H, W * channels) int16, whose neighbourhoods at every px are matches"""
    step: int


class CompactionSource(NamedTuple):
    """The pixels that a compaction may be copied from."""

    features: Any
    """(h, w * channels) int16"""
    inside: Any
    """(h, w) bool, the pixels that may be copied"""
    candidates: Any
    """(p, q, k) int32, see `texloom.stages.analysis.similarity.k_coherence`; all -1 where there is none"""
    size: int
    """side of a neighbourhood, px"""


class Objective(NamedTuple):
    """What the pixels of a compaction are chosen by."""

    wanted: Any
    """(H, W, channels) float32"""
    weights: Any
    """(H, W) float32, cost of a squared difference from what is wanted"""
    seam_weight: Any
    """float32, cost of `seam` with each of the four neighbours"""
    wrap: bool
    """the compaction is a torus"""


@inner(forceinline=True)
def _distance(neighbourhoods, y, x, row, column, limit):
    """Distance of the neighbourhood of a grid point to one of the other picture; see `patch_distance`."""
    shape, features, others, step = neighbourhoods
    return patch_distance(shape, features, y * step, x * step, others, row, column, limit)


@compiled
def improve_match(neighbourhoods, proposed, moved, match, distance, first, last):
    """Give neighbourhoods of grid rows ``first`` to ``last`` the better of their match and a proposal.

    Parameters
    ----------
    neighbourhoods : MatchedNeighbourhoods
    proposed : (2, p, q) int32, a match for each; negative where there is no neighbourhood
    moved : (P, Q) bool, the places in the other picture that differ from when distances were computed
    match : (2, p, q) int32, changed in place
    distance : (p, q) int64, changed in place
    """
    for y in range(first, last):
        for x in range(match.shape[2]):
            if proposed[0, y, x] < 0:
                match[0, y, x], match[1, y, x] = -1, -1
                distance[y, x] = 0
                continue
            row, column = match[0, y, x], match[1, y, x]
            if moved[row, column]:
                distance[y, x] = _distance(neighbourhoods, y, x, row, column, np.int64(2**62))
            if row == proposed[0, y, x] and column == proposed[1, y, x]:
                continue
            row, column = proposed[0, y, x], proposed[1, y, x]
            d = _distance(neighbourhoods, y, x, row, column, distance[y, x])
            if d < distance[y, x]:
                distance[y, x] = d
                match[0, y, x], match[1, y, x] = row, column


@compiled
def propagate_match(neighbourhoods, wrap, known, changed, match, distance, first, last):
    """Let neighbourhoods of grid rows ``first`` to ``last`` try the shifted matches of their four neighbours.

    Parameters
    ----------
    neighbourhoods : MatchedNeighbourhoods
    wrap : bool, the matches lie on a torus, whose features are padded by a neighbourhood less one pixel
    known : (2, p, q) int32, the matches before; negative where there is no neighbourhood
    changed : (p, q) bool, which of them the neighbours have not tried yet
    match : (2, p, q) int32, changed in place
    distance : (p, q) int64, of the matches, changed in place
    """
    shape, _, others, step = neighbourhoods
    down, across = others.shape[0] - shape.size + 1, others.shape[1] // shape.channels - shape.size + 1
    for y in range(first, last):
        for x in range(match.shape[2]):
            if match[0, y, x] < 0:
                continue
            for side in range(4):
                dy, dx = cross_step(side)
                if y + dy < 0 or y + dy >= match.shape[1] or x + dx < 0 or x + dx >= match.shape[2]:
                    continue
                if known[0, y + dy, x + dx] < 0 or not changed[y + dy, x + dx]:
                    continue
                row, column = known[0, y + dy, x + dx] - dy * step, known[1, y + dy, x + dx] - dx * step
                if wrap:
                    row, column = row % down, column % across
                if row < 0 or row >= down or column < 0 or column >= across:
                    continue
                if row == match[0, y, x] and column == match[1, y, x]:
                    continue
                d = _distance(neighbourhoods, y, x, row, column, distance[y, x])
                if d < distance[y, x]:
                    distance[y, x] = d
                    match[0, y, x], match[1, y, x] = row, column


@inner(forceinline=True)
def _is_among(tried, count, candidate):
    """Whether one of the first ``count`` of ``tried`` is ``candidate``, all int64; without branches."""
    found = False
    for i in range(count):
        found |= tried[i] == candidate
    return found


@compiled
def match_by_coherence(neighbourhoods, source, candidates, moved, match, distance, first, last):
    """Match compaction neighbourhoods of rows ``first`` to ``last`` with the texture by k-coherence [Tong2002]_.

    Candidates are the match so far and, for the nine pixels in the middle, their sources and the candidates of
    these, shifted.

    Parameters
    ----------
    neighbourhoods : MatchedNeighbourhoods, of the compaction with matches in the texture; the step is 1
    source : (2, H, W) int32, the texture pixel of each compaction pixel
    candidates : (p, q, k) int32, see `CompactionSource`
    moved : (P, Q) bool, the neighbourhoods that differ from when they were matched; the others are skipped
    match : (2, P, Q) int32, changed in place
    distance : (P, Q) int64, changed in place
    """
    middle = neighbourhoods.shape.size // 2
    down, across = candidates.shape[0], candidates.shape[1]
    tried = np.empty(1 + 9 * candidates.shape[2], np.int64)  # pixels from one place have the same candidates
    for y in range(first, last):
        for x in range(match.shape[2]):
            if not moved[y, x]:
                continue
            best = _distance(neighbourhoods, y, x, match[0, y, x], match[1, y, x], np.int64(2**62))
            tried[0] = np.int64(match[0, y, x]) * across + match[1, y, x]
            count = 1
            for neighbour in range(9):
                dy, dx = neighbour // 3 - 1, neighbour % 3 - 1
                own_row = source[0, y + middle + dy, x + middle + dx] - middle
                own_column = source[1, y + middle + dy, x + middle + dx] - middle
                inside = 0 <= own_row < down and 0 <= own_column < across
                for i in range(candidates.shape[2] if inside else 1):
                    row, column = own_row - dy, own_column - dx
                    if i > 0:
                        candidate = candidates[own_row, own_column, i]
                        if candidate < 0:
                            break
                        row, column = candidate // across - dy, candidate % across - dx
                    if row < 0 or row >= down or column < 0 or column >= across or candidates[row, column, 0] < 0:
                        continue
                    place = np.int64(row) * across + column
                    if _is_among(tried, count, place):
                        continue
                    tried[count] = place
                    count += 1
                    d = _distance(neighbourhoods, y, x, row, column, best)
                    if d < best:
                        best = d
                        match[0, y, x], match[1, y, x] = row, column
            distance[y, x] = best


@inner(inline="always")
def _add_neighbourhood(shape, pixels, row, column, sums, counts, to_row, to_column):
    """Add the pixels of a neighbourhood to ``sums`` and their number to ``counts``, both at another place."""
    channels, run = shape.channels, shape.size * shape.channels
    for i in range(shape.size):
        values = pixels[row + i, column * channels : column * channels + run]
        into = sums[to_row + i, to_column * channels : to_column * channels + run]
        for k in range(values.size):
            into[k] += values[k]
        for j in range(shape.size):
            counts[to_row + i, to_column + j] += 1


@compiled
def scatter_votes(neighbourhoods, match, sums, counts, first, last):
    """Add the pixels of neighbourhoods of grid rows ``first`` to ``last`` to those they are matched with.

    Parameters
    ----------
    neighbourhoods : MatchedNeighbourhoods; ``others`` are not read
    match : (2, p, q) int32; negative where there is no neighbourhood
    sums, counts : (H, W * channels) and (H, W) int64, added to
    """
    shape, features, _, step = neighbourhoods
    for y in range(first, last):
        for x in range(match.shape[2]):
            row, column = match[0, y, x], match[1, y, x]
            if row >= 0:
                _add_neighbourhood(shape, features, y * step, x * step, sums, counts, row, column)


@compiled
def gather_votes(neighbourhoods, match, sums, counts):
    """Add the neighbourhoods that those of the compaction are matched with to its pixels.

    Parameters
    ----------
    neighbourhoods : MatchedNeighbourhoods, of the compaction with matches in the texture; the step is 1
    match : (2, P, Q) int32
    sums, counts : (H, W * channels) and (H, W) int64, added to
    """
    shape, _, others, _ = neighbourhoods
    for y in range(match.shape[1]):
        for x in range(match.shape[2]):
            _add_neighbourhood(shape, others, match[0, y, x], match[1, y, x], sums, counts, y, x)


@inner(inline="always")
def pixel_difference(features, channels, row, column, other_row, other_column):
    """Squared difference of two pixels of (h, w * channels) int16, float32."""
    total = np.float32(0)
    for k in range(channels):
        one = np.float32(features[row, column * channels + k])
        difference = one - np.float32(features[other_row, other_column * channels + k])
        total += difference * difference
    return total


@inner
def _difference(texture, width, channels, row, column, other_row, other_column):
    """Squared difference of two texture pixels; 0 where one is outside."""
    height = texture.shape[0]
    if row < 0 or row >= height or column < 0 or column >= width:
        return np.float32(0)
    if other_row < 0 or other_row >= height or other_column < 0 or other_column >= width:
        return np.float32(0)
    return pixel_difference(texture, channels, row, column, other_row, other_column)


@compiled
def seam(texture, width, channels, row, column, other_row, other_column, dy, dx):
    """How visible a seam is, between a pixel from (row, column) and one (dy, dx) beside from the other place.

    Each is compared with what the texture has beside the other's source; 0 where the sources are neighbours too.
    """
    if other_row - row == dy and other_column - column == dx:
        return np.float32(0)
    one = _difference(texture, width, channels, row + dy, column + dx, other_row, other_column)
    return one + _difference(texture, width, channels, row, column, other_row - dy, other_column - dx)


@compiled
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


@inner(forceinline=True)
def wanted_cost(features, objective, y, x, row, column):
    """Cost, float32, of how a texture pixel differs from what is wanted at the compaction's (y, x)."""
    channels = objective.wanted.shape[2]
    cost = np.float32(0)
    for k in range(channels):
        difference = np.float32(features[row, column * channels + k]) - objective.wanted[y, x, k]
        cost += difference * difference
    return cost * objective.weights[y, x]


@inner(forceinline=True)
def _pixel_cost(features, objective, source, y, x, row, column, limit):
    """Cost of copying a texture pixel to the compaction's (y, x), float32; any value from ``limit`` on."""
    wanted, _, seam_weight, wrap = objective
    channels = wanted.shape[2]
    cost = wanted_cost(features, objective, y, x, row, column)
    if seam_weight > 0:
        for side in range(4):
            if cost >= limit:
                break
            dy, dx = cross_step(side)
            v, u = wrap_index(y + dy, source.shape[1], wrap), wrap_index(x + dx, source.shape[2], wrap)
            if v >= 0 and u >= 0:
                cost += seam_weight * seam(
                    features, features.shape[1] // channels, channels, row, column,
                    source[0, v, u], source[1, v, u], dy, dx,
                )  # fmt: skip
    return cost


@compiled
def choose_pixels(texture, objective, active, source):
    """Set the source of each active compaction pixel in turn to the candidate of least cost.

    A pixel is inactive afterwards; where its source has changed, it and its eight neighbours are active. Candidates
    are the source so far and, for the pixel and its eight neighbours, their sources and the candidates of these,
    shifted.

    Parameters
    ----------
    texture : CompactionSource
    objective : Objective
    active : (H, W) bool, changed in place
    source : (2, H, W) int32, changed in place
    """
    features, inside, candidates, size = texture
    wrap = objective.wrap
    middle = size // 2
    down, across = candidates.shape[0], candidates.shape[1]
    height, width = inside.shape
    tried = np.empty(9 * candidates.shape[2], np.int64)
    for y in range(source.shape[1]):
        for x in range(source.shape[2]):
            if not active[y, x]:
                continue
            active[y, x] = False
            best, best_row, best_column = np.float32(np.inf), source[0, y, x], source[1, y, x]
            count = 0
            for neighbour in range(9):
                dy, dx = square_step(neighbour)  # the pixel itself first, so that it stays where nothing is better
                v, u = wrap_index(y + dy, source.shape[1], wrap), wrap_index(x + dx, source.shape[2], wrap)
                if v < 0 or u < 0:
                    continue
                own_row, own_column = source[0, v, u], source[1, v, u]
                known = 0 <= own_row - middle < down and 0 <= own_column - middle < across
                for i in range(candidates.shape[2] if known else 1):
                    row, column = own_row - dy, own_column - dx
                    if i > 0:
                        candidate = candidates[own_row - middle, own_column - middle, i]
                        if candidate < 0:
                            break
                        row, column = candidate // across + middle - dy, candidate % across + middle - dx
                    if row < 0 or row >= height or column < 0 or column >= width or not inside[row, column]:
                        continue
                    candidate = np.int64(row) * width + column
                    if _is_among(tried, count, candidate):
                        continue
                    tried[count] = candidate
                    count += 1
                    cost = _pixel_cost(features, objective, source, y, x, row, column, best)
                    if cost < best:
                        best, best_row, best_column = cost, row, column
            if source[0, y, x] == best_row and source[1, y, x] == best_column:
                continue
            source[0, y, x], source[1, y, x] = best_row, best_column
            for neighbour in range(9):
                dy, dx = square_step(neighbour)
                v, u = wrap_index(y + dy, source.shape[1], wrap), wrap_index(x + dx, source.shape[2], wrap)
                if v >= 0 and u >= 0:
                    active[v, u] = True
