import itertools

import numpy as np
import pytest

from texloom.stages.kernels.seams.minimum_cut import NO_CELLS, NO_PRICE, cut_window, window_cost
from texloom.stages.kernels.seams.window_state import ABSENT, FILLED, FREE, KEPT
from texloom.stages.synthesis.stitching.seams import SeamCosts, pairs


@pytest.mark.parametrize("gradients", [False, True])
def test_seams_of_a_window_are_summed(gradients: bool, rng: np.random.Generator) -> None:
    """But those between kept pixels, and beside absent ones."""
    costs = SeamCosts(rng.random((9, 8, 3), np.float32), gradients)
    old, new = rng.integers(0, 8, (2, 5, 6, 2)).astype(np.int32)
    state = rng.choice([ABSENT, KEPT, FREE], (5, 6)).astype(np.int8)
    taken = (state == FREE) & (rng.random(state.shape) < 0.5)
    expected = 0
    for axis in (0, 1):
        one, other = pairs(np.where(taken[..., None], new, old), axis)
        counted = np.logical_and(*pairs(state != ABSENT, axis)) & np.logical_or(*pairs(state == FREE, axis))
        expected += costs.between(axis, one[counted], other[counted]).sum()
    assert window_cost(costs.given, NO_CELLS, NO_PRICE, old, new, state, taken) == expected > 0


@pytest.mark.parametrize("gradients", [False, True])
@pytest.mark.parametrize(("old", "new"), [((1, 1), (3, 4)), ((-2, 5), (6, -1))])  # the others beyond the border
def test_between_two_pieces_no_choice_costs_less_than_the_cut(
    gradients: bool, old: tuple[int, int], new: tuple[int, int], rng: np.random.Generator
) -> None:
    """Also where a seam runs through the old one, if no detour costs less than it, as without gradients."""
    here = np.moveaxis(np.indices((5, 5)), 0, 2).astype(np.int32, order="C")
    pieces = [here + np.array(shift, np.int32) for shift in (old, new)]
    if not gradients:
        pieces[0][:, 2:] += np.array([1, -2], np.int32)
    for _ in range(12):
        costs = SeamCosts(rng.random((9, 8, 3), np.float32), gradients).given
        state = rng.choice([KEPT, FILLED], (5, 5)).astype(np.int8)
        state[1:-1, 1:-1] = FREE
        window, taken = (costs, NO_CELLS, NO_PRICE, *pieces, state), np.zeros((5, 5), np.bool_)
        cut_window(*window, taken)
        found = []
        for choice in itertools.product((False, True), repeat=9):
            tried = state == FILLED
            tried[1:-1, 1:-1] = np.reshape(choice, (3, 3))
            found.append(window_cost(*window, tried))
        assert window_cost(*window, taken) == min(found) > 0
