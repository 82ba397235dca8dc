"""The control of a result at every level: means of 2x2 pixels, and integers to compare with."""

import numpy as np

from texloom.stages.kernels.core.compiled import compiled


@compiled
def halve(fine, coarse, left, right, top, bottom):
    """Fill rows ``top`` to ``bottom`` and columns ``left`` to ``right`` of the next coarser level.

    Parameters
    ----------
    fine : (H, W, k) float32; the last row and column count twice where a side is odd
    coarse : (ceil(H / 2), ceil(W / 2), k) float32, output
    """
    height, width, planes = fine.shape
    for y in range(top, bottom):
        low, high = 2 * y, min(2 * y + 1, height - 1)
        for x in range(left, right):
            near, far = 2 * x, min(2 * x + 1, width - 1)
            for k in range(planes):
                total = (fine[low, near, k] + fine[low, far, k]) + (fine[high, near, k] + fine[high, far, k])
                coarse[y, x, k] = np.float32(0.25) * total


@compiled
def place_control(planes, given, origin_row, origin_column, strength, left, right, top, bottom):
    """Fill rows ``top`` to ``bottom`` and columns ``left`` to ``right`` of the control given to a level.

    Parameters
    ----------
    planes : (H, W, k) float32, 0..1; its border is repeated beyond it
    given : (rows, columns, at least k) int16, output; its pixel (0, 0) is (``origin_row``, ``origin_column``)
    strength : float32, the integer that 1 becomes
    """
    height, width, count = planes.shape
    for y in range(top, bottom):
        row = min(max(y + origin_row, 0), height - 1)
        for x in range(left, right):
            column = min(max(x + origin_column, 0), width - 1)
            for k in range(count):
                given[y, x, k] = np.int16(np.rint(planes[row, column, k] * strength))
