"""Places moved to the best fit around them."""

from __future__ import annotations

import numba
import numpy as np


@numba.njit(cache=True, nogil=True)
def move_to_best(vectors, own, places, reach, first, last):
    """Move the places found for the vectors ``first`` to ``last`` to where they differ least from them.

    Parameters
    ----------
    vectors : (p, q, d) float32
    own : (n, 2) int64, row and column of the vectors that are looked for
    places : (n, k, 2) int32, row and column of what was found for each, none of it its own; changed
    reach : int, px that a place may be moved along a row or a column
    """
    down, across, size = vectors.shape
    for index in range(first, last):
        row, column = own[index, 0], own[index, 1]
        for which in range(places.shape[1]):
            middle_row, middle_column = places[index, which, 0], places[index, which, 1]
            least = np.float32(np.inf)
            for y in range(max(0, middle_row - reach), min(down, middle_row + reach + 1)):
                for x in range(max(0, middle_column - reach), min(across, middle_column + reach + 1)):
                    if y == row and x == column:
                        continue
                    total = np.float32(0)
                    for k in range(size):
                        difference = vectors[y, x, k] - vectors[row, column, k]
                        total += difference * difference
                        if total >= least:
                            break
                    if total < least:
                        least = total
                        places[index, which, 0], places[index, which, 1] = y, x
