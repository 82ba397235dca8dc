"""Where in an exemplar a cell looks like a given one, at the pixels that count."""

import numpy as np

from texloom.stages.kernels.core.compiled import compiled


@compiled
def search_cells(
    lab, forbidden, points, weights, wanted, ends, boxes, bases, offsets, taken, first, last, found, costs
):
    """Fill ``found`` with the displacement of least weighted squared difference of each cell first..last.

    Tried are ``bases`` of the cell plus each of ``offsets``, the first of equal ones wins. Places at which the box
    of the cell leaves the exemplar or contains forbidden pixels are left out; those that overlap the middle of a
    taken place cost twice as much, since the same cell would return side by side.

    Parameters
    ----------
    lab : (h, w, 3) float32
    forbidden : (h + 1, w + 1) int64, number of forbidden pixels above and to the left
    points : (n, 2) int64, row and column of the pixels that count
    weights : (n,) float32
    wanted : (n, 3) float32, their colours
    ends : (cells + 1,) int64, where the points of each cell begin
    boxes : (cells, 4) int64, first row and column, last ones + 1
    bases : (cells, 2) int64
    offsets : (m, 2) int64
    taken : (cells, k, 2) int64, displacements that would show the same as a neighbour
    found : (cells, 2) int64, unchanged where no place is left
    costs : (cells,) float64, of ``found``; infinite where no place is left
    """
    height, width = lab.shape[:2]
    for cell in range(first, last):
        best = np.inf
        top, left, bottom, right = boxes[cell]
        for offset in range(len(offsets)):
            down, across = bases[cell, 0] + offsets[offset, 0], bases[cell, 1] + offsets[offset, 1]
            y0, x0, y1, x1 = top + down, left + across, bottom + down, right + across
            if y0 < 0 or x0 < 0 or y1 > height or x1 > width:
                continue
            if forbidden[y1, x1] - forbidden[y0, x1] - forbidden[y1, x0] + forbidden[y0, x0] > 0:
                continue
            factor = 1.0
            for other in range(taken.shape[1]):
                if (
                    abs(down - taken[cell, other, 0]) * 2 < y1 - y0
                    and abs(across - taken[cell, other, 1]) * 2 < x1 - x0
                ):
                    factor = 2.0
            cost = 0.0
            for point in range(ends[cell], ends[cell + 1]):
                y, x = points[point, 0] + down, points[point, 1] + across
                square = 0.0
                for channel in range(3):
                    difference = np.float64(lab[y, x, channel]) - np.float64(wanted[point, channel])
                    square += difference * difference
                cost += weights[point] * square * factor
                if cost >= best:
                    break
            if cost < best:
                best = cost
                found[cell, 0], found[cell, 1] = down, across
        costs[cell] = best
