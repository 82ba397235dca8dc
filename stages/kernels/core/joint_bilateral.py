"""Means over pixels that are near, and alike in another picture."""

import numpy as np

from texloom.stages.kernels.core.compiled import compiled


@compiled
def joint_bilateral(values, guide, offsets, near, alike, per_unit, out, first, last):
    """Fill rows ``first`` to ``last`` of ``out`` with weighted means of ``values`` around each pixel.

    Parameters
    ----------
    values : (2, H, W) float32, with what is beyond the border
    guide : (3, H, W) float32
    offsets : (n, 2) int64, rows and columns from a pixel of ``out`` to those that count
    near : (n,) float32, the weights of their distances
    alike : (m,) float32, weights of differences in the guide: of the square of the sum of those of its channels,
        ``per_unit`` of them a unit; linear in between, that before the last beyond
    out : (2, h, w) float32
    """
    height, width = out.shape[1:]
    margin = (guide.shape[1] - height) // 2
    beyond = np.float32(alike.size - 2)
    total = np.empty(width, np.float32)
    for y in range(first, last):
        total[:] = 0
        out[:, y] = 0
        for k in range(offsets.shape[0]):
            row, step = y + offsets[k, 0], offsets[k, 1]
            for x in range(width):
                difference = abs(guide[0, row, x + step] - guide[0, y + margin, x + margin])
                difference += abs(guide[1, row, x + step] - guide[1, y + margin, x + margin])
                difference += abs(guide[2, row, x + step] - guide[2, y + margin, x + margin])
                at = min(difference * difference * per_unit, beyond)
                lower = np.int32(at)
                weight = alike[lower] + (at - np.float32(lower)) * (alike[lower + 1] - alike[lower])
                weight *= near[k]
                total[x] += weight
                out[0, y, x] += weight * values[0, row, x + step]
                out[1, y, x] += weight * values[1, row, x + step]
        out[0, y] /= total
        out[1, y] /= total
