"""Exact search of the nearest of many short vectors, pruned by one component.

Vectors are held as in `texloom.stages.kernels.compaction.tree`.
"""

import numpy as np

from texloom.stages.kernels.compaction.tree import vector_distance
from texloom.stages.kernels.core.compiled import compiled

_BATCH = 8  # vectors compared on one side before those on the other


@compiled
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
    firsts = given[::2, 0]
    count = numbers.size
    for i in range(first, last):
        own = np.int64(wanted[2 * i, 0])
        high = int(np.searchsorted(firsts, own))
        low = high - 1
        best, number = np.int64(2**62), np.int64(0)
        while low >= 0 or high < count:
            for _ in range(_BATCH):
                if high >= count:
                    break
                gap = np.int64(firsts[high]) - own
                if gap * gap > best:
                    high = count
                    break
                d = vector_distance(wanted, i, given, high)
                if d < best or (d == best and numbers[high] < number):
                    best, number = d, numbers[high]
                high += 1
            for _ in range(_BATCH):
                if low < 0:
                    break
                gap = own - np.int64(firsts[low])
                if gap * gap > best:
                    low = -1
                    break
                d = vector_distance(wanted, i, given, low)
                if d < best or (d == best and numbers[low] < number):
                    best, number = d, numbers[low]
                low -= 1
        nearest[i] = number
