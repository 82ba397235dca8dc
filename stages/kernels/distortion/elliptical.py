"""Elliptical weighted average: pixels of a picture under the footprints of distorted pixels."""

import math

import numpy as np

from texloom.stages.kernels.core.compiled import compiled, inner
from texloom.stages.kernels.core.elementary_functions import sin

_LARGEST = 256.0  # px of a footprint's axis
_SUPPORT = 3.0  # px, of Lanczos' kernel
_PER_UNIT = 1024  # entries of the tables
_NARROW = 0.05  # px; a narrower mean is none

_PLACES = np.arange(_SUPPORT * _PER_UNIT + 2) / _PER_UNIT
_ANGLES = np.pi * np.maximum(_PLACES, 1e-9)
_LANCZOS = _SUPPORT * sin(_ANGLES) * sin(_ANGLES / _SUPPORT) / _ANGLES**2
_LANCZOS[-2:] = 0
_INTEGRAL = np.append(0, np.cumsum(_LANCZOS[1:] + _LANCZOS[:-1]))
_INTEGRAL /= 2 * _INTEGRAL[-1]


@compiled
def _entry(table, t):
    """A table's value at ``t``, 0 or more; beyond it the last."""
    place = min(t, _SUPPORT) * _PER_UNIT
    index = np.int64(place)
    share = place - index
    return (1 - share) * table[index] + share * table[index + 1]


@compiled
def _weight(t, width):
    """Lanczos' kernel at ``t`` px, averaged over a ``width``."""
    if width < _NARROW:
        return _entry(_LANCZOS, abs(t))
    before, after = t - width / 2, t + width / 2
    first = math.copysign(_entry(_INTEGRAL, abs(before)), before)
    return (math.copysign(_entry(_INTEGRAL, abs(after)), after) - first) / width


@inner
def _footprint(a, b, c, d):
    """Entries of the symmetric matrix whose ellipse is that of [[a, b], [c, d]], with axes of at least a px."""
    p, q, r = a * a + b * b, a * c + b * d, c * c + d * d
    middle, spread = (p + r) / 2, math.sqrt((p - r) * (p - r) / 4 + q * q)
    major, minor = middle + spread, middle - spread
    long = min(max(math.sqrt(major), 1.0), _LARGEST)
    short = min(max(math.sqrt(max(minor, 0.0)), 1.0), _LARGEST)
    share = (long - short) / (2 * spread) if long > short else 0.0
    return short + share * (p - minor), share * q, short + share * (r - minor)


@compiled
def sample_ellipses(pixels, usable, positions, footprints, out):
    """Fill ``out`` with the picture at ``positions``, each a mean under its footprint.

    Where a footprint is larger than a pixel of the picture, Lanczos' interpolation is averaged over it; other
    places are interpolated. So undistorted pixels hardly lose contrast, and reduced ones are means over their area.
    Values are kept within those nearest to the middle, since the kernel overshoots. Where none of those is usable,
    the nearest pixel is taken.

    Parameters
    ----------
    pixels : (h, w, c) float32
    usable : (h, w) bool, the pixels that count
    positions : (n, 2) float64, px, row before column
    footprints : (n, 4) float64, derivatives of the picture's row by the result's row and column, and of its column
    out : (n, c) float32
    """
    height, width, channels = pixels.shape
    total, positive = np.empty(channels), np.empty(channels)
    low, high = np.empty(channels), np.empty(channels)
    for index in range(positions.shape[0]):
        row = min(max(positions[index, 0], 0.0), height - 1.0)
        column = min(max(positions[index, 1], 0.0), width - 1.0)
        f = footprints[index]
        p, q, r = _footprint(f[0], f[1], f[2], f[3])
        determinant = p * r - q * q
        # px per unit of the footprint's coordinates, widths of means, and the kernel's reach in these coordinates
        tall, wide = math.hypot(p, q), math.hypot(r, q)
        tall_width, wide_width = math.sqrt(max(tall * tall - 1, 0.0)), math.sqrt(max(wide * wide - 1, 0.0))
        reach_s, reach_t = (_SUPPORT + tall_width / 2) / tall, (_SUPPORT + wide_width / 2) / wide
        down, across = reach_s * p + reach_t * abs(q), reach_s * abs(q) + reach_t * r
        weight, positive_weight, inside = 0.0, 0.0, False
        total[:], positive[:], low[:], high[:] = 0.0, 0.0, np.inf, -np.inf
        for y in range(max(0, math.ceil(row - down)), min(height, math.floor(row + down) + 1)):
            for x in range(max(0, math.ceil(column - across)), min(width, math.floor(column + across) + 1)):
                if not usable[y, x]:
                    continue
                s = (r * (y - row) - q * (x - column)) / determinant
                t = (p * (x - column) - q * (y - row)) / determinant
                share = _weight(s * tall, tall_width) * _weight(t * wide, wide_width)
                weight += share
                positive_weight += max(share, 0.0)
                for k in range(channels):
                    total[k] += share * pixels[y, x, k]
                    positive[k] += max(share, 0.0) * pixels[y, x, k]
                if abs(s) < 1.0 and abs(t) < 1.0:
                    inside = True
                    for k in range(channels):
                        low[k], high[k] = min(low[k], pixels[y, x, k]), max(high[k], pixels[y, x, k])
        if not inside:
            out[index] = pixels[round(row), round(column)]
            continue
        for k in range(channels):
            # beside unusable pixels the weights may cancel
            whole = weight > 0.5 * determinant / (tall * wide)
            value = total[k] / weight if whole else positive[k] / positive_weight
            out[index, k] = min(max(value, low[k]), high[k])
