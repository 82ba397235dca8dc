"""Gaussian blur along the directions of a texture that is distorted."""

import math

import numba
import numpy as np

_SIDE = 6  # samples on each side of the middle, half a standard deviation apart


@numba.njit(cache=True, nogil=True)
def blur_along(planes, jacobian, valid, sigma, axis, out, first, last):
    """Fill rows ``first`` to ``last`` of ``out``: a Gaussian mean along the line of the texture through each pixel.

    A line follows the nearest pixels' Jacobians by the midpoint rule and ends at pixels that are not valid.

    Parameters
    ----------
    planes : (h, w, c) float32
    jacobian : (h, w, 4) float32, from texture to px
    valid : (h, w) bool
    sigma : (h, w) float32, standard deviation in units of texture; 0 for no blur
    axis : 0 down the texture, 1 across
    out : (h, w, c) float32, output
    """
    height, width, channels = planes.shape
    for y in range(first, last):
        for x in range(width):
            for c in range(channels):
                out[y, x, c] = planes[y, x, c]
            if sigma[y, x] <= 0 or not valid[y, x]:
                continue
            step = 0.5 * sigma[y, x]
            weight = 1.0
            for side in (-1.0, 1.0):
                row, column = np.float64(y), np.float64(x)
                at_row, at_column = y, x
                for number in range(1, _SIDE + 1):
                    half_row = row + side * 0.5 * step * jacobian[at_row, at_column, axis]
                    half_column = column + side * 0.5 * step * jacobian[at_row, at_column, 2 + axis]
                    at_row, at_column = round(half_row), round(half_column)
                    if at_row < 0 or at_row >= height or at_column < 0 or at_column >= width:
                        break
                    row += side * step * jacobian[at_row, at_column, axis]
                    column += side * step * jacobian[at_row, at_column, 2 + axis]
                    at_row, at_column = round(row), round(column)
                    if at_row < 0 or at_row >= height or at_column < 0 or at_column >= width:
                        break
                    if not valid[at_row, at_column]:
                        break
                    share = math.exp(-0.125 * number * number)
                    top, left = min(max(math.floor(row), 0), height - 2), min(max(math.floor(column), 0), width - 2)
                    p, q = min(max(row - top, 0.0), 1.0), min(max(column - left, 0.0), 1.0)
                    for c in range(channels):
                        upper = (1 - q) * planes[top, left, c] + q * planes[top, left + 1, c]
                        lower = (1 - q) * planes[top + 1, left, c] + q * planes[top + 1, left + 1, c]
                        out[y, x, c] += share * ((1 - p) * upper + p * lower)
                    weight += share
            for c in range(channels):
                out[y, x, c] /= weight
