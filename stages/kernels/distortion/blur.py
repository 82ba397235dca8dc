"""Gaussian blur along the directions of a texture that is distorted."""

import math

import numpy as np

from texloom.stages.kernels.core.compiled import compiled

_SPACING = 0.75  # standard deviations between samples
_SIDE = 4  # samples on each side of the middle
_SHARES = tuple(math.exp(-0.5 * (_SPACING * number) ** 2) for number in range(_SIDE + 1))


@compiled
def blur_along(planes, jacobian, valid, sigma, axis, out, first, last):
    """Fill rows ``first`` to ``last`` of ``out``: a Gaussian mean along the line of the texture through each pixel.

    From one sample to the next a line follows the Jacobian half-way, as far as the last one reaches; it ends at
    pixels that are not valid.

    Parameters
    ----------
    planes : (h, w, 3) float32
    jacobian : (h, w, 4) float32, from texture to px
    valid : (h, w) bool
    sigma : (h, w) float32, standard deviation in units of texture; 0 for no blur
    axis : 0 down the texture, 1 across
    out : (h, w, 3) float32, output
    """
    height, width, _ = planes.shape
    for y in range(first, last):
        for x in range(width):
            if sigma[y, x] <= 0 or not valid[y, x]:
                for c in range(3):
                    out[y, x, c] = planes[y, x, c]
                continue
            red, green, blue = planes[y, x, 0], planes[y, x, 1], planes[y, x, 2]
            weight = 1.0
            for side in range(-1, 2, 2):
                half = 0.5 * side * _SPACING * sigma[y, x]
                row, column = np.float64(y), np.float64(x)
                half_row, half_column = half * jacobian[y, x, axis], half * jacobian[y, x, 2 + axis]
                for number in range(1, _SIDE + 1):
                    at_row, at_column = math.floor(row + half_row + 0.5), math.floor(column + half_column + 0.5)
                    if not (0 <= at_row < height and 0 <= at_column < width):
                        break
                    half_row = half * jacobian[at_row, at_column, axis]
                    half_column = half * jacobian[at_row, at_column, 2 + axis]
                    row += 2 * half_row
                    column += 2 * half_column
                    at_row, at_column = math.floor(row + 0.5), math.floor(column + 0.5)
                    if not (0 <= at_row < height and 0 <= at_column < width and valid[at_row, at_column]):
                        break
                    share = _SHARES[number]
                    top, left = min(max(int(row), 0), height - 2), min(max(int(column), 0), width - 2)
                    p, q = min(max(row - top, 0.0), 1.0), min(max(column - left, 0.0), 1.0)
                    above, below = np.float32(share * (1 - p)), np.float32(share * p)
                    a, b = above * np.float32(1 - q), above * np.float32(q)
                    d, e = below * np.float32(1 - q), below * np.float32(q)
                    first_row, first_column = np.uint64(top), np.uint64(left)
                    next_row, next_column = np.uint64(top + 1), np.uint64(left + 1)
                    one, two = planes[first_row, first_column], planes[first_row, next_column]
                    three, four = planes[next_row, first_column], planes[next_row, next_column]
                    red += a * one[0] + b * two[0] + d * three[0] + e * four[0]
                    green += a * one[1] + b * two[1] + d * three[1] + e * four[1]
                    blue += a * one[2] + b * two[2] + d * three[2] + e * four[2]
                    weight += share
            out[y, x, 0], out[y, x, 1], out[y, x, 2] = red / weight, green / weight, blue / weight
