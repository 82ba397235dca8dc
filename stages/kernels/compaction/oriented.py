"""Inverse texture synthesis of oriented textures: neighbourhoods are read along the texture's own direction.

A neighbourhood's frame at an angle a has its columns along (sin a, cos a) and its rows along (cos a, -sin a), given
as (down, across); at 0 it is the pixels' own. Beyond the border the nearest pixel repeats. Sources lie between the
texture's pixels, since steps of a pixel in a frame are no whole pixels; rounded, they would tear the compaction.
"""

import math
from typing import Any, NamedTuple

import numpy as np

from texloom.stages.kernels.core.compiled import compiled, inner
from texloom.stages.kernels.patchmatch.search import cross_step, square_step, wrap_index


class OrientedTexture(NamedTuple):
    """A texture and the direction of each of its pixels."""

    features: Any
    """(h, w * channels) int16"""
    channels: int
    angle: Any
    """(h, w) float32, of the frames, radians"""


class AngleSearch(NamedTuple):
    """How `refine_angles` searches."""

    reach: float
    """half the first interval, radians"""
    samples: int
    """angles tried in a round"""
    rounds: int
    within: int
    """px around a neighbourhood's match in the compaction that are searched"""


@compiled
def sample(texture, channels, row, column, into, start):
    """Interpolate ``texture``, (h, w * channels) int16, bilinearly at a place, into ``into`` from ``start`` on."""
    height, width = texture.shape[0], texture.shape[1] // channels
    row, column = min(max(row, 0.0), height - 1.0), min(max(column, 0.0), width - 1.0)
    top, left = min(int(row), max(height - 2, 0)), min(int(column), max(width - 2, 0))
    below, right = min(top + 1, height - 1), min(left + 1, width - 1)
    down, across = row - top, column - left
    for k in range(channels):
        above = (1 - across) * texture[top, left * channels + k] + across * texture[top, right * channels + k]
        under = (1 - across) * texture[below, left * channels + k] + across * texture[below, right * channels + k]
        into[start + k] = np.int16(math.floor((1 - down) * above + down * under + 0.5))


@inner
def _write_window(texture, channels, row, column, angle, size, into):
    """Write the neighbourhood around a pixel, in the frame of ``angle``, row by row."""
    middle = size // 2
    sine, cosine = math.sin(angle), math.cos(angle)
    for i in range(size):
        for j in range(size):
            y, x = i - middle, j - middle
            sample(
                texture, channels, row + y * cosine + x * sine, column - y * sine + x * cosine, into,
                (i * size + j) * channels,
            )  # fmt: skip


@compiled
def oriented_windows(texture, channels, places, angle, size, out, first, last):
    """Fill entries ``first`` to ``last`` of ``out`` with the neighbourhoods around ``places``.

    Parameters
    ----------
    texture : (h, w * channels) int16
    places : (n, 2) int32, rows and columns of the centres
    angle : (n,) float32, radians
    size : side of a neighbourhood, odd
    out : (n, size * size * channels) int16, output
    """
    for n in range(first, last):
        _write_window(texture, channels, places[n, 0], places[n, 1], angle[n], size, out[n])


@compiled
def _difference(windows, at_row, at_column, size, own, bound):
    """Squared difference of a neighbourhood and that of ``windows`` at a place; any value if above ``bound``."""
    run = own.size // size
    channels = run // size
    total = np.int64(0)
    for i in range(size):
        for k in range(run):
            difference = np.int64(own[i * run + k]) - np.int64(windows[at_row + i, at_column * channels + k])
            total += difference * difference
        if total > bound:
            return total
    return total


@inner
def _least_around(compaction, size, own, row, column, within, bound):
    """Least squared difference of ``own`` to the compaction's neighbourhoods within some px of a place.

    It is ``bound`` where none is less. The nearest places come first, since the sooner a small difference is
    known, the fewer values are compared.
    """
    channels = own.size // size**2
    down, across = compaction.shape[0] - size + 1, compaction.shape[1] // channels - size + 1
    best = bound
    for ring in range(within + 1):
        for dy in range(-ring, ring + 1):
            step = 1 if abs(dy) == ring else 2 * ring
            for dx in range(-ring, ring + 1, step):
                if 0 <= row + dy < down and 0 <= column + dx < across:
                    best = min(best, _difference(compaction, row + dy, column + dx, size, own, best))
    return best


@compiled
def refine_angles(texture, channels, compaction, search, places, match, mean, size, out, first, last):
    """Fill entries ``first`` to ``last`` of ``out`` with the angle at which each neighbourhood matches best.

    In each round angles are tried, evenly over an interval; of the three with the least difference to the
    compaction around the neighbourhood's match, the one nearest to the interval's middle is the next middle, and
    the interval is halved.

    Parameters
    ----------
    texture, compaction : (h, w * channels) and (H, W * channels) int16
    search : AngleSearch
    places : (n, 2) int32, centres of the texture's neighbourhoods
    match : (n, 2) int32, their matches in the compaction, by top-left pixels
    mean : (n,) float32, middles of the first intervals, radians
    size : side of a neighbourhood, odd
    out : (n,) float32, output, radians
    """
    samples = search.samples
    own = np.empty(size * size * channels, np.int16)
    for n in range(first, last):
        centre, reach = np.float64(mean[n]), search.reach
        for _ in range(search.rounds):
            least = np.full(3, 2**62, np.int64)
            angles = np.full(3, centre)
            for s in range(samples):
                angle = centre - reach + 2 * reach * s / samples
                _write_window(texture, channels, places[n, 0], places[n, 1], angle, size, own)
                difference = _least_around(compaction, size, own, match[n, 0], match[n, 1], search.within, least[2])
                for rank in range(3):
                    if difference < least[rank]:
                        for lower in range(2, rank, -1):
                            least[lower], angles[lower] = least[lower - 1], angles[lower - 1]
                        least[rank], angles[rank] = difference, angle
                        break
            nearest = angles[0]
            for rank in range(1, 3):
                if least[rank] < 2**62 and abs(angles[rank] - centre) < abs(nearest - centre):
                    nearest = angles[rank]
            centre, reach = nearest, reach / 2
        out[n] = centre


@compiled
def sample_sources(texture, source, values, first, last):
    """Fill rows ``first`` to ``last`` of ``values``, (H, W * channels) int16, with the texture at ``source``.

    ``source`` is (2, H, W) float32, places between the pixels of ``texture``, an `OrientedTexture`.
    """
    for y in range(first, last):
        for x in range(source.shape[2]):
            sample(
                texture.features,
                texture.channels,
                source[0, y, x],
                source[1, y, x],
                values[y],
                x * texture.channels,
            )


@compiled
def matched_distances(windows, others, match, out, first, last):
    """Fill entries ``first`` to ``last`` of ``out`` with squared distances of neighbourhoods and their matches.

    Parameters
    ----------
    windows, others : (n, values) and (m, values) int16
    match : (n,) int64, numbers among ``others``
    out : (n,) float64, output
    """
    for n in range(first, last):
        total, other = np.int64(0), match[n]
        for k in range(windows.shape[1]):
            difference = np.int64(windows[n, k]) - np.int64(others[other, k])
            total += difference * difference
        out[n] = total


@compiled
def add_votes(windows, match, size, sums, votes):
    """Add the values of each neighbourhood to the compaction's pixels that it is matched with.

    Parameters
    ----------
    windows : (n, size * size * channels) int16
    match : (n,) int64, numbers of the compaction's neighbourhoods, row by row
    size : side of a neighbourhood
    sums : (H, W * channels) int64, changed in place
    votes : (H, W) int64, how many values were added to each pixel; changed in place
    """
    across, run = votes.shape[1] - size + 1, windows.shape[1] // size
    for n in range(match.size):
        row, column = match[n] // across, match[n] % across
        first = column * run // size
        for i in range(size):
            for j in range(size):
                votes[row + i, column + j] += 1
            for k in range(run):
                sums[row + i, first + k] += windows[n, i * run + k]


@compiled
def _continued(angle, row, column, dy, dx):
    """The place in the texture that lies (dy, dx) from another in its frame; the frames are of whole pixels."""
    at = angle[np.int64(row + np.float32(0.5)), np.int64(column + np.float32(0.5))]
    sine, cosine = np.float32(math.sin(at)), np.float32(math.cos(at))
    y, x = np.float32(dy), np.float32(dx)
    return row + y * cosine + x * sine, column - y * sine + x * cosine


@inner
def _sample_continued(texture, row, column, dy, dx, into, start):
    """Sample the texture (dy, dx) from a place in its frame; whether that is in the texture."""
    height, width = texture.angle.shape
    there_row, there_column = _continued(texture.angle, row, column, dy, dx)
    if not (0 <= there_row <= height - 1 and 0 <= there_column <= width - 1):
        return False
    sample(texture.features, texture.channels, there_row, there_column, into, start)
    return True


@inner
def _squared_difference(one, first, other, second, channels):
    """Of two pixels in rows of int16 values, float32."""
    total = np.float32(0)
    for k in range(channels):
        difference = np.float32(one[first + k]) - np.float32(other[second + k])
        total += difference * difference
    return total


@compiled
def oriented_seam_sum(texture, source, values):
    """How visible seams are, over all pairs of pixels side by side and one below the other; float64.

    Each pixel is compared with what the texture has beside the other's source, in the frame of that source; outside
    the texture nothing is visible.

    Parameters
    ----------
    source : (2, H, W) float32
    values : (H, W * channels) int16, see `sample_sources`
    """
    total = 0.0
    channels = texture.channels
    beside = np.empty(channels, np.int16)
    for y in range(source.shape[1]):
        for x in range(source.shape[2]):
            for side in range(2):
                dy, dx = side, 1 - side
                v, u = y + dy, x + dx
                if v < source.shape[1] and u < source.shape[2]:
                    if _sample_continued(texture, source[0, y, x], source[1, y, x], dy, dx, beside, 0):
                        total += _squared_difference(beside, 0, values[v], u * channels, channels)
                    if _sample_continued(texture, source[0, v, u], source[1, v, u], -dy, -dx, beside, 0):
                        total += _squared_difference(beside, 0, values[y], x * channels, channels)
    return total


@compiled
def choose_oriented_places(texture, objective, proposed, source, values):
    """Set the source of each compaction pixel in turn to the candidate of least cost.

    Candidates are the source so far, the continuations of the eight neighbours' sources in their frames, and
    ``proposed``.

    Parameters
    ----------
    texture : OrientedTexture
    objective : texloom.stages.kernels.compaction.solver.Objective, with seams as `oriented_seam_sum`
    proposed : (k, 2, H, W) float32, places in the texture; negative where there is none
    source : (2, H, W) float32, changed in place
    values : (H, W * channels) int16, see `sample_sources`; changed in place
    """
    wanted, weights, seam_weight, wrap = objective
    height, width = texture.angle.shape
    channels = texture.channels
    own, beside = np.empty(channels, np.int16), np.empty(channels, np.int16)
    expected, is_known = np.empty((4, channels), np.int16), np.empty(4, np.bool_)
    for y in range(source.shape[1]):
        for x in range(source.shape[2]):
            for side in range(4):
                dy, dx = cross_step(side)
                v, u = wrap_index(y + dy, source.shape[1], wrap), wrap_index(x + dx, source.shape[2], wrap)
                is_known[side] = (
                    v >= 0
                    and u >= 0
                    and _sample_continued(texture, source[0, v, u], source[1, v, u], -dy, -dx, expected[side], 0)
                )
            best, best_row, best_column = np.float32(np.inf), source[0, y, x], source[1, y, x]
            for candidate in range(9 + proposed.shape[0]):
                if candidate < 9:
                    # the pixel itself first, so that it stays where nothing is better
                    dy, dx = square_step(candidate)
                    v, u = wrap_index(y + dy, source.shape[1], wrap), wrap_index(x + dx, source.shape[2], wrap)
                    if v < 0 or u < 0:
                        continue
                    row, column = _continued(texture.angle, source[0, v, u], source[1, v, u], -dy, -dx)
                else:
                    row, column = proposed[candidate - 9, 0, y, x], proposed[candidate - 9, 1, y, x]
                if row < 0 or row > height - 1 or column < 0 or column > width - 1:
                    continue
                sample(texture.features, channels, row, column, own, 0)
                cost = np.float32(0)
                for k in range(channels):
                    difference = np.float32(own[k]) - wanted[y, x, k]
                    cost += difference * difference
                cost *= weights[y, x]
                for side in range(4):
                    if cost >= best or seam_weight == 0:
                        break
                    dy, dx = cross_step(side)
                    v, u = wrap_index(y + dy, source.shape[1], wrap), wrap_index(x + dx, source.shape[2], wrap)
                    if v < 0 or u < 0:
                        continue
                    if is_known[side]:
                        cost += seam_weight * _squared_difference(expected[side], 0, own, 0, channels)
                    if _sample_continued(texture, row, column, dy, dx, beside, 0):
                        cost += seam_weight * _squared_difference(beside, 0, values[v], u * channels, channels)
                if cost < best:
                    best, best_row, best_column = cost, row, column
            source[0, y, x], source[1, y, x] = best_row, best_column
            sample(texture.features, channels, best_row, best_column, values[y], x * channels)
