"""Rectangles of several sizes in one image."""

import math
from collections.abc import Callable

import numpy as np

from texloom.stages.common.similarity.neighbourhoods import Rectangles


def arranged(
    sizes: list[tuple[int, int]], gap: int, moved: Callable[[int, int, int], tuple[int, int]] | None = None
) -> tuple[Rectangles, tuple[int, int]]:
    """Rectangles in rows, in the order of ``sizes``, and the size of the atlas.

    Parameters
    ----------
    moved : the row and column of a rectangle, given its number and the least row and column it may have.
    """
    area = sum(height * width for height, width in sizes)
    across = max(math.isqrt(area), *(width for _, width in sizes))
    placed: list[tuple[int, int, int, int]] = []
    row, column, below = 0, 0, 0
    for number, (height, width) in enumerate(sizes):
        if column and column + width > across:
            row, column = below + gap, 0
        top, left = (row, column) if moved is None else moved(number, row, column)
        placed.append((top, left, height, width))
        below, column = max(below, top + height), left + width + gap
    rectangles = np.array(placed, np.int32)
    return rectangles, (below, int((rectangles[:, 1] + rectangles[:, 3]).max()))
