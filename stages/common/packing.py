"""Rectangles of several sizes in one image."""

import math

import numpy as np

from texloom.stages.common.neighbourhoods import Rectangles


def arranged(sizes: list[tuple[int, int]], gap: int) -> tuple[Rectangles, tuple[int, int]]:
    """Rectangles in rows, in the order of ``sizes``, and the size of the atlas."""
    area = sum(height * width for height, width in sizes)
    across = max(math.isqrt(area), *(width for _, width in sizes))
    placed: list[tuple[int, int, int, int]] = []
    row, column, below = 0, 0, 0
    for height, width in sizes:
        if column and column + width > across:
            row, column = below + gap, 0
        placed.append((row, column, height, width))
        below, column = max(below, row + height), column + width + gap
    rectangles = np.array(placed, np.int32)
    return rectangles, (below, int((rectangles[:, 1] + rectangles[:, 3]).max()))
