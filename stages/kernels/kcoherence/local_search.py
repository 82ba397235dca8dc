"""Local search: candidates are replaced by better ones around them."""

import numpy as np

from texloom.stages.kernels.core.compiled import compiled


@compiled
def search_around(vectors, own, places, reach, first, last):
    """Replace the candidates of the vectors ``first`` to ``last`` by the most similar ones around them.

    Parameters
    ----------
    vectors : (p, q, d) float32
    own : (n, 2) int64, rows and columns of the vectors
    places : (n, k, 2) int32, candidates of each, none its own; changed in place
    reach : int, px along a row or a column
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
