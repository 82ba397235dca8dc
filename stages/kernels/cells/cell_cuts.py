"""Minimum cuts along which cells of an exemplar are laid over a result, by maximum flow on a grid."""

import numpy as np

from texloom.stages.kernels.core.compiled import compiled, inner

KEPT, FREE, FILLED, ABSENT = 0, 1, 2, 3
"""state of a pixel: keeps its source, may take either, takes the new one, has none"""

_DOWN, _RIGHT, _UP, _LEFT = 0, 1, 2, 3
NO_PRICE = np.zeros((0, 0), np.int32)
_BLOCKED = -2  # level of a node from which nothing more flows before the next levels


@compiled
def cut_cells(lab, slopes, inside, offset, unit, most, old, rows, shifts, state, first, last, taken, costs):
    """Fill ``taken`` with the pixels that take the new source so that all seams in a window cost least.

    A seam between two neighbours costs what `SeamCosts` says of squared differences, and twice that where both come
    from the inside of cells, or one does and the other is of another exemplar. Capacities are whole numbers, so
    that the cut is the same everywhere; of several equal cuts it is the one that takes fewest pixels.

    Parameters
    ----------
    lab : (h, w, c) float32, the exemplar: its CIELAB colours, or more features
    slopes : (2, h, w) float32, its gradients down and across
    inside : (h, w) int16, number of each pixel's exemplar, from 1; below 0 where it is not inside a cell, 0 for all
        where there are no cells
    offset : added to gradients
    unit, most : fixed-point steps of a cost of 1, and the greatest cost in steps
    old : (n, width, 2) int32, sources of the pixels of all windows, one below the other
    rows : (windows + 1,) int64, where each window begins
    shifts : (windows, 3) int64: row and column of the new source of a window's first pixel, and how
        many columns of ``old`` it has
    state : (n, width) int8
    taken : (n, width) bool, filled for windows first..last
    costs : (windows, 2) int64, of all seams in a window before and after, but those between kept pixels
    """
    no_price = np.zeros((0, 0), np.int32)
    for window in range(first, last):
        top, height, width = rows[window], rows[window + 1] - rows[window], shifts[window, 2]
        # Contiguous copies: `cut_window` is compiled for such arrays alone.
        own, new = np.empty((height, width, 2), np.int32), np.empty((height, width, 2), np.int32)
        own_state, own_taken = np.empty((height, width), np.int8), np.empty((height, width), np.bool_)
        for y in range(height):
            for x in range(width):
                own[y, x, 0], own[y, x, 1] = old[top + y, x, 0], old[top + y, x, 1]
                new[y, x, 0], new[y, x, 1] = shifts[window, 0] + y, shifts[window, 1] + x
                own_state[y, x] = state[top + y, x]
        cut_window(lab, slopes, inside, offset, unit, most, own, new, own_state, own_taken, costs[window], no_price)
        for y in range(height):
            for x in range(width):
                taken[top + y, x] = own_taken[y, x]


@inner
def _cost(lab, slopes, inside, offset, unit, most, axis, y, x, v, u):
    """Of the seam between a pixel and the next one along ``axis``, with sources (y, x) and (v, u)."""
    down, across = 1 - axis, axis
    if y + down == v and x + across == u:
        return np.int64(0)
    height, width = lab.shape[:2]
    y, x, v, u = (
        min(max(y, 0), height - 1),
        min(max(x, 0), width - 1),
        min(max(v, 0), height - 1),
        min(max(u, 0), width - 1),
    )
    y1, x1 = min(y + down, height - 1), min(x + across, width - 1)
    v0, u0 = max(v - down, 0), max(u - across, 0)
    square = 0.0
    for channel in range(lab.shape[2]):
        here = np.float64(lab[y, x, channel]) - np.float64(lab[v0, u0, channel])
        there = np.float64(lab[y1, x1, channel]) - np.float64(lab[v, u, channel])
        square += here * here + there * there
    slope = np.float64(slopes[axis, y, x]) + np.float64(slopes[axis, y1, x1])
    slope += np.float64(slopes[axis, v0, u0]) + np.float64(slopes[axis, v, u])
    cost = np.int64(min(np.rint(square / (slope + offset) * unit), most))
    one, other = inside[y, x], inside[v, u]
    cut = (one > 0 and other > 0) or ((one > 0 or other > 0) and one + other != 0)
    return 2 * cost if cut else cost


@compiled
def cut_window(lab, slopes, inside, offset, unit, most, old, new, state, taken, costs, price):
    """Fill ``taken`` with the pixels of one window that take their new source, see `cut_cells`.

    Parameters
    ----------
    old, new : (m, n, 2) int32, sources of its pixels
    state : (m, n) int8
    taken : (m, n) bool
    costs : (2,) int64, of all seams before and after, and the price of pixels that may take either
    price : (h, w) int32, of each pixel of the exemplar as a source, in steps; `NO_PRICE` for none
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
    before = np.int64(0)
    if price.size:
        for y in range(height):
            for x in range(width):
                if state[y, x] == FREE:
                    keep[node[y, x]] = price[old[y, x, 0], old[y, x, 1]]
                    take[node[y, x]] = price[new[y, x, 0], new[y, x, 1]]
                    before += keep[node[y, x]]
    for axis in range(2):
        forth, back = (_DOWN, _UP) if axis == 0 else (_RIGHT, _LEFT)
        for y in range(height - (axis == 0)):
            for x in range(width - (axis == 1)):
                v, u = y + (axis == 0), x + (axis == 1)
                one, other = state[y, x], state[v, u]
                if (one == KEPT and other == KEPT) or ABSENT in (one, other):
                    continue
                a, b, c, d = old[y, x, 0], old[y, x, 1], old[v, u, 0], old[v, u, 1]
                stay = _cost(lab, slopes, inside, offset, unit, most, axis, a, b, c, d)
                before += stay
                if FREE not in (one, other):
                    continue
                e, f, g, h = new[y, x, 0], new[y, x, 1], new[v, u, 0], new[v, u, 1]
                right = _cost(lab, slopes, inside, offset, unit, most, axis, a, b, g, h)
                left = _cost(lab, slopes, inside, offset, unit, most, axis, e, f, c, d)
                first, second = node[y, x], node[v, u]
                if one == FREE and other == FREE:
                    stay = min(stay, left + right)
                    share = min(max(stay // 2, stay - left), right)
                    keep[first] += share
                    keep[second] += stay - share
                    beside[first, forth], beside[second, back] = second, first
                    capacity[first, forth] = right - share
                    capacity[second, back] = left - (stay - share)
                elif one == FREE:
                    keep[first] += right if other == FILLED else stay
                    take[first] += 0 if other == FILLED else left
                else:
                    keep[second] += left if one == FILLED else stay
                    take[second] += 0 if one == FILLED else right
    reaches = push_flow(keep, take, beside, capacity)
    for y in range(height):
        for x in range(width):
            taken[y, x] = state[y, x] == FILLED or (node[y, x] >= 0 and reaches[node[y, x]] >= 0)
    after = np.int64(0)
    if price.size:
        for y in range(height):
            for x in range(width):
                if state[y, x] == FREE:
                    chosen = new[y, x] if taken[y, x] else old[y, x]
                    after += price[chosen[0], chosen[1]]
    for axis in range(2):
        for y in range(height - (axis == 0)):
            for x in range(width - (axis == 1)):
                v, u = y + (axis == 0), x + (axis == 1)
                one, other = state[y, x], state[v, u]
                if (one == KEPT and other == KEPT) or ABSENT in (one, other):
                    continue
                first = new[y, x] if taken[y, x] else old[y, x]
                second = new[v, u] if taken[v, u] else old[v, u]
                after += _cost(
                    lab, slopes, inside, offset, unit, most, axis, first[0], first[1], second[0], second[1]
                )
    costs[0], costs[1] = before, after


@compiled
def push_flow(keep, take, beside, capacity):
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
        last = 0
        for node in range(count):
            if keep[node] > 0:
                level[node] = 0
                queue[last] = node
                last += 1
        first, reached = 0, False
        while first < last:
            node = queue[first]
            first += 1
            if take[node] > 0:
                reached = True
            for side in range(4):
                other = beside[node, side]
                if other >= 0 and level[other] < 0 and capacity[other, (side + 2) % 4] > 0:
                    level[other] = level[node] + 1
                    queue[last] = other
                    last += 1
        if not reached:
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
