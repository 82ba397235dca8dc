"""Similarity sets: for every neighbourhood of a texture the others that look like it.

Places are numbered row by row. Vectors are held as in `stages.kernels.inverse_tree`.
"""

from __future__ import annotations

import numba
import numpy as np

from stages.kernels.row_distance import two_row_distance

_HALF = 16
_NONE = 2**62  # distance of an empty entry


@numba.njit(cache=True, nogil=True)
def _insert(similar, distance, place, far, across, apart):  # type: ignore[no-untyped-def]
    """Add ``place`` to a set that is sorted by distance, unless a better one stands less than ``apart`` px away.

    Worse ones that close to it are taken out. The first entry is the place itself and stays.
    """
    most = similar.size
    if far >= distance[most - 1]:
        return
    row, column = place // across, place % across
    for i in range(most):
        if similar[i] < 0:
            break
        close = max(abs(similar[i] // across - row), abs(similar[i] % across - column)) < apart
        if (close or similar[i] == place) and (i == 0 or distance[i] <= far):
            return
    kept = 1
    for i in range(1, most):
        other = similar[i]
        if other < 0:
            break
        if max(abs(other // across - row), abs(other % across - column)) >= apart:
            similar[kept], distance[kept] = other, distance[i]
            kept += 1
    at = min(kept, most - 1)
    while at > 1 and distance[at - 1] > far:
        similar[at], distance[at] = similar[at - 1], distance[at - 1]
        at -= 1
    similar[at], distance[at] = place, far
    for i in range(kept + 1, most):
        similar[i], distance[i] = -1, _NONE


@numba.njit(cache=True, nogil=True)
def similar_in_clusters(  # type: ignore[no-untyped-def]
    vectors, members, begin, across, apart, most, similar, distance, first, last
):
    """Fill the sets of the members of clusters ``first`` to ``last`` from their own cluster.

    Parameters
    ----------
    vectors : (2 n, 16) int16
    members : (n,) int64, places, those of a cluster side by side
    begin : (clusters + 1,) int64, where each cluster begins in ``members``
    across : int, places in a row
    apart : int, least distance of two entries along a row or a column, px
    most : int, members looked at, evenly spaced
    similar, distance : (n, k) int32 and int64, output; -1 where there is none
    """
    stride = np.uint64(2 * _HALF)
    for cluster in range(first, last):
        low, high = begin[cluster], begin[cluster + 1]
        step = max(1, (high - low + most - 1) // most)
        for i in range(low, high):
            place = members[i]
            similar[place] = -1
            distance[place] = _NONE
            similar[place, 0], distance[place, 0] = place, 0
            start = np.uint64(place) * stride
            for j in range(low + (i - low) % step, high, step):
                other = members[j]
                far = two_row_distance(vectors, start, vectors, np.uint64(other) * stride, _HALF)
                _insert(similar[place], distance[place], np.int32(other), far, across, apart)


@numba.njit(cache=True, nogil=True)
def similar_to_neighbours(  # type: ignore[no-untyped-def]
    vectors, down, across, apart, known, similar, distance, first, last
):
    """Improve the sets of the places of rows ``first`` to ``last`` by what their four neighbours resemble, shifted.

    Parameters
    ----------
    known : (down * across, k) int32, the sets as they were; empty where there is no neighbourhood
    similar, distance : the same, changed in place
    """
    stride = np.uint64(2 * _HALF)
    for row in range(first, last):
        for column in range(across):
            place = row * across + column
            if similar[place, 0] < 0:
                continue
            start = np.uint64(place) * stride
            for side in range(4):
                dy = (side - 1) if side % 2 == 0 else 0
                dx = (side - 2) if side % 2 == 1 else 0
                if row + dy < 0 or row + dy >= down or column + dx < 0 or column + dx >= across:
                    continue
                beside = place + dy * across + dx
                for i in range(1, known.shape[1]):
                    found = known[beside, i]
                    if found < 0:
                        break
                    r, c = found // across - dy, found % across - dx
                    if r < 0 or r >= down or c < 0 or c >= across:
                        continue
                    other = r * across + c
                    if known[other, 0] < 0:
                        continue
                    far = two_row_distance(vectors, start, vectors, np.uint64(other) * stride, _HALF)
                    _insert(similar[place], distance[place], np.int32(other), far, across, apart)
