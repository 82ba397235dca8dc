"""Means over squares of pixels."""

import numpy as np

from texloom.stages.kernels.core.compiled import compiled


@compiled(error_model="numpy")
def fill_means(planes, step, means):
    """Fill ``means``, (p, q, c) float32, with those over squares of ``step`` px of ``planes``, (h, w, c)."""
    pixels = np.float32(step * step)
    for y in range(means.shape[0]):
        for x in range(means.shape[1]):
            for channel in range(means.shape[2]):
                total = np.float32(0)
                for row in range(y * step, (y + 1) * step):
                    for column in range(x * step, (x + 1) * step):
                        total += planes[row, column, channel]
                means[y, x, channel] = total / pixels
