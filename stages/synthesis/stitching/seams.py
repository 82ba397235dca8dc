"""Seam costs between patches, and graph cuts that lay a patch over others, by maximum flow."""

from typing import TypeAlias

import numpy as np
from jaxtyping import Bool, Float32, Int8, Int32, Int64

from texloom.stages.kernels.seams.window_state import FILLED, FREE
from texloom.stages.vocabulary.scratch import bands

UNIT = 512
"""fixed-point steps of a seam's cost: capacities are integers, so that sums are exact"""

MAX_COST = 80 * UNIT
_AXES = ((1, 0), (0, 1))  # steps from a pixel to its neighbours below and to the right

Sources: TypeAlias = Int32[np.ndarray, "m n 2"]
"""the exemplar pixel that a pixel comes from"""


class SeamCosts:
    """Costs of seams between patches of one exemplar.

    Two neighbours s and t from patches A and B cost |A(s) - B(s)| + |A(t) - B(t)|. Beyond its border the exemplar
    is extended by its outermost pixels.

    Parameters
    ----------
    features : of the exemplar, (h, w, c).
    gradients : divide by the sum of the gradients of both patches at both pixels along their axis.
    squared : sum squares, so that many small differences cost less than a visible one, which should be 1.
    offset : added to gradients, so that seams in flat places have a finite cost.
    """

    def __init__(
        self, features: Float32[np.ndarray, "h w c"], gradients: bool, squared: bool = False, offset: float = 0.5
    ):
        self.shape = height, width = features.shape[:2]
        self.slopes = np.empty((2, height, width) if gradients else (0, 0, 0), np.float32)
        """of each axis and pixel"""
        last = height - 1
        for band in bands(height) if gradients else ():
            rows = np.arange(height)[band]
            wide = np.pad(features[band], ((0, 0), (1, 1), (0, 0)), mode="edge")
            down = features[np.minimum(rows + 1, last)] - features[np.maximum(rows - 1, 0)]
            for slopes, difference in zip(self.slopes, (down, wide[:, 2:] - wide[:, :-2]), strict=True):
                slopes[band] = np.linalg.norm(difference, axis=2) / 2
        unit, most = np.float32(UNIT), np.float32(MAX_COST)
        self.given = (np.ascontiguousarray(features), self.slopes, np.float32(offset), unit, most, squared)
        """for kernels, see `seam_cost`"""

    def between(
        self, axis: int, one: Int32[np.ndarray, "n 2"], other: Int32[np.ndarray, "n 2"]
    ) -> Int64[np.ndarray, "n"]:  # type: ignore[name-defined]
        """Cost of each pair of neighbours along ``axis`` with sources ``one`` and ``other`` in the exemplar."""
        from texloom.stages.kernels.seams.seam_costs import seam_costs

        found = np.empty(len(one), np.int64)
        seam_costs(self.given, axis, one, other, found)
        return found


def pairs(array: np.ndarray, axis: int) -> tuple[np.ndarray, np.ndarray]:
    """The array without its last, and without its first, row or column: both pixels of all neighbours."""
    return (array[:-1], array[1:]) if axis == 0 else (array[:, :-1], array[:, 1:])


def cheapest_cut(
    costs: SeamCosts, old: Sources, new: Sources, state: Int8[np.ndarray, "m n"]
) -> tuple[Bool[np.ndarray, "m n"], int]:
    """The pixels that take the new patch so that all seams cost least, and the saving over taking no free pixel.

    Old seams count: those that the new patch covers are saved, those that remain are not.

    Parameters
    ----------
    old, new : sources of the pixels before and after; ``new`` is one patch. Any values where ``state`` excludes
    them. state : `ABSENT`, `KEPT`, `FREE` or `FILLED`.

    References
    ----------
    [Kwatra2003]_ sections 3.1 and 3.2. Old seams are arcs between pixels and to the terminals instead of nodes of
    their own, which gives the same cut ([Kolmogorov2004]_ section 4.1). Where costs break the triangle inequality
    an old seam counts as no more than both new ones.
    """
    from texloom.stages.kernels.seams.minimum_cut import NO_CELLS, NO_PRICE, cut_window, window_cost

    filled = state == FILLED
    if not (state == FREE).any():
        return filled, 0
    window = costs.given, NO_CELLS, NO_PRICE, *map(np.ascontiguousarray, (old, new, state))
    taken = np.empty(state.shape, bool)
    cut_window(*window, taken)
    saved = int(window_cost(*window, filled) - window_cost(*window, taken))
    return (filled, 0) if saved < 0 else (taken, saved)
