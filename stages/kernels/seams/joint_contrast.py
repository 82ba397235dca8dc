"""How much a result differs from what its sources show beside a joint."""

import numpy as np

from texloom.stages.kernels.core.compiled import compiled, inner


@inner
def _jump(exemplar, row, column, result, y, x):
    """Squared difference of a pixel of the exemplar and one of the result."""
    total = np.float32(0)
    for channel in range(exemplar.shape[2]):
        difference = exemplar[row, column, channel] - result[y, x, channel]
        total += difference * difference
    return total


@compiled
def joint_contrast(exemplar, result, match, wraps, contrast, first, last):
    """Set rows ``first`` to ``last`` of ``contrast``.

    Where the lower or right neighbour of a pixel does not come from its source's: the squared difference of the
    neighbour to its source's neighbour, or of the pixel to the one before the neighbour's source, the largest; -1
    where both neighbours are kept. What is outside the exemplar does not count.

    Parameters
    ----------
    exemplar, result : (h, w, c), (H, W, c) float32
    match : (H, W, 2) unsigned int, sources
    wraps : texloom.stages.vocabulary.facts.Wraps, of the result
    contrast : (H, W) float32
    """
    height, width = match.shape[0], match.shape[1]
    for row in range(first, last):
        for column in range(width):
            largest = np.float32(-1)
            for down in range(2):
                right = 1 - down
                if (row + down == height and not wraps.down) or (column + right == width and not wraps.across):
                    continue
                beside_row, beside_column = (row + down) % height, (column + right) % width
                after_row, after_column = match[row, column, 0] + down, match[row, column, 1] + right
                source_row, source_column = match[beside_row, beside_column, 0], match[beside_row, beside_column, 1]
                if source_row == after_row and source_column == after_column:
                    continue
                largest = max(largest, np.float32(0))
                if after_row < exemplar.shape[0] and after_column < exemplar.shape[1]:
                    jump = _jump(exemplar, after_row, after_column, result, beside_row, beside_column)
                    largest = max(largest, jump)
                if source_row >= down and source_column >= right:
                    jump = _jump(exemplar, source_row - down, source_column - right, result, row, column)
                    largest = max(largest, jump)
            contrast[row, column] = largest
