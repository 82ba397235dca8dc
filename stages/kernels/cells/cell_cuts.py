"""Cuts along which cells of an exemplar are laid over a result."""

import numpy as np

from texloom.stages.kernels.core.compiled import compiled
from texloom.stages.kernels.seams.minimum_cut import NO_PRICE, cut_window


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
    totals : (windows, 2) int64, see `cut_window`
    """
    for window in range(first, last):
        top, bottom, width = rows[window], rows[window + 1], shifts[window, 2]
        new = np.empty((bottom - top, width, 2), np.int32)
        for y in range(bottom - top):
            for x in range(width):
                new[y, x, 0], new[y, x, 1] = shifts[window, 0] + y, shifts[window, 1] + x
        own = slice(top, bottom), slice(0, width)
        cut_window(costs, inside, NO_PRICE, old[own], new, state[own], taken[own], totals[window])
