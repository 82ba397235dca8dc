"""Exact search of the nearest of many short vectors, pruned by one component.

Vectors are held as in `texloom.stages.kernels.compaction.tree`.
"""

import numba
import numpy as np

from texloom.stages.kernels.core.row_distance import two_row_distance

_HALF = 16
_BATCH = 8  # vectors compared on one side before those on the other


@numba.njit(cache=True, nogil=True)
def nearest_vectors(wanted, given, numbers, nearest, first, last):
    """Find the nearest vector for those ``first`` to ``last`` of ``wanted``; of equals the one of lowest number.

    The search leads away from the wanted vector's first component to both sides, until that component alone is
    farther than the nearest so far.

    Parameters
    ----------
    wanted, given : (2 n, 16), (2 m, 16) int16; ``given`` sorted by the first component
    numbers : (m,) int64, of the given vectors
    nearest : (n,) int64, output: their numbers
    """
    stride = np.uint64(2 * _HALF)
    count = numbers.size
    for i in range(first, last):
        own = np.int64(wanted[2 * i, 0])
        start = np.uint64(i) * stride
        below, above = 0, count
        while below < above:
            middle = (below + above) // 2
            if given[2 * middle, 0] < own:
                below = middle + 1
            else:
                above = middle
        low, high = below - 1, below
        best, number = np.int64(2**62), np.int64(0)
        while low >= 0 or high < count:
            for _ in range(_BATCH):
                if high >= count:
                    break
                gap = np.int64(given[2 * high, 0]) - own
                if gap * gap > best:
                    high = count
                    break
                d = two_row_distance(wanted, start, given, np.uint64(high) * stride, _HALF)
                if d < best or (d == best and numbers[high] < number):
                    best, number = d, numbers[high]
                high += 1
            for _ in range(_BATCH):
                if low < 0:
                    break
                gap = own - np.int64(given[2 * low, 0])
                if gap * gap > best:
                    low = -1
                    break
                d = two_row_distance(wanted, start, given, np.uint64(low) * stride, _HALF)
                if d < best or (d == best and numbers[low] < number):
                    best, number = d, numbers[low]
                low -= 1
        nearest[i] = number
