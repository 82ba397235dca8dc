"""Line integral convolution: noise averaged along a field, which makes the field visible."""

import math

import numba
import numpy as np


@numba.njit(cache=True, nogil=True)
def convolve_lines(noise, angle, length, out, first, last):
    """Fill rows ``first`` to ``last`` of ``out`` with the mean of ``noise`` along the field line of each pixel.

    A line goes ``length`` steps of a pixel to either side, through the nearest pixels' angles, and ends at the
    border.

    Parameters
    ----------
    noise : (h, w) float32
    angle : (h, w) float32, radians, from along a row towards growing rows; modulo pi
    out : (h, w) float32, output
    """
    height, width = noise.shape
    for y in range(first, last):
        for x in range(width):
            total, count = np.float64(noise[y, x]), 1
            for side in range(2):
                row, column = np.float64(y), np.float64(x)
                down, across = math.sin(angle[y, x]), math.cos(angle[y, x])
                if side == 1:
                    down, across = -down, -across
                for _ in range(length):
                    row += down
                    column += across
                    at_row, at_column = round(row), round(column)
                    if at_row < 0 or at_row >= height or at_column < 0 or at_column >= width:
                        break
                    total += noise[at_row, at_column]
                    count += 1
                    next_down, next_across = math.sin(angle[at_row, at_column]), math.cos(angle[at_row, at_column])
                    if next_down * down + next_across * across < 0:
                        next_down, next_across = -next_down, -next_across
                    down, across = next_down, next_across
            out[y, x] = total / count
