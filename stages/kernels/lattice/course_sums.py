"""Sums of a picture over bins across the courses of a wall, each segment of a course by itself."""

import numpy as np

from texloom.stages.kernels.core.compiled import compiled


@compiled
def course_sums(plane, across, along, lowest, bins, segments, sums):
    """Add to ``sums`` every pixel's 1 and value, and what of both belongs to the bin after the pixel's.

    Parameters
    ----------
    plane : (h, w) float32
    across, along : of the rows and of the columns, (h,) and (w,) float64. At a pixel the sum of ``across``, less
        ``lowest[0]``, counts courses; that of ``along``, less ``lowest[1]``, is the distance along them, px
    bins : of a course
    segments : number of them, and of them in 1 px of the distance
    sums : (2, 2, segments, n) float64, output: numbers and values, whole and of the bin after; n is the number of
        courses times ``bins``
    """
    last = segments[0] - 1
    for y in range(plane.shape[0]):
        for x in range(plane.shape[1]):
            place = ((across[0][y] + across[1][x]) - lowest[0]) * bins
            segment = min(np.int64(((along[0][y] + along[1][x]) - lowest[1]) * segments[1]), last)
            slot = np.int64(place)
            share = place - slot
            value = np.float64(plane[y, x])
            sums[0, 0, segment, slot] += 1.0
            sums[0, 1, segment, slot] += share
            sums[1, 0, segment, slot] += value
            sums[1, 1, segment, slot] += share * value
