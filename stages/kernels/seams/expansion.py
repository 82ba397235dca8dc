"""Expansion moves in tiles of a result: displacements spread along minimum cuts."""

import numpy as np

from texloom.stages.kernels.core.compiled import compiled, inner
from texloom.stages.kernels.seams.minimum_cut import cut_window, window_cost
from texloom.stages.kernels.seams.seam_costs import seam_cost
from texloom.stages.kernels.seams.window_state import FILLED, FREE, KEPT

_FACTOR = 1 << 24  # sides of pictures are smaller


@compiled
def expand_in_tiles(costs, price, places, source, tiles, least, first, last):
    """Let the most frequent displacements of each tile spread over its inside where that makes its seams cheaper.

    Seams are looked at in every second row and column, where displacements are halved.

    Parameters
    ----------
    costs, price : see `cut_window`; of the exemplar at half its size
    places : (h, w) bool, which pixels of the exemplar may be sources
    source : (2, H, W) int32, sources of the result's pixels, changed in place
    tiles : (n, 4) int64, first row and column, height and width; those that go beyond the result go on at its
        other side; no two overlap
    least : (2,) int64: pixels that a displacement needs to spread; and cost of seams that a tile needs, in steps
    first, last : the tiles that are looked at
    """
    no_cells = np.zeros((0, 0), np.int16)  # a constant array would be of another type
    for tile in range(first, last):
        top, left = tiles[tile, 0], tiles[tile, 1]
        height, width = tiles[tile, 2] // 2, tiles[tile, 3] // 2
        shift = np.empty((height, width, 2), np.int64)  # at full size
        old = np.empty((height, width, 2), np.int32)
        for y in range(height):
            for x in range(width):
                for axis in range(2):
                    at = source[axis, (top + 2 * y) % source.shape[1], (left + 2 * x) % source.shape[2]]
                    shift[y, x, axis] = at - (2 * x if axis else 2 * y)
                    old[y, x, axis] = at // 2
        state = np.full((height, width), KEPT, np.int8)
        new, taken = np.zeros(old.shape, np.int32), np.zeros((height, width), np.bool_)
        state[1:-1, 1:-1] = FILLED
        if window_cost(costs, no_cells, price, old, old, state, taken) < least[1]:
            continue
        for value in _most_frequent(shift, least[0]):
            down, across = value // _FACTOR - _FACTOR // 2, value % _FACTOR - _FACTOR // 2
            for y in range(1, height - 1):
                for x in range(1, width - 1):
                    row, column = 2 * y + down, 2 * x + across
                    state[y, x] = KEPT
                    if shift[y, x, 0] == down and shift[y, x, 1] == across:
                        state[y, x] = FILLED
                        new[y, x, 0], new[y, x, 1] = old[y, x, 0], old[y, x, 1]
                    elif _block_may_be(places, row, column):
                        state[y, x] = FREE
                        new[y, x, 0], new[y, x, 1] = row // 2, column // 2
            cut_window(costs, no_cells, price, old, new, state, taken)
            if _saving(costs, price, old, new, state, taken) <= 0:
                continue
            for y in range(1, height - 1):
                for x in range(1, width - 1):
                    if state[y, x] != FREE or not taken[y, x]:
                        continue
                    shift[y, x, 0], shift[y, x, 1] = down, across
                    old[y, x, 0], old[y, x, 1] = new[y, x, 0], new[y, x, 1]
                    for row in range(2 * y, 2 * y + 2):
                        for column in range(2 * x, 2 * x + 2):
                            v, u = (top + row) % source.shape[1], (left + column) % source.shape[2]
                            source[0, v, u], source[1, v, u] = row + down, column + across


@inner
def _saving(costs, price, old, new, state, taken):
    """What the window's seams and sources cost less, see `window_cost`, where new sources are taken."""
    saved = np.int64(0)
    for y in range(1, state.shape[0] - 1):
        for x in range(1, state.shape[1] - 1):
            if state[y, x] != FREE or not taken[y, x]:
                continue
            one, own = old[y, x], new[y, x]
            if price.size:
                saved += price[one[0], one[1]] - price[own[0], own[1]]
            for axis in range(2):
                for side in (-1, 1):
                    v, u = y + side * (1 - axis), x + side * axis
                    moves = state[v, u] == FREE and taken[v, u]
                    if moves and side < 0:
                        continue  # seen from there
                    other = old[v, u]
                    then = new[v, u] if moves else other
                    if side > 0:
                        saved += seam_cost(costs, axis, one[0], one[1], other[0], other[1])
                        saved -= seam_cost(costs, axis, own[0], own[1], then[0], then[1])
                    else:
                        saved += seam_cost(costs, axis, other[0], other[1], one[0], one[1])
                        saved -= seam_cost(costs, axis, then[0], then[1], own[0], own[1])
    return saved


@inner
def _block_may_be(places, row, column):
    """Whether four pixels may be sources."""
    if not (0 <= row < places.shape[0] - 1 and 0 <= column < places.shape[1] - 1):
        return False
    upper, lower = places[row], places[row + 1]
    return upper[column] and upper[column + 1] and lower[column] and lower[column + 1]


@inner
def _most_frequent(shift, least):
    """Displacements of at least so many pixels as one number each: the most frequent first, of equals the smallest.

    Without functions of NumPy, which Numba would import much for.
    """
    height, width = shift.shape[:2]
    values, counts = np.empty(height * width, np.int64), np.empty(height * width, np.int64)
    known, last = 0, 0
    for y in range(height):
        for x in range(width):
            value = (shift[y, x, 0] + _FACTOR // 2) * _FACTOR + shift[y, x, 1] + _FACTOR // 2
            if known == 0 or values[last] != value:  # neighbours mostly have the same
                last = 0
                while last < known and values[last] != value:
                    last += 1
                if last == known:
                    values[known], counts[known] = value, 0
                    known += 1
            counts[last] += 1
    frequent = 0
    while True:
        best = frequent
        for index in range(frequent, known):
            if counts[index] > counts[best] or (counts[index] == counts[best] and values[index] < values[best]):
                best = index
        if frequent == known or counts[best] < least:
            return values[:frequent]
        for array in (values, counts):
            array[frequent], array[best] = array[best], array[frequent]
        frequent += 1
