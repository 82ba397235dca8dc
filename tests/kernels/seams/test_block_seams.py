import numpy as np
import pytest

from texloom.stages.kernels.seams.block_seams import seams_between
from texloom.stages.synthesis.stitching.seams import ABSENT, FREE, KEPT, SeamCosts, pairs


@pytest.mark.parametrize("gradients", [False, True])
def test_seams_between_pixels_that_are_there_are_summed(gradients: bool, rng: np.random.Generator) -> None:
    costs = SeamCosts(rng.random((9, 8, 3), np.float32), gradients)
    match = rng.integers(0, 8, (5, 6, 2)).astype(np.int32)
    state = rng.choice([ABSENT, KEPT, FREE], (5, 6)).astype(np.int8)
    expected = 0
    for axis in (0, 1):
        one, other = pairs(match, axis)
        there = np.logical_and(*pairs(state != ABSENT, axis))
        expected += costs.between(axis, one[there], other[there]).sum()
    assert seams_between(costs.given, match, state) == expected > 0
