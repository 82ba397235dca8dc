"""Pixels made one by one, each from where its neighbours come from."""

from __future__ import annotations

import numba
import numpy as np


@numba.njit(cache=True, nogil=True)
def resynthesise(
    order, done, radius, wrap, soften, exemplar, exemplar_pixels, candidates, home, canvas, pixels, match, valid
):
    """Make the pixels in ``order``, each the best continuation of the valid pixels around it.

    Each valid neighbour proposes the exemplar pixel that continues its own source, and those that continue the
    places that look like its source. The one whose neighbourhood differs least is taken; of equal ones the first,
    neighbours in scan order. A proposal is moved to its ``home``, the nearest pixel that may be taken.

    Returns how many are done, and a row and column: where not all are, ``candidates`` was not known there; once it
    is, the work goes on from ``done``.

    Parameters
    ----------
    order : (n, 2) int64, rows and columns of pixels that are not valid; at least one valid pixel is near each
    done : how many are done already
    radius : of a neighbourhood, px
    wrap : bool, the result is a torus
    soften : bool, valid direct neighbours of a new pixel become the mean of what they are and what continues it
    exemplar : (h, w, c) float32, what is compared; both sides more than twice ``radius``
    exemplar_pixels : (h, w, d) float32
    candidates : (h, w, k, 2) int32, places that look like each pixel's neighbourhood; -1 where there is none, -2
        where they are not known yet
    home : (h, w, 2) int32, for every pixel one whose whole neighbourhood lies inside the exemplar
    canvas, pixels : (H, W, c) and (H, W, d) float32, changed
    match : (H, W, 2) int32, changed
    valid : (H, W) bool, changed
    """
    height, width, channels = canvas.shape
    last_row, last_column = exemplar.shape[0] - 1, exemplar.shape[1] - 1
    window = (2 * radius + 1) ** 2
    rows, columns = np.empty(window, np.int64), np.empty(window, np.int64)
    downs, acrosses = np.empty(window, np.int64), np.empty(window, np.int64)
    for number in range(done, order.shape[0]):
        y, x = order[number, 0], order[number, 1]
        count = 0
        for down in range(-radius, radius + 1):
            for across in range(-radius, radius + 1):
                row, column = y + down, x + across
                if wrap:
                    row, column = row % height, column % width
                elif not (0 <= row < height and 0 <= column < width):
                    continue
                if valid[row, column]:
                    rows[count], columns[count] = row, column
                    downs[count], acrosses[count] = down, across
                    count += 1
        least = np.inf
        best_row, best_column = home[0, 0, 0], home[0, 0, 1]
        for index in range(count):
            own_row, own_column = match[rows[index], columns[index], 0], match[rows[index], columns[index], 1]
            for which in range(-1, candidates.shape[2]):
                row, column = own_row, own_column
                if which >= 0:
                    row, column = (
                        candidates[own_row, own_column, which, 0],
                        candidates[own_row, own_column, which, 1],
                    )
                    if row == -2:
                        return number, own_row, own_column
                    if row < 0:
                        break
                at_row = min(max(row - downs[index], 0), last_row)
                at_column = min(max(column - acrosses[index], 0), last_column)
                row, column = home[at_row, at_column, 0], home[at_row, at_column, 1]
                total = 0.0
                for other in range(count):
                    for channel in range(channels):
                        difference = (
                            exemplar[row + downs[other], column + acrosses[other], channel]
                            - canvas[rows[other], columns[other], channel]
                        )
                        total += difference * difference
                    if total >= least:
                        break
                if total < least:
                    least, best_row, best_column = total, row, column
        canvas[y, x] = exemplar[best_row, best_column]
        pixels[y, x] = exemplar_pixels[best_row, best_column]
        match[y, x, 0], match[y, x, 1] = best_row, best_column
        valid[y, x] = True
        if soften:
            for index in range(count):
                if abs(downs[index]) + abs(acrosses[index]) == 1:
                    row, column = rows[index], columns[index]
                    source_row, source_column = best_row + downs[index], best_column + acrosses[index]
                    for channel in range(channels):
                        canvas[row, column, channel] = np.float32(0.5) * (
                            canvas[row, column, channel] + exemplar[source_row, source_column, channel]
                        )
                    for channel in range(pixels.shape[2]):
                        pixels[row, column, channel] = np.float32(0.5) * (
                            pixels[row, column, channel] + exemplar_pixels[source_row, source_column, channel]
                        )
    return order.shape[0], 0, 0
