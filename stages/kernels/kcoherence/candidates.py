"""Candidate sets of k-coherence: for every neighbourhood of a texture the most similar others.

Places are numbered row by row. Members of sets are row << bits | column, where a column takes so many ``bits``: how
far two are apart needs no division then. Vectors are held as in `texloom.stages.kernels.compaction.tree`.
"""

import numpy as np

from texloom.stages.kernels.compaction.tree import HALF, vector_distance
from texloom.stages.kernels.core.compiled import compiled, inner
from texloom.stages.kernels.patchmatch.search import cross_step

NONE = 2**31 - 1
"""distance of an empty entry"""


@inner(forceinline=True)
def _insert(candidates, distance, place, d, bits, min_separation):
    """Add ``place``, nearer than the last of a set that is sorted by distance, unless a better one is too close.

    Too close is less than ``min_separation`` px away; worse entries that close are removed. The first entry is the
    place itself and stays.
    """
    mask = (np.int64(1) << bits) - 1
    row, column = place >> bits, place & mask
    most = candidates.size
    at = 0
    while distance[at] <= d:  # not the last
        other = np.int64(candidates[at])
        if max(abs((other >> bits) - row), abs((other & mask) - column)) < min_separation:
            return
        at += 1
    last, last_distance = place, d
    for i in range(at, most):
        other, other_distance = np.int64(candidates[i]), np.int64(distance[i])
        if other >= 0 and max(abs((other >> bits) - row), abs((other & mask) - column)) < min_separation:
            continue
        candidates[at], distance[at] = last, last_distance
        last, last_distance = other, other_distance
        at += 1
    while at < most:
        candidates[at], distance[at] = last, last_distance
        last, last_distance = -1, NONE
        at += 1


@compiled
def cluster_candidates(
    vectors, members, begin, across, bits, min_separation, most, candidates, distance, first, last
):
    """Fill the sets of the members of clusters ``first`` to ``last`` from their own cluster.

    Parameters
    ----------
    vectors : (2 n, HALF) int16
    members : (m,) int64, places by cluster
    begin : (clusters + 1,) int64, where each begins in ``members``
    across : int, places in a row
    bits : int, of a column
    min_separation : int, least distance of two entries along a row or a column, px
    most : int, members looked at, evenly spaced
    candidates, distance : (n, k) int32, output; -1 where there is none
    """
    largest = 0
    for cluster in range(first, last):
        largest = max(largest, begin[cluster + 1] - begin[cluster])
    held = np.empty((2 * largest, HALF), np.int16)  # side by side they are read several times as fast
    packed = np.empty(largest, np.int64)
    distances = np.empty(most, np.int32)
    for cluster in range(first, last):
        low, count = begin[cluster], begin[cluster + 1] - begin[cluster]
        for i in range(count):
            place = members[low + i]
            packed[i] = (place // across) << bits | place % across
            for half in range(2):
                for k in range(HALF):
                    held[2 * i + half, k] = vectors[2 * place + half, k]
        step = max(1, (count + most - 1) // most)
        for i in range(count):
            own, own_distance = candidates[members[low + i]], distance[members[low + i]]
            for entry in range(own.size):
                own[entry], own_distance[entry] = -1, NONE
            own[0], own_distance[0] = packed[i], 0
            start, others = i % step, 0
            for j in range(start, count, step):  # no branch depends on a distance here, which is twice as fast
                distances[others] = vector_distance(held, i, held, j)
                others += 1
            for j in range(others):
                if distances[j] < own_distance[own.size - 1]:
                    d = np.int64(distances[j])
                    _insert(own, own_distance, packed[start + j * step], d, bits, min_separation)


@compiled
def propagate_candidates(vectors, down, across, bits, min_separation, known, candidates, distance, first, last):
    """Improve the sets of the places of rows ``first`` to ``last`` by the shifted candidates of their neighbours.

    Parameters
    ----------
    known : (down * across, k) int32, the sets as they were; empty where there is no neighbourhood
    candidates, distance : the same, changed in place
    """
    mask = (np.int64(1) << bits) - 1
    most = known.shape[1]
    packed, others = np.empty(4 * most, np.int64), np.empty(4 * most, np.int64)
    distances = np.empty(4 * most, np.int64)
    for row in range(first, last):
        for column in range(across):
            place = row * across + column
            if known[place, 0] < 0:
                continue
            count = (
                0  # as in `cluster_candidates`, no branch depends on what is found before all distances are known
            )
            for side in range(4):
                dy, dx = cross_step(side)
                if row + dy < 0 or row + dy >= down or column + dx < 0 or column + dx >= across:
                    continue
                for i in range(1, most):
                    candidate = np.int64(known[place + dy * across + dx, i])
                    to_row, to_column = (candidate >> bits) - dy, (candidate & mask) - dx
                    packed[count], others[count] = to_row << bits | to_column, to_row * across + to_column
                    count += (
                        (candidate >= 0) & (to_row >= 0) & (to_row < down) & (to_column >= 0) & (to_column < across)
                    )
            for i in range(count):
                distances[i] = vector_distance(vectors, place, vectors, others[i])
            own, own_distance = candidates[place], distance[place]
            for i in range(count):
                if distances[i] < own_distance[most - 1] and known[others[i], 0] >= 0:
                    _insert(own, own_distance, packed[i], distances[i], bits, min_separation)
