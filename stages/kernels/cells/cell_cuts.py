"""Minimum cuts along which cells of an exemplar are laid over a result, by maximum flow on a grid."""

import numpy as np

from texloom.stages.kernels.core.compiled import compiled

KEPT, FREE, FILLED, ABSENT = 0, 1, 2, 3
"""state of a pixel: keeps its source, may take either, takes the new one, has none"""

_DOWN, _RIGHT, _UP, _LEFT = 0, 1, 2, 3
_LARGE = 1 << 60


@compiled
def cut_cells(lab, slopes, core, offset, unit, most, old, rows, shifts, state, first, last, taken, costs):
    """Fill ``taken`` with the pixels that take the new source so that all seams in a window cost least.

    A seam between two neighbours costs what `SeamCosts` says of squared differences, and twice that where both come
    from the inside of cells. Capacities are whole numbers, so that the cut is the same everywhere; of several
    equal cuts it is the one that takes fewest pixels.

    Parameters
    ----------
    lab : (h, w, c) float32, the exemplar: its CIELAB colours, or more features
    slopes : (2, h, w) float32, its gradients down and across
    core : (h, w) bool, whether a pixel lies inside a cell
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
    for window in range(first, last):
        top, bottom, width = rows[window], rows[window + 1], shifts[window, 2]
        new = np.empty((bottom - top, width, 2), np.int32)
        for y in range(bottom - top):
            for x in range(width):
                new[y, x, 0], new[y, x, 1] = shifts[window, 0] + y, shifts[window, 1] + x
        cut_window(
            lab, slopes, core, offset, unit, most, old[top:bottom, :width], new, state[top:bottom, :width],
            taken[top:bottom, :width], costs[window],
        )  # fmt: skip


@compiled
def _cost(lab, slopes, core, offset, unit, most, axis, y, x, v, u):
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
    return 2 * cost if core[y, x] and core[v, u] else cost


@compiled
def cut_window(lab, slopes, core, offset, unit, most, old, new, state, taken, costs):
    """Fill ``taken`` with the pixels of one window that take their new source, see `cut_cells`.

    Parameters
    ----------
    old, new : (m, n, 2) int32, sources of its pixels
    state : (m, n) int8
    taken : (m, n) bool
    costs : (2,) int64, of all seams before and after
    """
    height, width = state.shape
    capacity = np.zeros((4, height, width), np.int64)  # to the neighbour on each side
    keep, take = np.zeros((height, width), np.int64), np.zeros((height, width), np.int64)
    before = np.int64(0)
    for axis in range(2):
        forth, back = (_DOWN, _UP) if axis == 0 else (_RIGHT, _LEFT)
        for y in range(height - (axis == 0)):
            for x in range(width - (axis == 1)):
                v, u = y + (axis == 0), x + (axis == 1)
                one, other = state[y, x], state[v, u]
                if (one == KEPT and other == KEPT) or ABSENT in (one, other):
                    continue
                a, b, c, d = old[y, x, 0], old[y, x, 1], old[v, u, 0], old[v, u, 1]
                stay = _cost(lab, slopes, core, offset, unit, most, axis, a, b, c, d)
                before += stay
                if FREE not in (one, other):
                    continue
                e, f, g, h = new[y, x, 0], new[y, x, 1], new[v, u, 0], new[v, u, 1]
                right = _cost(lab, slopes, core, offset, unit, most, axis, a, b, g, h)
                left = _cost(lab, slopes, core, offset, unit, most, axis, e, f, c, d)
                if one == FREE and other == FREE:
                    stay = min(stay, left + right)
                    share = min(max(stay // 2, stay - left), right)
                    keep[y, x] += share
                    keep[v, u] += stay - share
                    capacity[forth, y, x] += right - share
                    capacity[back, v, u] += left - (stay - share)
                elif one == FREE:
                    keep[y, x] += right if other == FILLED else stay
                    take[y, x] += 0 if other == FILLED else left
                else:
                    keep[v, u] += left if one == FILLED else stay
                    take[v, u] += 0 if one == FILLED else right
    _flow(keep, take, capacity, state)
    # what still reaches the sink takes the new source
    stack = np.empty(height * width, np.int64)
    count = 0
    for y in range(height):
        for x in range(width):
            taken[y, x] = state[y, x] == FILLED or (state[y, x] == FREE and keep[y, x] > 0)
            if taken[y, x] and state[y, x] == FREE:
                stack[count] = y * width + x
                count += 1
    while count > 0:
        count -= 1
        y, x = stack[count] // width, stack[count] % width
        for side in range(4):
            v, u = y + (side == _DOWN) - (side == _UP), x + (side == _RIGHT) - (side == _LEFT)
            if v < 0 or u < 0 or v >= height or u >= width or state[v, u] != FREE or taken[v, u]:
                continue
            if capacity[(side + 2) % 4, v, u] > 0:
                taken[v, u] = True
                stack[count] = v * width + u
                count += 1
    after = np.int64(0)
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
                    lab, slopes, core, offset, unit, most, axis, first[0], first[1], second[0], second[1]
                )
    costs[0], costs[1] = before, after


@compiled
def _flow(keep, take, capacity, state):
    """Push a maximum flow from ``take``, arcs from the source, to ``keep``, arcs to the sink, by Dinic's levels.

    What is left of all arcs remains in place.
    """
    height, width = keep.shape
    for y in range(height):
        for x in range(width):
            both = min(keep[y, x], take[y, x])
            keep[y, x] -= both
            take[y, x] -= both
    level = np.empty((height, width), np.int32)
    side_of = np.empty((height, width), np.int8)
    queue = np.empty(height * width, np.int64)
    path = np.empty(height * width + 1, np.int64)
    while True:
        level[:] = -1
        first = last = 0
        for y in range(height):
            for x in range(width):
                if state[y, x] == FREE and take[y, x] > 0:
                    level[y, x] = 0
                    queue[last] = y * width + x
                    last += 1
        reached = False
        while first < last:
            y, x = queue[first] // width, queue[first] % width
            first += 1
            if keep[y, x] > 0:
                reached = True
            for side in range(4):
                if capacity[side, y, x] <= 0:
                    continue
                v, u = y + (side == _DOWN) - (side == _UP), x + (side == _RIGHT) - (side == _LEFT)
                if level[v, u] < 0:
                    level[v, u] = level[y, x] + 1
                    queue[last] = v * width + u
                    last += 1
        if not reached:
            return
        side_of[:] = 0
        for index in range(last):
            start = queue[index]
            if level[start // width, start % width] > 0:
                break
            while take[start // width, start % width] > 0:
                if not _augmented(keep, take, capacity, level, side_of, path, start, width):
                    break


@compiled
def _augmented(keep, take, capacity, level, side_of, path, start, width):
    """Push flow along one path of rising levels; whether there is one."""
    length = 0
    path[0] = start
    while True:
        y, x = path[length] // width, path[length] % width
        if keep[y, x] > 0:
            break
        moved = False
        while side_of[y, x] < 4:
            side = side_of[y, x]
            if capacity[side, y, x] > 0:
                v, u = y + (side == _DOWN) - (side == _UP), x + (side == _RIGHT) - (side == _LEFT)
                if level[v, u] == level[y, x] + 1:
                    length += 1
                    path[length] = v * width + u
                    moved = True
                    break
            side_of[y, x] += 1
        if moved:
            continue
        if length == 0:
            return False
        level[y, x] = -1
        length -= 1
        side_of[path[length] // width, path[length] % width] += 1
    y, x = path[length] // width, path[length] % width
    amount = min(take[start // width, start % width], keep[y, x])
    for index in range(length):
        v, u = path[index] // width, path[index] % width
        amount = min(amount, capacity[side_of[v, u], v, u])
    take[start // width, start % width] -= amount
    keep[y, x] -= amount
    for index in range(length):
        v, u = path[index] // width, path[index] % width
        side = side_of[v, u]
        capacity[side, v, u] -= amount
        y, x = path[index + 1] // width, path[index + 1] % width
        capacity[(side + 2) % 4, y, x] += amount
    return True
