import numpy as np
import pytest

from tests.kernels.seams import naive
from texloom.stages.kernels.seams.overlap_difference import refine_positions


@pytest.mark.parametrize("reach", [1, 3])
def test_places_move_to_the_least_difference(reach: int, rng: np.random.Generator) -> None:
    features = rng.integers(0, 3, (30, 28, 2)).astype(np.float32)  # whole numbers, so that places tie
    template = rng.integers(0, 3, (9, 7, 2)).astype(np.float32)
    mask = rng.random((9, 7)) < 0.7
    free = rng.random((22, 22)) < 0.6
    free[:8, :8] = False
    places = np.concatenate([rng.integers(0, 22, (40, 2)), [[2, 3], [0, 0], [21, 21]]])
    expected = [naive.refined_position(features, template, mask, free, tuple(at), reach) for at in places.tolist()]
    refine_positions(features, template, mask, free, places, reach)
    np.testing.assert_array_equal(places, expected)
    assert tuple(places[40]) == (2, 3)
