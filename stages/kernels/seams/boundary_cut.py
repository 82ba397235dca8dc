"""Minimum cuts through a strip, from its first row to its last, and around a rectangle."""

import numpy as np

from texloom.stages.kernels.core.compiled import compiled, inner


@compiled
def cheapest_path(errors, path):
    """Fill ``path`` with the column of every row on the path whose errors sum to the least.

    A path moves at most one column from a row to the next. Of equal paths, the leftmost at the last row that
    differs is taken.

    Parameters
    ----------
    errors : (n, m) float32, at least one row and column
    path : (n,) int64
    """
    rows, columns = errors.shape
    total = np.empty((rows, columns), np.float64)
    for x in range(columns):
        total[0, x] = errors[0, x]
    for y in range(1, rows):
        for x in range(columns):
            least = total[y - 1, x]
            if x > 0:
                least = min(least, total[y - 1, x - 1])
            if x + 1 < columns:
                least = min(least, total[y - 1, x + 1])
            total[y, x] = least + errors[y, x]
    at = 0
    for x in range(1, columns):
        if total[rows - 1, x] < total[rows - 1, at]:
            at = x
    path[rows - 1] = at
    for y in range(rows - 2, -1, -1):
        best = max(at - 1, 0)
        for x in range(best + 1, min(at + 1, columns - 1) + 1):
            if total[y, x] < total[y, best]:
                best = x
        at = best
        path[y] = at


@inner
def _between(errors, row, column, other_row, other_column):
    """Cost of a cut between two neighbours."""
    one, other = errors[row, column], errors[other_row, other_column]
    return 0.0 if one < 0 or other < 0 else np.float64(one) + np.float64(other)


@inner
def _push(queue, corners, length, cost, corner):
    """Add to a binary heap; its new length."""
    at = length
    while at > 0:
        above = (at - 1) // 2
        if queue[above] <= cost:
            break
        queue[at], corners[at] = queue[above], corners[above]
        at = above
    queue[at], corners[at] = cost, corner
    return length + 1


@inner
def _pop(queue, corners, length):
    """Take the least off a binary heap, which its last entry then replaces; its new length."""
    length -= 1
    cost, corner = queue[length], corners[length]
    at = 0
    while 2 * at + 1 < length:
        below = 2 * at + 1
        if below + 1 < length and queue[below + 1] < queue[below]:
            below += 1
        if queue[below] >= cost:
            break
        queue[at], corners[at] = queue[below], corners[below]
        at = below
    queue[at], corners[at] = cost, corner
    return length


@inner
def _spread(errors, core, gate, target, limit, cost, came):
    """The first end of cheapest paths from below the core, or from ``target`` back to it; -1 beyond ``limit``.

    ``cost`` and ``came`` tell of each corner what it took to come there, and in which step.
    """
    top, bottom, left, right = core
    rows, columns = errors.shape
    width = columns + 1
    queue = np.empty(4 * cost.size, np.float64)
    corners = np.empty(4 * cost.size, np.int64)
    length = np.int64(0)  # a literal would have a type of its own, for which `_push` and `_pop` are compiled again
    for i in range(rows + 1):
        for j in range(width):
            cost[i, j], came[i, j] = np.inf, 4
    for i in range(bottom, rows):
        if target < 0 or i == target:
            cost[i, gate + 1] = _between(errors, i - 1, gate, i, gate)
            if cost[i, gate + 1] < limit:
                length = _push(queue, corners, length, cost[i, gate + 1], i * width + gate + 1)
    while length:
        known, corner = queue[0], corners[0]
        length = _pop(queue, corners, length)
        i, j = corner // width, corner % width
        if known > cost[i, j]:
            continue  # it was reached for less since
        if j == gate and (i == target or (target < 0 and i >= bottom)):
            return i
        for step in range(4):
            to_i = i + (step == 0) - (step == 1)
            to_j = j + (step == 2) - (step == 3)
            if not (1 <= to_i < rows and 1 <= to_j < columns):
                continue
            if step < 2 and top <= min(i, to_i) < bottom and left < j < right:
                continue  # it would cut the core
            if step >= 2 and left <= min(j, to_j) < right and top < i < bottom:
                continue
            if step < 2:
                through = known + _between(errors, min(i, to_i), j - 1, min(i, to_i), j)
            elif i >= bottom and min(j, to_j) == gate:
                continue
            else:
                through = known + _between(errors, i - 1, min(j, to_j), i, min(j, to_j))
            if through < cost[to_i, to_j] and through < limit:
                cost[to_i, to_j] = through
                came[to_i, to_j] = step
                length = _push(queue, corners, length, through, to_i * width + to_j)
    return -1


@inner
def _trace(came, end, gate, steps):
    """Mark the pixels to whose left the path to ``end`` goes up or down; whether it began where it ends."""
    steps[:] = False
    i, j = end, gate
    while came[i, j] != 4:
        if came[i, j] < 2:
            before = i - 1 if came[i, j] == 0 else i + 1
            steps[min(i, before), j] = True
            i = before
        else:
            j += -1 if came[i, j] == 2 else 1
    return i == end


@compiled
def cheapest_loop(errors, core, limit, inside):
    """Fill ``inside`` with what the cheapest closed cut around ``core`` encloses; its cost, if below ``limit``.

    The cut runs between pixels, anywhere outside the core and inside the outermost line, and costs the errors of
    the two pixels on its sides for every step. It is a shortest path over the corners of pixels, found from below
    the core around it and back. Where all loops are equal below the core, as where nothing is synthesised there,
    none is cheaper. Elsewhere the best end of all paths becomes the beginning, which may not be optimal.

    Parameters
    ----------
    errors : (m, n) float32; negative where nothing is synthesised yet, beside which a cut is free
    core : (top, bottom, left, right), the rows and columns of a rectangle off the outermost line
    inside : (m, n) bool; of no use where the cost is infinite
    """
    _, _, left, right = core
    rows, columns = errors.shape
    gate = (left + right - 1) // 2  # the pixels below the core through whose left and right borders a loop closes
    cost, came = np.empty((rows + 1, columns + 1)), np.empty((rows + 1, columns + 1), np.uint8)
    end = _spread(errors, core, gate, np.int64(-1), limit, cost, came)
    if end < 0:
        return np.inf
    if not _trace(came, end, gate, inside):
        if _spread(errors, core, gate, end, limit, cost, came) < 0:
            return np.inf
        _trace(came, end, gate, inside)
    # A cut has been crossed where the number of its steps so far is odd.
    for i in range(rows):
        within = False
        for j in range(columns):
            within ^= inside[i, j]
            inside[i, j] = within
    return cost[end, gate]
