"""Per-pixel synthesis of a single pixel, as far as CPUs and CUDA compute it alike; see also `arguments`.

Where texture is distorted, an offset between pixels is carried from the result to the texture by ``inverse`` and
from there to the exemplar by ``jacobian``; else it is the same in both. Everything but products with these matrices
is in integers, so results are bit-identical.
"""

from typing import NamedTuple

import numpy as np

from texloom.stages.kernels.core.compiled import compiled
from texloom.stages.kernels.patchmatch.search import random_bits
from texloom.stages.kernels.per_pixel.positions import (
    HELPER,
    PIXEL,
    advect,
    agree,
    phase_offset,
    pixel_number,
    place_of,
    rounded_product,
    snap_to_valid,
    transfer,
)

_ROWS = sum(row << 2 * u for u, row in enumerate((0, 0, 0, 1, 1, 2, 2, 2)))
_COLUMNS = sum(column << 2 * u for u, column in enumerate((0, 1, 2, 0, 2, 0, 1, 2)))


class Neighbourhood(NamedTuple):
    """The eight neighbours of a pixel, in scan order; arrays of 8 that `set_offsets` and `predict` fill."""

    stored: np.ndarray
    """int64, their places or positions"""
    predicted: np.ndarray
    """int64, the places or positions that continue theirs at the pixel"""
    down: np.ndarray
    """float32, offsets to them in texture, if it is distorted"""
    across: np.ndarray
    facing: np.ndarray
    """int64, the neighbour that lies in each direction of the texture, if it is distorted"""


@compiled(inline="always")
def rows_to(u):
    """Rows to neighbour number ``u``."""
    return ((_ROWS >> 2 * u) & 3) - 1


@compiled(inline="always")
def columns_to(u):
    """Columns to neighbour number ``u``."""
    return ((_COLUMNS >> 2 * u) & 3) - 1


@compiled(**HELPER)
def sampled_level(level, pixel, distortion):
    """The level of the exemplar that a pixel is compared with."""
    if distortion is None:
        return np.int64(level)
    return np.int64(distortion.sampled[pixel])


@compiled(**HELPER)
def place_at(stored, exemplar, distortion):
    """The place of what is stored, itself one or a position."""
    if distortion is None:
        return stored
    return place_of(stored, exemplar.pitch)


@compiled(**HELPER)
def snap(stored, base, exemplar, distortion):
    """What is stored, moved to the nearest valid neighbourhood; ``base``: the first row of the level's tables."""
    if distortion is None:
        return np.int64(exemplar.candidates[base + stored, 0])
    valid = np.int64(exemplar.candidates[base + place_of(stored, exemplar.pitch), 0])
    return snap_to_valid(stored, valid, exemplar.pitch)


@compiled(**HELPER)
def to_texture(down, across, pixel, length, distortion):
    """An offset of float32 in steps of the result, in texture; ``length``: px in a step of the sampled level."""
    inverse = distortion.inverse
    u = rounded_product(inverse[pixel, 0], down) + rounded_product(inverse[pixel, 1], across)
    v = rounded_product(inverse[pixel, 2], down) + rounded_product(inverse[pixel, 3], across)
    return u * length, v * length


@compiled(**HELPER)
def piece_at(row, column, block):
    """The number of the piece that covers a pixel of the endless result, and the pixel's row and column in it."""
    return np.uint64(pixel_number(row // block, column // block)), row % block, column % block


@compiled(**HELPER)
def piece_place(bits, row, column, pixel, local, level, exemplar, distortion, pieces, repetition):
    """What a pixel has in a piece from a random place, at the wanted phase.

    Parameters
    ----------
    bits : uint64, random numbers of the piece
    row, column : of the pixel in the piece
    pixel, local : numbers of the pixel among those of ``distortion``, and of the level
    """
    block, rows, pitch, step = pieces.block, exemplar.rows, exemplar.pitch, np.int64(1) << np.int64(level)
    repeats = repetition.phases.shape[0] > 1
    wanted, phases, generators = repetition.wanted, repetition.phases, repetition.generators
    if distortion is None:
        top, bottom, left, right = pieces.core
        height, width = bottom - top, right - left
        high = np.uint64(height if pieces.endless else max(1, height - (block - 1) * step))
        wide = np.uint64(width if pieces.endless else max(1, width - (block - 1) * step))
        r = np.int64((bits >> np.uint64(32)) % high) + row * step
        c = np.int64((bits & np.uint64(0xFFFFFFFF)) % wide) + column * step
        if pieces.endless:
            r, c = r % height, c % width
        r, c = top + min(r, height - 1), left + min(c, width - 1)
        if repeats:
            at = r * pitch + c
            i, j = phase_offset(wanted[local, 0], wanted[local, 1], phases[at, 0], phases[at, 1], generators)
            r, c = r + (i + PIXEL // 2) // PIXEL, c + (j + PIXEL // 2) // PIXEL
            r, c = min(max(r, 0), rows - 1), min(max(c, 0), pitch - 1)
        return snap(r * pitch + c, level * rows * pitch, exemplar, distortion)
    sampled = sampled_level(level, pixel, distortion)
    base, length = sampled * rows * pitch, np.int64(1) << sampled
    begin = np.int64(pieces.starts[np.int64((bits >> np.uint64(32)) % np.uint64(pieces.starts.size))])
    # a step at a time: beyond the region a piece goes on at the most similar place
    position = snap((begin // pitch * PIXEL << 32) | begin % pitch * PIXEL, base, exemplar, distortion)
    down, across = np.int64(row - block // 2), np.int64(column - block // 2)
    for number in range(abs(down) + abs(across)):
        first = number < abs(down)
        u = np.float32((1 if down > 0 else -1) if first else 0)
        v = np.float32(0 if first else (1 if across > 0 else -1))
        u, v = to_texture(u, v, pixel, length, distortion)
        position = snap(advect(position, u, v, distortion.jacobian, pitch, rows), base, exemplar, distortion)
    if repeats:
        at = place_of(position, pitch)
        i, j = phase_offset(wanted[local, 0], wanted[local, 1], phases[at, 0], phases[at, 1], generators)
        position = advect(position, i / PIXEL, j / PIXEL, distortion.jacobian, pitch, rows)
        position = snap(position, base, exemplar, distortion)
    return position


@compiled(**HELPER)
def child(parent, row, column, pixel, level, amplitude, key, exemplar, distortion):
    """What a pixel takes over from its parent in the next coarser level, with jitter.

    ``amplitude`` is the greatest jitter in 2**-16 px, of texture where that is distorted.
    """
    rows, pitch = exemplar.rows, exemplar.pitch
    bits = random_bits(key, np.uint64(pixel_number(row, column)), 0)
    # rounded, with halves up
    jitter_down = ((np.int64(bits >> np.uint64(32)) - 2**31) * amplitude + 2**46) >> 47
    jitter_across = ((np.int64(bits & np.uint64(0xFFFFFFFF)) - 2**31) * amplitude + 2**46) >> 47
    sampled = sampled_level(level, pixel, distortion)
    base, length = sampled * rows * pitch, np.int64(1) << sampled
    if distortion is None:
        down = ((row & 1) * 2 - 1) * length // 2 if length > 1 else (row & 1) - 1
        across = ((column & 1) * 2 - 1) * length // 2 if length > 1 else (column & 1) - 1
        place = snap(parent + down * pitch + across, base, exemplar, distortion)
        return snap(place + jitter_down * pitch + jitter_across, base, exemplar, distortion)
    middle = np.float32(0.5) if level > 0 else np.float32(1)
    u, v = to_texture(np.float32(row & 1) - middle, np.float32(column & 1) - middle, pixel, length, distortion)
    position = snap(advect(parent, u, v, distortion.jacobian, pitch, rows), base, exemplar, distortion)
    u, v = np.float32(jitter_down), np.float32(jitter_across)
    return snap(advect(position, u, v, distortion.jacobian, pitch, rows), base, exemplar, distortion)


@compiled(**HELPER)
def set_offsets(around, pixel, length, distortion):
    """Fill the offsets to a pixel's neighbours in distorted texture, and which of them lies in each direction."""
    a, b = distortion.inverse[pixel, 0], distortion.inverse[pixel, 1]
    c, d = distortion.inverse[pixel, 2], distortion.inverse[pixel, 3]
    sign = np.float32(1) if rounded_product(a, d) > rounded_product(b, c) else np.float32(-1)
    for u in range(8):
        e, f = np.float32(rows_to(u)), np.float32(columns_to(u))  # products with -1, 0 and 1 are exact
        around.down[u], around.across[u] = (a * e + b * f) * length, (c * e + d * f) * length
        # the direction, by the inverse of the inverse up to a positive factor
        down, across = sign * (d * e - b * f), sign * (a * f - c * e)
        most = max(abs(down), abs(across))
        around.facing[u] = u
        if most > 0:
            to = (np.int64(round(down / most)) + 1) * 3 + np.int64(round(across / most)) + 1
            around.facing[u] = to if to < 4 else to - 1


@compiled(**HELPER)
def from_neighbour(stored, u, length, around, exemplar, distortion):
    """What continues, at a pixel, a place or position ``stored`` at its neighbour ``u``."""
    if distortion is None:
        return stored - (rows_to(u) * exemplar.pitch + columns_to(u)) * length
    return advect(stored, -around.down[u], -around.across[u], distortion.jacobian, exemplar.pitch, exemplar.rows)


@compiled(**HELPER)
def predict(around, own, length, exemplar, distortion):
    """Fill what the neighbours predict; whether all predict the pixel's own."""
    same = True
    for u in range(8):
        around.predicted[u] = from_neighbour(around.stored[u], u, length, around, exemplar, distortion)
        same = same and around.predicted[u] == own
    return same


@compiled(**HELPER)
def agreeing(stored, around, distortion):
    """How many neighbours predict a place, or nearly a position."""
    count = np.int64(0)
    for u in range(8):
        if distortion is None:
            count += np.int64(around.predicted[u] == stored)
        else:
            count += np.int64(agree(around.predicted[u], stored))
    return count


@compiled(**HELPER)
def place_beside(i, length, around, exemplar, distortion):
    """The place in direction ``i`` of the texture, from the neighbour that lies there."""
    if distortion is None:
        return around.stored[i]
    u = around.facing[i]
    position = around.stored[u]
    down = np.float32(rows_to(i) * length) - around.down[u]
    across = np.float32(columns_to(i) * length) - around.across[u]
    if down != 0 or across != 0:
        position = advect(position, down, across, distortion.jacobian, exemplar.pitch, exemplar.rows)
    return place_of(position, exemplar.pitch)


@compiled(**HELPER)
def similar(stored, k, base, exemplar, distortion):
    """Candidate ``k`` of a place, or the position in it with the same fractions of a pixel."""
    if distortion is None:
        return np.int64(exemplar.candidates[base + stored, k])
    to = np.int64(exemplar.candidates[base + place_of(stored, exemplar.pitch), k])
    return transfer(stored, to, exemplar.pitch)
