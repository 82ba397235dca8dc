"""Minimum cuts along which new sources are laid over those of a result, by maximum flow on a grid."""

import numpy as np

from texloom.stages.kernels.core.compiled import compiled, inner
from texloom.stages.kernels.seams.seam_costs import seam_cost, seam_costs_both_ways
from texloom.stages.kernels.seams.window_state import ABSENT, FILLED, FREE, KEPT

NO_CELLS = np.zeros((0, 0), np.int16)
NO_PRICE = np.zeros((0, 0), np.int32)
_BLOCKED = -2  # level of a node from which nothing more flows before the next levels


@compiled
def cut_window(costs, inside, price, old, new, state, taken):
    """Fill ``taken`` with the pixels of a window that take their new source so that all seams cost least.

    Seams inside of cells cost twice as much. Capacities are whole numbers, so that the cut is the same everywhere;
    of several equal cuts it is the one that takes fewest pixels.

    Parameters
    ----------
    costs : see `seam_cost`
    inside : (h, w) int16, number of each pixel's exemplar, from 1; below 0 where it is not inside a cell; or
        `NO_CELLS`
    price : (h, w) int32, of each pixel of the exemplar as a source, in steps; or `NO_PRICE`
    old, new : (m, n, 2) int32, sources of the window's pixels
    state : (m, n) int8
    taken : (m, n) bool
    """
    height, width = state.shape
    node = np.full((height, width), -1, np.int32)
    count = 0
    for y in range(height):
        for x in range(width):
            if state[y, x] == FREE:
                node[y, x] = count
                count += 1
    beside = np.full((count, 4), -1, np.int32)
    capacity = np.zeros((count, 4), np.int64)  # to the neighbour on each side
    keep, take = np.zeros(count, np.int64), np.zeros(count, np.int64)
    if price.size:
        for y in range(height):
            for x in range(width):
                if state[y, x] == FREE:
                    keep[node[y, x]] = price[old[y, x, 0], old[y, x, 1]]
                    take[node[y, x]] = price[new[y, x, 0], new[y, x, 1]]
    for axis in range(2):
        for y in range(height - (axis == 0)):
            for x in range(width - (axis == 1)):
                v, u = y + (axis == 0), x + (axis == 1)
                one, other = state[y, x], state[v, u]
                if one == ABSENT or other == ABSENT or (one != FREE and other != FREE):
                    continue
                first, second = node[y, x], node[v, u]
                if one == FREE and other == FREE:
                    if inside.size == 0 and _in_one_piece(axis, old, new, y, x, v, u):
                        stay = np.int64(0)
                        right, left = seam_costs_both_ways(
                            costs, axis, old[y, x, 0], old[y, x, 1], new[y, x, 0], new[y, x, 1]
                        )
                    else:
                        stay = _cost(costs, inside, axis, old[y, x], old[v, u])
                        right = _cost(costs, inside, axis, old[y, x], new[v, u])
                        left = _cost(costs, inside, axis, new[y, x], old[v, u])
                    stay = min(stay, left + right)
                    share = min(max(stay // 2, stay - left), right)
                    keep[first] += share
                    keep[second] += stay - share
                    beside[first, axis], beside[second, axis + 2] = second, first
                    capacity[first, axis] = right - share
                    capacity[second, axis + 2] = left - (stay - share)
                elif one == FREE:
                    fixed = new[v, u] if other == FILLED else old[v, u]
                    keep[first] += _cost(costs, inside, axis, old[y, x], fixed)
                    take[first] += _cost(costs, inside, axis, new[y, x], fixed)
                else:
                    fixed = new[y, x] if one == FILLED else old[y, x]
                    keep[second] += _cost(costs, inside, axis, fixed, old[v, u])
                    take[second] += _cost(costs, inside, axis, fixed, new[v, u])
    reaches = _push_flow(keep, take, beside, capacity)
    for y in range(height):
        for x in range(width):
            taken[y, x] = state[y, x] == FILLED or (state[y, x] == FREE and reaches[node[y, x]] >= 0)


@compiled
def window_cost(costs, inside, price, old, new, state, taken):
    """Cost of a window whose ``taken`` pixels have their new sources, see `cut_window`.

    Of all seams but those between kept pixels or beside absent ones, with the price of pixels that may take either.
    """
    total = np.int64(0)
    if price.size:
        for y in range(state.shape[0]):
            for x in range(state.shape[1]):
                if state[y, x] == FREE:
                    source = new[y, x] if taken[y, x] else old[y, x]
                    total += price[source[0], source[1]]
    for axis in range(2):
        for y in range(state.shape[0] - (axis == 0)):
            for x in range(state.shape[1] - (axis == 1)):
                v, u = y + (axis == 0), x + (axis == 1)
                one, other = state[y, x], state[v, u]
                if one == ABSENT or other == ABSENT or (one == KEPT and other == KEPT):
                    continue
                first = new[y, x] if taken[y, x] else old[y, x]
                second = new[v, u] if taken[v, u] else old[v, u]
                total += _cost(costs, inside, axis, first, second)
    return total


@inner
def _in_one_piece(axis, old, new, y, x, v, u):
    """Whether the old sources of two neighbours are neighbours too, and their new ones."""
    down, across = 1 - axis, axis
    return (
        old[y, x, 0] + down == old[v, u, 0]
        and old[y, x, 1] + across == old[v, u, 1]
        and new[y, x, 0] + down == new[v, u, 0]
        and new[y, x, 1] + across == new[v, u, 1]
    )


@inner
def _cost(costs, inside, axis, one, other):
    """Of a seam: twice where both sources are inside of cells, or one is and the other of another exemplar."""
    cost = seam_cost(costs, axis, one[0], one[1], other[0], other[1])
    if cost == 0 or inside.size == 0:
        return cost
    last, end = inside.shape[0] - 1, inside.shape[1] - 1
    first = inside[min(max(one[0], 0), last), min(max(one[1], 0), end)]
    second = inside[min(max(other[0], 0), last), min(max(other[1], 0), end)]
    twice = (first > 0 and second > 0) or ((first > 0 or second > 0) and first + second != 0)
    return 2 * cost if twice else cost


@inner
def _push_flow(keep, take, beside, capacity):
    """Push a maximum flow from ``take``, arcs from the source, to ``keep``, arcs to the sink, by Dinic's levels.

    What is left of all arcs remains in place. Returns how many arcs with capacity left lead from each node to the
    sink, -1 where none do: what still reaches the sink takes the new source.

    Parameters
    ----------
    keep, take : (n,) int64
    beside : (n, 4) int32, neighbour below, right, above and left; -1 for none
    capacity : (n, 4) int64, to the neighbour on each side
    """
    count = len(keep)
    for node in range(count):
        both = min(keep[node], take[node])
        keep[node] -= both
        take[node] -= both
    level = np.empty(count, np.int32)
    side_of = np.empty(count, np.int8)
    queue = np.empty(count, np.int32)
    path = np.empty(count + 1, np.int32)
    while True:
        level[:] = -1
        last, wanting = 0, 0
        for node in range(count):
            if keep[node] > 0:
                level[node] = 0
                queue[last] = node
                last += 1
            elif take[node] > 0:
                wanting += 1
        first, reached = 0, 0
        while first < last and (wanting == 0 or reached < wanting):
            node = queue[first]
            first += 1
            if take[node] > 0:
                reached += 1
            for side in range(4):
                other = beside[node, side]
                if other >= 0 and level[other] < 0 and capacity[other, (side + 2) % 4] > 0:
                    level[other] = level[node] + 1
                    queue[last] = other
                    last += 1
        if reached == 0:
            return level
        side_of[:] = 0
        for index in range(last):
            node = queue[index]
            if take[node] > 0:
                _push(keep, take, beside, capacity, level, side_of, path, node)


@inner
def _push(keep, take, beside, capacity, level, side_of, path, start):
    """Push what ``start`` can take along paths of falling levels."""
    length = 0
    path[0] = start
    while True:
        node = path[length]
        if keep[node] > 0:
            amount = min(take[start], keep[node])
            for index in range(length):
                amount = min(amount, capacity[path[index], side_of[path[index]]])
            take[start] -= amount
            keep[node] -= amount
            full = length
            for index in range(length - 1, -1, -1):
                own, side = path[index], side_of[path[index]]
                capacity[own, side] -= amount
                capacity[path[index + 1], (side + 2) % 4] += amount
                if capacity[own, side] == 0:
                    full = index
            if take[start] == 0:
                return
            length = full  # on from the first arc that is full
            continue
        while side_of[node] < 4:
            side = side_of[node]
            other = beside[node, side]
            if other >= 0 and capacity[node, side] > 0 and 0 <= level[other] == level[node] - 1:
                break
            side_of[node] += 1
        if side_of[node] < 4:
            length += 1
            path[length] = beside[node, side_of[node]]
        elif length == 0:
            return
        else:
            level[node] = _BLOCKED
            length -= 1
            side_of[path[length]] += 1
