"""Visibility of the joints between a piece of a texture and the already synthesised region."""

import numpy as np

from texloom.stages.kernels.core.compiled import compiled


@compiled
def weighted_differences(planes, pieces, region, weights, totals):
    """Sum over the pixels of each piece of the squared difference from the already synthesised region, weighted.

    Parameters
    ----------
    planes : (h, w, c) float32, the texture
    pieces : (n, 2, p, q) int32, rows and columns of the texture pixels of each piece
    region : (p, q, c) float32, already synthesised
    weights : (p, q) float64; pixels of weight 0 are not read
    totals : (n,) float64, output
    """
    height, width, channels = region.shape
    for piece in range(pieces.shape[0]):
        total = 0.0
        for y in range(height):
            for x in range(width):
                if weights[y, x] == 0:
                    continue
                row, column = pieces[piece, 0, y, x], pieces[piece, 1, y, x]
                squares = np.float32(0)
                for k in range(channels):
                    difference = planes[row, column, k] - region[y, x, k]
                    squares += difference * difference
                total += weights[y, x] * squares
        totals[piece] = total
