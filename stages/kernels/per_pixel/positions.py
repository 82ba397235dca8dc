"""Arithmetic on places and positions in an exemplar, for processors and graphics processors alike.

A place is the number of a pixel, row * pitch + column. A position is row << 32 | column in 1/256 px, and stands for
the nearest place.
"""

from __future__ import annotations

import numba
import numpy as np

PIXEL = 256
"""units of a position in a pixel"""
LOW = 2**32 - 1
"""the bits of a position that are its column"""

_NEAR = 192  # positions as near as that agree


@numba.njit(cache=True, nogil=True, inline="always")
def place_of(position, pitch):
    """The place nearest to a position."""
    row, column = ((position >> 32) + PIXEL // 2) // PIXEL, ((position & LOW) + PIXEL // 2) // PIXEL
    return row * pitch + column


@numba.njit(cache=True, nogil=True, inline="always")
def moved(position, down, across, pitch, rows):
    """A position ``down`` and ``across`` px (floats) from another, kept inside the margin."""
    row = (position >> 32) + np.int64(round(down * np.float32(PIXEL)))
    column = (position & LOW) + np.int64(round(across * np.float32(PIXEL)))
    row, column = max(row, 0), max(column, 0)
    return (min(row, (rows - 1) * PIXEL) << 32) | min(column, (pitch - 1) * PIXEL)


@numba.njit(cache=True, nogil=True)
def carried(position, u, v, jacobian, pitch, rows):
    """Where one comes by an offset in the texture, as the Jacobian half the way has it."""
    half = np.float32(0.5)
    j = jacobian[place_of(position, pitch)]
    down, across = j[0] * u + j[1] * v, j[2] * u + j[3] * v
    j = jacobian[place_of(moved(position, half * down, half * across, pitch, rows), pitch)]
    return moved(position, j[0] * u + j[1] * v, j[2] * u + j[3] * v, pitch, rows)


@numba.njit(cache=True, nogil=True, inline="always")
def shifted(position, place, pitch):
    """The same part of the pixel of another place."""
    row = np.int64(np.uint32(place) // np.uint32(pitch))
    part = ((position >> 32) + PIXEL // 2) % PIXEL, ((position & LOW) + PIXEL // 2) % PIXEL
    return (row * PIXEL + part[0] - PIXEL // 2 << 32) + (place - row * pitch) * PIXEL + part[1] - PIXEL // 2


@numba.njit(cache=True, nogil=True, inline="always")
def settled(position, own, pitch):
    """The position itself, or that of its place's home, ``own``, where it has another."""
    if own == place_of(position, pitch):
        return position
    return ((own // pitch * PIXEL) << 32) | (own % pitch * PIXEL)


@numba.njit(cache=True, nogil=True, inline="always")
def agree(one, other):
    """Whether two positions are nearly the same."""
    return abs((one >> 32) - (other >> 32)) <= _NEAR and abs((one & LOW) - (other & LOW)) <= _NEAR


@numba.njit(cache=True, nogil=True, inline="always")
def number_of(row, column):
    """A number for a pixel of the endless result, negative coordinates too."""
    return (np.uint64(row) << np.uint64(32)) ^ (np.uint64(column) & np.uint64(0xFFFFFFFF))


@numba.njit(cache=True, nogil=True, inline="always")
def out_of_step(wanted_down, wanted_across, phase_down, phase_across, generators):
    """The way in texture, 1/256 px, to the nearest place of the wanted phase; see `per_pixel.start`."""
    p = ((np.int64(wanted_down) - np.int64(phase_down) + 2**31) & LOW) - 2**31
    q = ((np.int64(wanted_across) - np.int64(phase_across) + 2**31) & LOW) - 2**31
    return (p * generators[0] + q * generators[2]) >> 32, (p * generators[1] + q * generators[3]) >> 32
