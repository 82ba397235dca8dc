"""Seam costs between patches, and graph cuts that lay a patch over others, by maximum flow."""

from typing import TypeAlias

import numpy as np
from jaxtyping import Bool, Float32, Int8, Int32, Int64

from texloom.stages.vocabulary.scratch import bands

UNIT = 512
"""fixed-point steps of a seam's cost: capacities are integers, so that sums are exact"""

MAX_COST = 80 * UNIT
_AXES = ((1, 0), (0, 1))  # steps from a pixel to its neighbours below and to the right

ABSENT, KEPT, FREE, FILLED = range(4)
"""state of a pixel: outside, keeps its patch, may take either, takes the new patch"""

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
        self.squared, self.offset = squared, offset
        self.shape = features.shape[:2]
        self.pixels = features.reshape(-1, features.shape[2])
        self.slopes = np.empty((2 * gradients, len(self.pixels)), features.dtype)
        """of each axis and pixel"""
        last = self.shape[0] - 1
        for band in bands(self.shape[0]) if gradients else ():
            rows = np.arange(self.shape[0])[band]
            wide = np.pad(features[band], ((0, 0), (1, 1), (0, 0)), mode="edge")
            down = features[np.minimum(rows + 1, last)] - features[np.maximum(rows - 1, 0)]
            for slopes, difference in zip(self.slopes, (down, wide[:, 2:] - wide[:, :-2]), strict=True):
                slopes.reshape(self.shape)[band] = np.linalg.norm(difference, axis=2) / 2

    def between(
        self, axis: int, one: Int32[np.ndarray, "n 2"], other: Int32[np.ndarray, "n 2"]
    ) -> Int64[np.ndarray, "n"]:  # type: ignore[name-defined]
        """Cost of each pair of neighbours along ``axis`` with sources ``one`` and ``other`` in the exemplar."""
        cost = np.zeros(len(one), np.int64)
        seam = np.flatnonzero((one + _AXES[axis] != other).any(axis=1))
        here, there = one[seam], other[seam]
        places = [self._flat(at) for at in (here, here + _AXES[axis], there - _AXES[axis], there)]
        first, second, third, fourth = (self.pixels.take(at, axis=0) for at in places)
        squares = [((a - b) ** 2).sum(axis=1) for a, b in ((first, third), (second, fourth))]
        value = sum(squares if self.squared else [np.sqrt(square) for square in squares])
        if len(self.slopes):
            value = value / (sum(self.slopes[axis].take(at) for at in places) + np.float32(self.offset))
        cost[seam] = np.minimum(np.rint(value * np.float32(UNIT)), MAX_COST).astype(np.int64)
        return cost

    def _flat(self, at: np.ndarray) -> np.ndarray:
        return np.asarray(np.ravel_multi_index((at[:, 0], at[:, 1]), self.shape, mode="clip"))


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
    filled = state == FILLED
    if not (state == FREE).any():
        return filled, 0
    taken = filled.copy()
    from texloom.stages.kernels.cells.cell_cuts import push_flow

    taken[state == FREE] = push_flow(*_graph(costs, old, new, state)) >= 0
    untouched, changed = (
        _energy(costs, np.where(chosen[..., None], new, old), state) for chosen in (filled, taken)
    )
    if changed > untouched:
        return filled, 0
    return taken, untouched - changed


def _graph(
    costs: SeamCosts, old: Sources, new: Sources, state: Int8[np.ndarray, "m n"]
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Terminal costs of keeping and of replacing each free pixel, its neighbours and arcs to these."""
    node = np.full(state.shape, -1, np.int32)
    free = state == FREE
    count = int(free.sum())
    node[free] = np.arange(count)
    keep, take = np.zeros(count, np.int64), np.zeros(count, np.int64)
    beside, capacity = np.full((count, 4), -1, np.int32), np.zeros((count, 4), np.int64)
    for axis in (0, 1):
        states = pairs(state, axis)
        nodes = pairs(node, axis)
        olds, news = pairs(old, axis), pairs(new, axis)
        fixed = pairs((state == KEPT) | (state == FILLED), axis)
        fixed_sources = pairs(np.where((state == FILLED)[..., None], new, old), axis)

        both = (states[0] == FREE) & (states[1] == FREE)
        s, t = nodes[0][both], nodes[1][both]
        stay = costs.between(axis, olds[0][both], olds[1][both])
        right = costs.between(axis, olds[0][both], news[1][both])
        left = costs.between(axis, news[0][both], olds[1][both])
        stay = np.minimum(stay, left + right)
        share = np.clip(stay // 2, stay - left, right)
        np.add.at(keep, s, share)
        np.add.at(keep, t, stay - share)
        beside[s, axis], beside[t, axis + 2] = t, s
        capacity[s, axis], capacity[t, axis + 2] = right - share, left - (stay - share)

        for a, b in ((0, 1), (1, 0)):
            edge = (states[a] == FREE) & fixed[b]
            for terminal, own in ((keep, olds[a]), (take, news[a])):
                pair = (own[edge], fixed_sources[b][edge])
                np.add.at(terminal, nodes[a][edge], costs.between(axis, *(pair if a == 0 else pair[::-1])))
    return keep, take, beside, capacity


def _energy(costs: SeamCosts, match: Sources, state: Int8[np.ndarray, "m n"]) -> int:
    total = 0
    for axis in (0, 1):
        first, second = pairs(state != ABSENT, axis)
        present = first & second
        one, other = pairs(match, axis)
        total += int(costs.between(axis, one[present], other[present]).sum())
    return total
