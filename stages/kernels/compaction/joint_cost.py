"""What is visible where a piece of a texture meets what stands."""

from __future__ import annotations

import numba
import numpy as np


@numba.njit(cache=True, nogil=True)
def weighted_differences(planes, pieces, stands, weights, totals):
    """Sum over the pixels of each piece of the squared difference from what stands there, by the pixel's weight.

    Parameters
    ----------
    planes : (h, w, c) float32, the texture
    pieces : (n, 2, p, q) int32, rows and columns of the texture pixels of each piece
    stands : (p, q, c) float32
    weights : (p, q) float64; pixels of no weight are not read
    totals : (n,) float64, output
    """
    height, width, channels = stands.shape
    for piece in range(pieces.shape[0]):
        total = 0.0
        for y in range(height):
            for x in range(width):
                if weights[y, x] == 0:
                    continue
                row, column = pieces[piece, 0, y, x], pieces[piece, 1, y, x]
                far = np.float32(0)
                for k in range(channels):
                    difference = planes[row, column, k] - stands[y, x, k]
                    far += difference * difference
                total += weights[y, x] * far
        totals[piece] = total
