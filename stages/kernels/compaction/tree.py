"""Tree-structured vector quantisation: splitting nodes, dropping vectors down the tree, folding it up again.

Vectors are int16 of `DIMENSIONS` values, held as (2 n, `HALF`) so that one is two rows for `two_row_distance`.
"""

import numpy as np

from texloom.stages.kernels.core.compiled import compiled, inner
from texloom.stages.kernels.core.row_distance import two_row_distance
from texloom.stages.kernels.core.vector_size import DIMENSIONS

HALF = DIMENSIONS // 2


@inner(forceinline=True)
def vector_distance(vectors, number, others, other):
    """Squared distance of a vector, by number, and another of ``others``, int64."""
    stride = np.uint64(DIMENSIONS)
    return two_row_distance(vectors, np.uint64(number) * stride, others, np.uint64(other) * stride, HALF)


@compiled
def farthest_vector(vectors, number):
    """Number of the vector farthest from a given one, the first of equals, and their squared distance, int64."""
    at, largest = 0, np.int64(-1)
    for other in range(vectors.shape[0] // 2):
        d = vector_distance(vectors, number, vectors, other)
        if d > largest:
            at, largest = other, d
    return at, largest


@compiled
def split_nodes(vectors, order, scratch, begin, count, bound, steps, means, medoid, distortion, left, first, last):
    """Split the nodes ``first`` to ``last`` in two by k-means [Wei2000]_.

    Parameters
    ----------
    vectors : (2 n, HALF) int16
    order : (m,) int64, vectors by number, those of a node side by side; regrouped in place
    scratch : (m,) int64, work space
    begin, count : (nodes,) int64, where a node's members begin in ``order``, and how many they are
    bound : float64, root mean squared distance to the mean up to which a node stays whole
    steps : int, most rounds of k-means
    means : (4 nodes, HALF) int16, output: the means of both halves
    medoid : (nodes,) int64, output: the member nearest to the node's mean
    distortion : (nodes,) float64, output: sum of squared distances to the node's mean
    left : (nodes,) int64, output: members of the left half, which come first; 0 where the node stays whole
    """
    flat = vectors.reshape(-1, DIMENSIONS)
    centre = np.empty((2, HALF), np.int16)
    middle = centre.reshape(DIMENSIONS)
    halves = means.reshape(-1, 2, DIMENSIONS)
    sums = np.empty((2, DIMENSIONS), np.int64)
    squares = np.empty(DIMENSIONS, np.int64)
    for node in range(first, last):
        members = order[begin[node] : begin[node] + count[node]]
        size = members.size
        sums[:] = 0
        squares[:] = 0
        for member in members:
            for k in range(DIMENSIONS):
                value = np.int64(flat[member, k])
                sums[0, k] += value
                squares[k] += value * value
        total, widest, axis = 0.0, -1.0, 0
        for k in range(DIMENSIONS):
            spread = squares[k] - sums[0, k] * (sums[0, k] / size)
            total += spread
            middle[k] = np.int16(np.rint(sums[0, k] / size))
            if spread > widest:
                widest, axis = spread, k
        distortion[node] = max(total, 0.0)
        nearest = np.int64(2**62)
        for member in members:
            d = vector_distance(vectors, member, centre, 0)
            if d < nearest:
                nearest = d
                medoid[node] = member
        left[node] = 0
        if size < 2 or total <= bound * bound * size:
            continue

        # [Wei2000]_ leaves the start open: a step either way along the axis of largest spread.
        halves[node, 0, :] = middle
        halves[node, 1, :] = middle
        step = np.int16(np.ceil(0.1 * np.sqrt(widest / size)))
        halves[node, 0, axis] -= step
        halves[node, 1, axis] += step
        sides = scratch[begin[node] : begin[node] + size]
        sides[:] = -1
        for attempt in range(steps):
            sums[:] = 0
            changed = 0
            for i in range(size):
                member = members[i]
                near = vector_distance(vectors, member, means, 2 * node)
                far = vector_distance(vectors, member, means, 2 * node + 1)
                side = 0 if near <= far else 1
                changed += sides[i] != side
                sides[i] = side
                for k in range(DIMENSIONS):
                    sums[side, k] += flat[member, k]
            count_left = size - sides.sum()
            # The means are those that the members were assigned by, so the last round does not move them.
            if changed == 0 or count_left in (0, size) or attempt == steps - 1:
                break
            for k in range(DIMENSIONS):
                halves[node, 0, k] = np.int16(np.rint(sums[0, k] / count_left))
                halves[node, 1, k] = np.int16(np.rint(sums[1, k] / (size - count_left)))
        count_left = size - sides.sum()
        if count_left in (0, size):
            continue
        left[node] = count_left
        members[:] = np.concatenate((members[sides == 0], members[sides == 1]))


@compiled
def drop_vectors(vectors, child, means, leaf, first, last):
    """Set ``leaf[first:last]`` (int32) to the leaf that each vector falls into.

    Parameters
    ----------
    vectors : (2 n, HALF) int16
    child : (nodes,) int32, the left child, whose right neighbour is the other; -1 for leaves
    means : (4 nodes, HALF) int16, as `split_nodes` leaves them
    """
    for vector in range(first, last):
        node = np.int64(0)
        while child[node] >= 0:
            near = vector_distance(vectors, vector, means, 2 * node)
            far = vector_distance(vectors, vector, means, 2 * node + 1)
            node = np.int64(child[node]) + (0 if near <= far else 1)
        leaf[vector] = node


@compiled
def fold_sizes(parent, child, distortion, fold):
    """Fold up the inner node that costs least distortion for a leaf less, again and again (BFOS) [Gersho1992]_.

    Parameters
    ----------
    parent, child : (nodes,) int32; a parent comes before its children; ``child`` as in `drop_vectors`
    distortion : (nodes,) float64
    fold : (nodes,) int32, output: leaves of the whole tree just before this node is folded into one; 0 for leaves
    """
    nodes = parent.size
    leaves = np.ones(nodes, np.int64)
    below = distortion.copy()  # distortion of the leaves under a node
    for node in range(nodes - 1, -1, -1):
        if child[node] >= 0:
            leaves[node] = leaves[child[node]] + leaves[child[node] + 1]
            below[node] = below[child[node]] + below[child[node] + 1]
    # A tournament: place 1 holds the cheapest node, place p the cheaper of places 2 p and 2 p + 1.
    half = 1
    while half < nodes:
        half *= 2
    cost = np.full(2 * half, np.inf)
    winner = np.zeros(2 * half, np.int64)
    fold[:] = 0
    for node in range(nodes):
        winner[half + node] = node
        if child[node] >= 0:
            cost[half + node] = (distortion[node] - below[node]) / (leaves[node] - 1)
    for place in range(half - 1, 0, -1):
        _play(cost, winner, place)
    stack = np.empty(nodes, np.int64)
    while cost[1] < np.inf:
        node = winner[1]
        total = leaves[0]
        # everything inner below goes with it
        stack[0], size = node, 1
        while size > 0:
            size -= 1
            under = stack[size]
            if child[under] >= 0 and fold[under] == 0:
                fold[under] = total
                _set_cost(cost, winner, half, under, np.inf)
                stack[size] = child[under]
                stack[size + 1] = child[under] + 1
                size += 2
        saved, more = leaves[node] - 1, distortion[node] - below[node]
        above = node
        while above >= 0:
            leaves[above] -= saved
            below[above] += more
            if above != node:
                _set_cost(cost, winner, half, above, (distortion[above] - below[above]) / (leaves[above] - 1))
            above = np.int64(parent[above])


@inner
def _play(cost, winner, place):
    better = 2 * place if cost[2 * place] <= cost[2 * place + 1] else 2 * place + 1
    cost[place] = cost[better]
    winner[place] = winner[better]


@inner
def _set_cost(cost, winner, half, node, value):
    cost[half + node] = value
    place = (half + node) // 2
    while place > 0:
        _play(cost, winner, place)
        place //= 2


@compiled
def folded_into(parent, fold, leaves, owner):
    """Set ``owner`` (int32) to the leaf of the folded tree above each node; itself where it is not folded away.

    Every inner node whose ``fold`` is above ``leaves`` is folded.
    """
    for node in range(parent.size):
        above = parent[node]
        folded = above >= 0 and (owner[above] != above or fold[above] > leaves)
        owner[node] = owner[above] if folded else node
