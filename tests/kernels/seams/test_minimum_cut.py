import numpy as np
import pytest

from texloom.stages.kernels.seams.minimum_cut import NO_CELLS, NO_PRICE, window_cost
from texloom.stages.kernels.seams.window_state import ABSENT, FREE, KEPT
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
