"""Candidate sets of k-coherence: for every neighbourhood of a texture the most similar others.

Places are numbered row by row. Vectors are held as in `texloom.stages.kernels.compaction.tree`.
"""

import numba
import numpy as np

from texloom.stages.kernels.compaction.tree import HALF, vector_distance
from texloom.stages.kernels.patchmatch.search import cross_step

_NONE = 2**62  # distance of an empty entry


@numba.njit(cache=True, nogil=True)
def _holds(candidates, place):
    """Whether a set has ``place``."""
    held = False
    for other in candidates:
        held |= other == place
    return held


@numba.njit(cache=True, nogil=True)
def _insert(candidates, distance, place, d, across, min_separation):
    """Add ``place``, nearer than the last of a set that is sorted by distance, unless a better one is too close.

    Too close is less than ``min_separation`` px away; worse entries that close are removed. The first entry is the
    place itself and stays.
    """
    most = candidates.size
    row, column = place // across, place % across
    for i in range(most):
        if candidates[i] < 0:
            break
        close = max(abs(candidates[i] // across - row), abs(candidates[i] % across - column)) < min_separation
        if (close or candidates[i] == place) and (i == 0 or distance[i] <= d):
            return
    kept = 1
    for i in range(1, most):
        other = candidates[i]
        if other < 0:
            break
        if max(abs(other // across - row), abs(other % across - column)) >= min_separation:
            candidates[kept], distance[kept] = other, distance[i]
            kept += 1
    at = min(kept, most - 1)
    while at > 1 and distance[at - 1] > d:
        candidates[at], distance[at] = candidates[at - 1], distance[at - 1]
        at -= 1
    candidates[at], distance[at] = place, d
    for i in range(kept + 1, most):
        candidates[i], distance[i] = -1, _NONE


@numba.njit(cache=True, nogil=True)
def cluster_candidates(vectors, members, begin, across, min_separation, most, candidates, distance, first, last):
    """Fill the sets of the members of clusters ``first`` to ``last`` from their own cluster.

    Parameters
    ----------
    vectors : (2 n, 16) int16
    members : (n,) int64, places, those of a cluster side by side
    begin : (clusters + 1,) int64, where each cluster begins in ``members``
    across : int, places in a row
    min_separation : int, least distance of two entries along a row or a column, px
    most : int, members looked at, evenly spaced
    candidates, distance : (n, k) int32 and int64, output; -1 where there is none
    """
    largest = 0
    for cluster in range(first, last):
        largest = max(largest, begin[cluster + 1] - begin[cluster])
    held = np.empty((2 * largest, HALF), np.int16)  # side by side they are read several times as fast
    for cluster in range(first, last):
        low, count = begin[cluster], begin[cluster + 1] - begin[cluster]
        for i in range(count):
            for half in range(2):
                held[2 * i + half] = vectors[2 * members[low + i] + half]
        step = max(1, (count + most - 1) // most)
        for i in range(count):
            place = members[low + i]
            own, own_distance = candidates[place], distance[place]
            own[:] = -1
            own_distance[:] = _NONE
            own[0], own_distance[0] = place, 0
            for j in range(i % step, count, step):
                d = vector_distance(held, i, held, j)
                if d < own_distance[own.size - 1]:
                    _insert(own, own_distance, np.int32(members[low + j]), d, across, min_separation)


@numba.njit(cache=True, nogil=True)
def propagate_candidates(vectors, down, across, min_separation, known, candidates, distance, first, last):
    """Improve the sets of the places of rows ``first`` to ``last`` by the shifted candidates of their neighbours.

    Parameters
    ----------
    known : (down * across, k) int32, the sets as they were; empty where there is no neighbourhood
    candidates, distance : the same, changed in place
    """
    for row in range(first, last):
        for column in range(across):
            place = row * across + column
            own, own_distance = candidates[place], distance[place]
            if own[0] < 0:
                continue
            for side in range(4):
                dy, dx = cross_step(side)
                if row + dy < 0 or row + dy >= down or column + dx < 0 or column + dx >= across:
                    continue
                neighbour = known[place + dy * across + dx]
                for i in range(1, neighbour.size):
                    candidate = neighbour[i]
                    if candidate < 0:
                        break
                    other = candidate - dy * across - dx
                    if other < 0 or other >= down * across:
                        continue
                    if dx != 0 and not 0 <= candidate % across - dx < across:
                        continue
                    if _holds(own, other):
                        continue
                    d = vector_distance(vectors, place, vectors, other)
                    if d < own_distance[own.size - 1] and known[other, 0] >= 0:
                        _insert(own, own_distance, np.int32(other), d, across, min_separation)
