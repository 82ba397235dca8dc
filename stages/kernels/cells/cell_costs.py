"""How well places of an exemplar fit around cells of a result."""

import numpy as np

from texloom.stages.kernels.core.compiled import compiled

_WORSE = 2.0  # times the least cost, from which on a shift is not compared to the end


@compiled
def fit_cells(lab, places, points, weights, wanted, ends, shifts, factors, tried, jitter, first, last, costs, best):
    """Fill ``costs`` with the least weighted squared difference of each shift, and ``best`` with its jitter.

    Parameters
    ----------
    lab : (h, w, 3) float32
    places : (h, w) bool, which pixels may be sources
    points : (n, 2) int64, row and column of the pixels that count
    weights : (n,) float32
    wanted : (n, 3) float32, their colours
    ends : (cells + 1,) int64, where the points of each cell begin
    shifts : (m, 2) int64, displacements
    factors : (m,) float64, on their costs
    tried : (cells + 1,) int64, where the shifts of each cell begin
    jitter : (k, 2) int64, small displacements of each, the first of equal ones wins
    costs : (m,) float64, infinite where a source may not be used
    best : (m,) int64
    """
    for cell in range(first, last):
        least = np.inf
        for index in range(tried[cell], tried[cell + 1]):
            costs[index] = np.inf
            for move in range(len(jitter)):
                down, across = shifts[index, 0] + jitter[move, 0], shifts[index, 1] + jitter[move, 1]
                limit = min(costs[index], _WORSE * least) / factors[index]
                cost = _difference(
                    lab, places, points, weights, wanted, ends[cell], ends[cell + 1], down, across, limit
                )
                if cost < limit:
                    costs[index] = cost * factors[index]
                    best[index] = move
                    least = min(least, costs[index])


@compiled
def _difference(lab, places, points, weights, wanted, first, last, down, across, limit):
    """Of the points first..last; infinite from ``limit`` on."""
    height, width = lab.shape[:2]
    cost = 0.0
    for point in range(first, last):
        y, x = points[point, 0] + down, points[point, 1] + across
        if y < 0 or x < 0 or y >= height or x >= width or not places[y, x]:
            return np.inf
        square = 0.0
        for channel in range(3):
            difference = np.float64(lab[y, x, channel]) - np.float64(wanted[point, channel])
            square += difference * difference
        cost += weights[point] * square
        if cost >= limit:
            return np.inf
    return cost
