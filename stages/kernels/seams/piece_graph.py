"""Pieces of a picture, and a minimum cut in the graph of what lies beside what."""

import numpy as np

from texloom.stages.kernels.core.compiled import compiled, inner

_BLOCKED = -2  # level of a node from which nothing more flows before the next levels


@compiled
def number_pieces(value, number):
    """Number the connected parts of equal ``value``, in the order of their first pixels; returns their number.

    Parameters
    ----------
    value : (h, w) int64
    number : (h, w) int64, output; neighbours are those above, below, left and right
    """
    height, width = value.shape
    number[:] = -1
    waiting = np.empty(value.size, np.int64)
    count = 0
    for first in range(value.size):
        if number[first // width, first % width] >= 0:
            continue
        number[first // width, first % width] = count
        waiting[0], length = first, 1
        while length > 0:
            length -= 1
            y, x = waiting[length] // width, waiting[length] % width
            for step in range(4):
                v, u = y + (step == 0) - (step == 1), x + (step == 2) - (step == 3)
                inside = 0 <= v < height and 0 <= u < width
                if inside and number[v, u] < 0 and value[v, u] == value[y, x]:
                    number[v, u] = count
                    waiting[length] = v * width + u
                    length += 1
        count += 1
    return count


@compiled
def cut_graph(price, first, second, apart, moved):
    """Fill ``moved`` with the nodes that move so that all costs least; of equal choices, that which moves fewest.

    By a maximum flow, from what would rather stay to what would rather move, by Dinic's levels.

    Parameters
    ----------
    price : (n,) int64, of moving a node; below 0 where that saves
    first, second : (m,) int64, ends of each edge
    apart : (m,) int64, cost of an edge of which the second end moves and the first does not, 0 or more
    moved : (n,) bool, output
    """
    count, edges = len(price), len(apart)
    begin = np.zeros(count + 1, np.int64)  # of a node's arcs
    for edge in range(edges):
        begin[first[edge] + 1] += 1
        begin[second[edge] + 1] += 1
    for node in range(count):
        begin[node + 1] += begin[node]
    place = begin[:count].copy()
    other, back = np.empty(2 * edges, np.int64), np.empty(2 * edges, np.int64)  # end of an arc, and its reverse
    capacity = np.zeros(2 * edges, np.int64)
    for edge in range(edges):
        one, two = place[first[edge]], place[second[edge]]
        place[first[edge]] += 1
        place[second[edge]] += 1
        other[one], other[two], back[one], back[two] = second[edge], first[edge], two, one
        capacity[one] = apart[edge]
    take, keep = np.maximum(price, 0), np.maximum(-price, 0)  # arcs from the source, and to the sink
    level, queue, path = np.empty(count, np.int64), np.empty(count, np.int64), np.empty(count + 1, np.int64)
    while True:
        level[:] = -1
        last, wanting = 0, 0
        for node in range(count):
            if keep[node] > 0:
                level[node] = 0
                queue[last] = node
                last += 1
        at = 0
        while at < last:
            node = queue[at]
            at += 1
            wanting += take[node] > 0
            for arc in range(begin[node], begin[node + 1]):
                if level[other[arc]] < 0 and capacity[back[arc]] > 0:
                    level[other[arc]] = level[node] + 1
                    queue[last] = other[arc]
                    last += 1
        if wanting == 0:
            break
        place[:] = begin[:count]  # the arc that is looked at next
        for index in range(last):
            if take[queue[index]] > 0:
                _push_along(keep, take, begin, other, back, capacity, level, place, path, queue[index])
    for node in range(count):
        moved[node] = level[node] >= 0


@inner
def _push_along(keep, take, begin, other, back, capacity, level, place, path, start):
    """Push what ``start`` can take along paths of falling levels; ``path`` holds arcs."""
    length, node = 0, start
    while True:
        if keep[node] > 0:
            amount = min(take[start], keep[node])
            for index in range(length):
                amount = min(amount, capacity[path[index]])
            take[start] -= amount
            keep[node] -= amount
            full = length
            for index in range(length - 1, -1, -1):
                capacity[path[index]] -= amount
                capacity[back[path[index]]] += amount
                if capacity[path[index]] == 0:
                    full = index
            if take[start] == 0:
                return
            if full < length:  # on from the first arc that is full
                length = full
                node = other[back[path[length]]]
            continue
        while place[node] < begin[node + 1]:
            arc = place[node]
            if capacity[arc] > 0 and 0 <= level[other[arc]] == level[node] - 1:
                break
            place[node] += 1
        if place[node] < begin[node + 1]:
            path[length] = place[node]
            node = other[place[node]]
            length += 1
        elif length == 0:
            return
        else:
            level[node] = _BLOCKED
            length -= 1
            node = other[back[path[length]]]
            place[node] += 1
