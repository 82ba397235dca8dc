"""The cheapest way through a strip, from its first row to its last."""

from __future__ import annotations

import numba
import numpy as np


@numba.njit(cache=True, nogil=True)
def cheapest_path(errors, path):  # type: ignore[no-untyped-def]
    """Fill ``path`` with the column of every row on the path whose errors sum to the least.

    A path moves at most one column from a row to the next. Of equal paths, the leftmost at the last row that
    differs is taken.

    Parameters
    ----------
    errors : (n, m) float32, at least one row and column
    path : (n,) int64
    """
    rows, columns = errors.shape
    total = np.empty((rows, columns), np.float64)
    for x in range(columns):
        total[0, x] = errors[0, x]
    for y in range(1, rows):
        for x in range(columns):
            least = total[y - 1, x]
            if x > 0:
                least = min(least, total[y - 1, x - 1])
            if x + 1 < columns:
                least = min(least, total[y - 1, x + 1])
            total[y, x] = least + errors[y, x]
    at = 0
    for x in range(1, columns):
        if total[rows - 1, x] < total[rows - 1, at]:
            at = x
    path[rows - 1] = at
    for y in range(rows - 2, -1, -1):
        best = max(at - 1, 0)
        for x in range(best + 1, min(at + 1, columns - 1) + 1):
            if total[y, x] < total[y, best]:
                best = x
        at = best
        path[y] = at
