"""Visibility of the seams of a result, where neighbours come from different places of the exemplar."""

import math

from texloom.stages.kernels.core.compiled import compiled, inner
from texloom.stages.kernels.patchmatch.search import cross_step


@compiled
def _difference(features, slopes, row, column, other_row, other_column):
    """The cube of two pixels' difference over 1 plus both slopes; the border of the exemplar repeats."""
    height, width, channels = features.shape
    row, other_row = min(max(row, 0), height - 1), min(max(other_row, 0), height - 1)
    column, other_column = min(max(column, 0), width - 1), min(max(other_column, 0), width - 1)
    total = 0.0
    for channel in range(channels):
        difference = features[row, column, channel] - features[other_row, other_column, channel]
        total += difference * difference
    return total * math.sqrt(total) / (1.0 + slopes[row, column] + slopes[other_row, other_column])


@inner
def _seam_cost(features, slopes, row, column, other_row, other_column, down, across):
    """Cost of the seam between a pixel and its neighbour at (down, across), from their sources."""
    if row + down == other_row and column + across == other_column:
        return 0.0
    here = _difference(features, slopes, row, column, other_row - down, other_column - across)
    return here + _difference(features, slopes, row + down, column + across, other_row, other_column)


@compiled
def seam_costs(features, slopes, match, wrap, side, first, last, costs):
    """Fill rows ``first`` to ``last`` of ``costs`` with the sums over squares of the result.

    A seam counts for the pixel above it or to its left.

    Parameters
    ----------
    features : (h, w, c) float32, of the exemplar
    slopes : (h, w) float32
    match : (H, W, 2) uint32
    wrap : texloom.stages.vocabulary.facts.Wraps, of the result
    side : of a square, px
    costs : (H / side, W / side) float64, rounded up
    """
    height, width, _ = match.shape
    for square in range(first, last):
        costs[square] = 0
        for y in range(square * side, min(square * side + side, height)):
            for x in range(width):
                row, column = int(match[y, x, 0]), int(match[y, x, 1])
                total = 0.0
                if wrap.down or y + 1 < height:
                    below = match[(y + 1) % height, x]
                    total += _seam_cost(features, slopes, row, column, int(below[0]), int(below[1]), 1, 0)
                if wrap.across or x + 1 < width:
                    aside = match[y, (x + 1) % width]
                    total += _seam_cost(features, slopes, row, column, int(aside[0]), int(aside[1]), 0, 1)
                costs[square, x // side] += total


@compiled
def added_cost(features, slopes, match, wrap, top, left, new, row, column):
    """Change of the cost of all seams if a piece is copied over a part of the result, float.

    Parameters
    ----------
    features, slopes, match, wrap : as for `seam_costs`
    top, left : of the part in the result, which may go on around it where it wraps
    new : (m, n) bool, the pixels of the part that are replaced
    row, column : of the piece's top-left pixel in the exemplar
    """
    height, width, _ = match.shape
    total = 0.0
    for i in range(new.shape[0]):
        for j in range(new.shape[1]):
            if not new[i, j]:
                continue
            y, x = (top + i) % height, (left + j) % width
            own_row, own_column = int(match[y, x, 0]), int(match[y, x, 1])
            for side in range(4):
                down, across = cross_step((side + 2) % 4)  # below and right first
                beside_y, beside_x = y + down, x + across
                if wrap.down:
                    beside_y %= height
                if wrap.across:
                    beside_x %= width
                if not (0 <= beside_y < height and 0 <= beside_x < width):
                    continue
                a, b = i + down, j + across
                both = 0 <= a < new.shape[0] and 0 <= b < new.shape[1] and new[a, b]
                if both and side >= 2:
                    continue  # it was counted from the other side
                beside_row, beside_column = int(match[beside_y, beside_x, 0]), int(match[beside_y, beside_x, 1])
                total -= _seam_cost(features, slopes, own_row, own_column, beside_row, beside_column, down, across)
                if not both:
                    total += _seam_cost(
                        features, slopes, row + i, column + j, beside_row, beside_column, down, across
                    )
    return total
