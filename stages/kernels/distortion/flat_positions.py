"""Positions in a photograph of the pixels of its flat texture."""

import numpy as np

from texloom.stages.kernels.core.compiled import compiled
from texloom.stages.kernels.core.resample import add_sample


@compiled
def find_positions(chart, jacobian, sharp, steps, most, position, shown, first, last):
    """Improve rows ``first`` to ``last`` of ``position`` by Newton's method.

    Parameters
    ----------
    chart : (h, w, 2) float64, row and column in the flat texture of each pixel of the photograph
    jacobian : (h, w, 4) float32, from texture to px of the photograph
    sharp : (h, w) bool, pixels that show the texture
    steps : of the method
    most : elements between a pixel and what is shown there
    position : (rows, columns, 2) float64, row and column in the photograph; a start, and the output
    shown : (rows, columns) bool, output: whether the photograph shows the pixel
    """
    height, width = sharp.shape
    there = np.empty(2)
    for y in range(first, last):
        for x in range(position.shape[1]):
            row, column = position[y, x]
            for step in range(steps + 1):
                there[:] = 0.0
                add_sample(chart, row, column, 1.0, there)
                down, across = y - there[0], x - there[1]
                at_row, at_column = round(row), round(column)
                if step < steps:
                    a, b, c, d = jacobian[at_row, at_column]
                    row = min(max(row + (a * down + b * across), 0.0), height - 1.0)
                    column = min(max(column + (c * down + d * across), 0.0), width - 1.0)
                else:
                    shown[y, x] = sharp[at_row, at_column] and abs(down) < most and abs(across) < most
            position[y, x, 0], position[y, x, 1] = row, column
