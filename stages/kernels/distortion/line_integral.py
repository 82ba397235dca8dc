"""Line integral convolution: noise averaged along a field, which makes the field visible."""

import numpy as np

from texloom.stages.kernels.core.compiled import compiled


@compiled
def convolve_lines(noise, direction, length, out, first, last):
    """Fill rows ``first`` to ``last`` of ``out`` with the mean of ``noise`` along the field line of each pixel.

    A line goes ``length`` steps of a pixel to either side, through the nearest pixels' directions, and ends at the
    border.

    Parameters
    ----------
    noise : (h, w) float32
    direction : (h, w, 2) float32, unit vectors, down and across; either sign
    out : (h, w) float32, output
    """
    height, width = noise.shape
    for y in range(first, last):
        for x in range(width):
            total, count = np.float64(noise[y, x]), 1
            for side in range(-1, 2, 2):
                row, column = np.float64(y), np.float64(x)
                down, across = side * direction[y, x, 0], side * direction[y, x, 1]
                for _ in range(length):
                    row += down
                    column += across
                    at_row, at_column = round(row), round(column)
                    if at_row < 0 or at_row >= height or at_column < 0 or at_column >= width:
                        break
                    total += noise[at_row, at_column]
                    count += 1
                    next_down, next_across = direction[at_row, at_column, 0], direction[at_row, at_column, 1]
                    sign = -1 if next_down * down + next_across * across < 0 else 1
                    down, across = sign * next_down, sign * next_across
            out[y, x] = total / count
