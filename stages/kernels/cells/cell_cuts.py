"""Cuts along which cells of an exemplar are laid over a result."""

import numpy as np

from texloom.stages.kernels.seams.minimum_cut import NO_PRICE, cut_window, window_cost


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
    for window in range(first, last):
        view = np.s_[rows[window] : rows[window + 1], : shifts[window, 2]]
        own, own_state = np.ascontiguousarray(old[view]), np.ascontiguousarray(state[view])
        new = np.empty_like(own)
        new[..., 0] = shifts[window, 0] + np.arange(new.shape[0])[:, None]
        new[..., 1] = shifts[window, 1] + np.arange(new.shape[1])
        own_taken = np.zeros(own_state.shape, np.bool_)
        totals[window, 0] = window_cost(costs, inside, NO_PRICE, own, own, own_state, own_taken)
        cut_window(costs, inside, NO_PRICE, own, new, own_state, own_taken)
        totals[window, 1] = window_cost(costs, inside, NO_PRICE, own, new, own_state, own_taken)
        taken[view] = own_taken
