"""Bilinear enlargement along the borders of control."""

import numpy as np

from texloom.stages.kernels.core.compiled import compiled

_LEAST = 0.01  # weight of each of four, beside that of its distance: one of other control counts least
_ALIKE = 100.0  # of a squared difference of control: at a tenth of its range a weight is a quarter of its most


@compiled
def enlarge(coarse, own, wrap, planes, count, left, right, top, bottom):
    """Fill rows ``top`` to ``bottom`` and columns ``left`` to ``right``, each pixel from the nearest coarse ones.

    Parameters
    ----------
    coarse, own : (h, w, c) and (h, w, count) float32, what is enlarged, and its control, 0..1
    wrap : two bools, whether rows and columns continue across the border
    planes : (H, W, count + c) float32: control, 0..1, and behind it the output
    """
    height, width, channels = coarse.shape
    rows, columns = planes.shape[:2]
    sums = np.empty(channels)
    for y in range(top, bottom):
        down = (y + 0.5) * height / rows - 0.5
        above = int(np.floor(down))
        for x in range(left, right):
            across = (x + 0.5) * width / columns - 0.5
            before = int(np.floor(across))
            sums[:] = 0.0
            total = 0.0
            for i in range(2):
                row = above + i
                row = row % height if wrap[0] else min(max(row, 0), height - 1)
                for j in range(2):
                    column = before + j
                    column = column % width if wrap[1] else min(max(column, 0), width - 1)
                    unlike = 0.0
                    for k in range(count):
                        difference = float(planes[y, x, k]) - float(own[row, column, k])
                        unlike += difference * difference
                    near = (1.0 - abs(down - (above + i))) * (1.0 - abs(across - (before + j)))
                    weight = (near + _LEAST) / (1.0 + _ALIKE * unlike) ** 2
                    total += weight
                    for c in range(channels):
                        sums[c] += weight * coarse[row, column, c]
            for c in range(channels):
                planes[y, x, count + c] = np.float32(sums[c] / total)
