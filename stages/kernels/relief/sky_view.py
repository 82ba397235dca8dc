"""How much of the sky points of a height map see."""

import math

import numpy as np

from texloom.stages.kernels.core.compiled import compiled


@compiled
def fill_sky_view(heights, places, distances, margin, out, first, last):
    """Fill rows ``first`` to ``last`` of ``out``: the share of a uniform sky's light that a level point receives.

    It is the mean over directions of the squared cosine of the horizon's elevation; the horizon is the steepest
    line to a sample. Between pixels heights are linear.

    Parameters
    ----------
    heights : (h + 2 * margin, w + 2 * margin) float32, px
    places : (n, m, 2) float64, px down and across to each sample of each direction
    distances : (m,) float64, px, of the samples
    margin : px of ``heights`` on every side of ``out``, at least 1 more than samples are away
    out : (h, w) float32, output
    """
    width = out.shape[1]
    steepest = np.empty(width, np.float32)
    for y in range(first, last):
        for x in range(width):
            out[y, x] = 0
        own = heights[y + margin, margin : margin + width]
        for k in range(places.shape[0]):
            for x in range(width):
                steepest[x] = 0
            for m in range(distances.size):
                down, across = places[k, m, 0], places[k, m, 1]
                top, left = math.floor(down), math.floor(across)
                p, q = np.float32(down - top), np.float32(across - left)
                before, after, nearness = np.float32(1) - q, q, np.float32(1 / distances[m])
                row, column = y + margin + int(top), margin + int(left)
                upper, lower = heights[row, column:], heights[row + 1, column:]
                for x in range(width):
                    one = upper[x] * before + upper[x + 1] * after
                    other = lower[x] * before + lower[x + 1] * after
                    slope = (one * (np.float32(1) - p) + other * p - own[x]) * nearness
                    steepest[x] = max(steepest[x], slope)
            for x in range(width):
                out[y, x] += np.float32(1) / (np.float32(1) + steepest[x] * steepest[x])
        for x in range(width):
            out[y, x] /= np.float32(places.shape[0])
