"""Resynthesis of single pixels by k-coherence."""

from typing import Any, NamedTuple

import numpy as np

from texloom.stages.kernels.core.compiled import compiled, inner


class CopySource(NamedTuple):
    """What pixels are copied from."""

    features: Any
    """(h, w, c) float32, what is compared; both sides more than twice the radius of a neighbourhood"""
    pixels: Any
    """(h, w, d) float32"""
    candidates: Any
    """(h, w, k, 2) int32, similar pixels of each; -1 where there is none, -2 where they are not known yet"""
    nearest_valid: Any
    """(h, w, 2) int32, the nearest pixel whose whole neighbourhood lies inside the exemplar"""


class PartialResult(NamedTuple):
    """The result, changed in place."""

    features: Any
    """(H, W, c) float32"""
    pixels: Any
    """(H, W, d) float32"""
    match: Any
    """(H, W, 2) int32"""
    valid: Any
    """(H, W) bool"""


@inner
def _soften(pixels, row, column, source, source_row, source_column):
    """Replace a pixel by its mean with one of ``source``."""
    for k in range(pixels.shape[2]):
        pixels[row, column, k] = np.float32(0.5) * (pixels[row, column, k] + source[source_row, source_column, k])


@compiled
def resynthesise(order, done, radius, wrap, soften, exemplar, result):
    """Choose the pixels in ``order``, each the best continuation of the valid pixels around it.

    Each valid neighbour proposes the exemplar pixel that continues its own source, and those that continue the
    candidates of that source, all moved to the nearest valid pixel. The proposal whose neighbourhood differs least
    is taken; of equal ones the first, neighbours in scan order.

    Parameters
    ----------
    order : (n, 2) int64, rows and columns of pixels that are not valid; at least one valid pixel is near each
    done : int, how many are done already
    radius : int, of a neighbourhood, px
    wrap : texloom.stages.vocabulary.facts.Wraps, of the result
    soften : bool, valid direct neighbours of a new pixel become the mean of their values and of its continuation
    exemplar : CopySource
    result : PartialResult

    Returns
    -------
    int, how many are done; int and int, if these are not all, the row and column whose candidates are needed first.
    """
    features, exemplar_pixels, candidates, nearest_valid = exemplar
    canvas, pixels, match, valid = result
    height, width, channels = canvas.shape
    last_row, last_column = features.shape[0] - 1, features.shape[1] - 1
    window = (2 * radius + 1) ** 2
    rows, columns = np.empty(window, np.int64), np.empty(window, np.int64)
    downs, acrosses = np.empty(window, np.int64), np.empty(window, np.int64)
    for number in range(done, order.shape[0]):
        y, x = order[number, 0], order[number, 1]
        count = 0
        for down in range(-radius, radius + 1):
            for across in range(-radius, radius + 1):
                row, column = y + down, x + across
                if wrap.down:
                    row %= height
                if wrap.across:
                    column %= width
                if not (0 <= row < height and 0 <= column < width):
                    continue
                if valid[row, column]:
                    rows[count], columns[count] = row, column
                    downs[count], acrosses[count] = down, across
                    count += 1
        least = np.inf
        best_row, best_column = nearest_valid[0, 0, 0], nearest_valid[0, 0, 1]
        for index in range(count):
            own_row, own_column = match[rows[index], columns[index], 0], match[rows[index], columns[index], 1]
            for which in range(-1, candidates.shape[2]):
                row, column = own_row, own_column
                if which >= 0:
                    row = candidates[own_row, own_column, which, 0]
                    column = candidates[own_row, own_column, which, 1]
                    if row == -2:
                        return number, own_row, own_column
                    if row < 0:
                        break
                at_row = min(max(row - downs[index], 0), last_row)
                at_column = min(max(column - acrosses[index], 0), last_column)
                row, column = nearest_valid[at_row, at_column, 0], nearest_valid[at_row, at_column, 1]
                total = 0.0
                for other in range(count):
                    for channel in range(channels):
                        difference = (
                            features[row + downs[other], column + acrosses[other], channel]
                            - canvas[rows[other], columns[other], channel]
                        )
                        total += difference * difference
                    if total >= least:
                        break
                if total < least:
                    least, best_row, best_column = total, row, column
        canvas[y, x] = features[best_row, best_column]
        pixels[y, x] = exemplar_pixels[best_row, best_column]
        match[y, x, 0], match[y, x, 1] = best_row, best_column
        valid[y, x] = True
        if soften:
            for index in range(count):
                if abs(downs[index]) + abs(acrosses[index]) == 1:
                    row, column = rows[index], columns[index]
                    source_row, source_column = best_row + downs[index], best_column + acrosses[index]
                    _soften(canvas, row, column, features, source_row, source_column)
                    _soften(pixels, row, column, exemplar_pixels, source_row, source_column)
    return order.shape[0], 0, 0
