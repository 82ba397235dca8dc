"""Cuts along which cells of an exemplar are laid over a result."""

import numpy as np

from texloom.stages.kernels.core.compiled import compiled
from texloom.stages.kernels.seams.minimum_cut import cut_window, window_cost


@compiled
def cut_cells(costs, inside, old, rows, shifts, state, first, last, taken, totals):
    """Fill ``taken`` with the pixels that take the new source so that all seams in a window cost least.

    Parameters
    ----------
    costs, inside : see `cut_window`
    old : (n, width, 2) int32, sources of the pixels of all windows, one below the other
    rows : (windows + 1,) int64, where each window begins
    shifts : (windows, 3) int64: row and column of the new source of a window's first pixel, and how
        many columns of ``old`` it has
    state : (n, width) int8
    taken : (n, width) bool, filled for windows first..last
    totals : (windows, 2) int64, costs of windows before and after, see `window_cost`
    """
    no_price = np.zeros((0, 0), np.int32)  # a constant array would be of another type
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
        totals[window, 0] = window_cost(costs, inside, no_price, own, own, own_state, own_taken)
        cut_window(costs, inside, no_price, own, new, own_state, own_taken)
        totals[window, 1] = window_cost(costs, inside, no_price, own, new, own_state, own_taken)
        for y in range(height):
            for x in range(width):
                taken[top + y, x] = own_taken[y, x]
