"""Squared differences of a template and an exemplar at single places."""

import numpy as np

from texloom.stages.kernels.core.compiled import compiled


@compiled
def refine_positions(features, template, mask, free, places, reach):
    """Move each of ``places`` to the least difference within ``reach`` px along each axis.

    Of equal ones the first in scan order is taken; a place with no free one around it stays. Of the template
    every ``reach``-th pixel is compared.

    Parameters
    ----------
    features : (h, w, c) float32
    template : (m, n, c) float32
    mask : (m, n) bool, what is compared
    free : (h - m + 1, w - n + 1) bool, allowed positions of the template
    places : (k, 2) int64, top-left pixels; changed in place
    """
    for number in range(places.shape[0]):
        first_row, first_column = places[number, 0], places[number, 1]
        least = np.inf
        for row in range(max(first_row - reach, 0), min(first_row + reach + 1, free.shape[0])):
            for column in range(max(first_column - reach, 0), min(first_column + reach + 1, free.shape[1])):
                if not free[row, column]:
                    continue
                total = 0.0
                for i in range(0, mask.shape[0], reach):
                    for j in range(0, mask.shape[1], reach):
                        if mask[i, j]:
                            for channel in range(features.shape[2]):
                                difference = features[row + i, column + j, channel] - template[i, j, channel]
                                total += difference * difference
                    if total >= least:
                        break
                if total < least:
                    least = total
                    places[number, 0], places[number, 1] = row, column
