"""Inverse texture synthesis of oriented textures: neighbourhoods are read along the texture's own direction.

A neighbourhood's frame at an angle a has its columns along (sin a, cos a) and its rows along (cos a, -sin a), given
as (down, across); at 0 it is the pixels' own. Beyond the border the nearest pixel repeats.
"""

import math
from typing import Any, NamedTuple

import numba
import numpy as np

from texloom.stages.kernels.compaction.solver import pixel_difference, wanted_cost
from texloom.stages.kernels.patchmatch.search import cross_step, square_step, wrap_index


class Texture(NamedTuple):
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


@numba.njit(cache=True, nogil=True)
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


@numba.njit(cache=True, nogil=True)
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


@numba.njit(cache=True, nogil=True)
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


@numba.njit(cache=True, nogil=True)
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


@numba.njit(cache=True, nogil=True)
def _least_around(compaction, size, own, row, column):
    """Least squared difference of ``own`` to the compaction's neighbourhoods within a pixel of a place."""
    channels = own.size // size**2
    down, across = compaction.shape[0] - size + 1, compaction.shape[1] // channels - size + 1
    best = np.int64(2**62)
    for dy in range(-1, 2):
        for dx in range(-1, 2):
            if 0 <= row + dy < down and 0 <= column + dx < across:
                best = min(best, _difference(compaction, row + dy, column + dx, size, own, best))
    return best


@numba.njit(cache=True, nogil=True)
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
                difference = _least_around(compaction, size, own, match[n, 0], match[n, 1])
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


@numba.njit(cache=True, nogil=True)
def _continued(angle, row, column, dy, dx):
    """The texture pixel that lies (dy, dx) from another in its frame, rounded."""
    sine, cosine = math.sin(angle[row, column]), math.cos(angle[row, column])
    return math.floor(row + dy * cosine + dx * sine + 0.5), math.floor(column - dy * sine + dx * cosine + 0.5)


@numba.njit(cache=True, nogil=True)
def _continuation_difference(texture, row, column, dy, dx, other_row, other_column):
    """Squared difference of the pixel (dy, dx) from a texture pixel and another; 0 where it is outside."""
    features, channels, angle = texture
    height, width = angle.shape
    there_row, there_column = _continued(angle, row, column, dy, dx)
    if not (0 <= there_row < height and 0 <= there_column < width):
        return np.float32(0)
    return pixel_difference(features, channels, there_row, there_column, other_row, other_column)


@numba.njit(cache=True, nogil=True)
def oriented_seam(texture, row, column, other_row, other_column, dy, dx):
    """How visible a seam is, between a pixel from (row, column) and one (dy, dx) beside from the other place.

    Each is compared with what the texture has beside the other's source, in the frame of that source; 0 where one
    continues the other.
    """
    if _continued(texture.angle, row, column, dy, dx) == (other_row, other_column):
        return np.float32(0)
    if _continued(texture.angle, other_row, other_column, -dy, -dx) == (row, column):
        return np.float32(0)
    one = _continuation_difference(texture, row, column, dy, dx, other_row, other_column)
    return one + _continuation_difference(texture, other_row, other_column, -dy, -dx, row, column)


@numba.njit(cache=True, nogil=True)
def oriented_seam_sum(texture, source):
    """Sum of `oriented_seam` over all pairs of pixels side by side and one below the other; float64.

    ``source`` is (2, H, W) int32.
    """
    total = 0.0
    for y in range(source.shape[1]):
        for x in range(source.shape[2]):
            for side in range(2):
                v, u = y + side, x + 1 - side
                if v < source.shape[1] and u < source.shape[2]:
                    one, other = source[:, y, x], source[:, v, u]
                    total += oriented_seam(texture, one[0], one[1], other[0], other[1], side, 1 - side)
    return total


@numba.njit(cache=True, nogil=True, forceinline=True)
def _pixel_cost(texture, objective, source, y, x, row, column, limit):
    """Cost of copying a texture pixel to the compaction's (y, x), float32; any value from ``limit`` on."""
    _, _, seam_weight, wrap = objective
    cost = wanted_cost(texture.features, objective, y, x, row, column)
    if seam_weight > 0:
        for side in range(4):
            if cost >= limit:
                break
            dy, dx = cross_step(side)
            v, u = wrap_index(y + dy, source.shape[1], wrap), wrap_index(x + dx, source.shape[2], wrap)
            if v >= 0 and u >= 0:
                cost += seam_weight * oriented_seam(texture, row, column, source[0, v, u], source[1, v, u], dy, dx)
    return cost


@numba.njit(cache=True, nogil=True)
def choose_oriented_pixels(texture, objective, proposed, source):
    """Set the source of each compaction pixel in turn to the candidate of least cost.

    Candidates are the source so far, the continuations of the eight neighbours' sources in their frames, and
    ``proposed``.

    Parameters
    ----------
    texture : Texture
    objective : texloom.stages.kernels.compaction.solver.Objective, with seams as `oriented_seam`
    proposed : (k, 2, H, W) int32, texture pixels; negative where there is none
    source : (2, H, W) int32, changed in place
    """
    height, width = texture.angle.shape
    wrap = objective.wrap
    for y in range(source.shape[1]):
        for x in range(source.shape[2]):
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
                if row < 0 or row >= height or column < 0 or column >= width:
                    continue
                cost = _pixel_cost(texture, objective, source, y, x, row, column, best)
                if cost < best:
                    best, best_row, best_column = cost, row, column
            source[0, y, x], source[1, y, x] = best_row, best_column
