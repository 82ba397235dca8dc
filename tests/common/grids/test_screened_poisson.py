"""The screened Poisson equation against a dense solution of its linear system."""

import numpy as np
import pytest

from tests.wraps import WRAPS
from texloom.stages.common.grids.screened_poisson import screened_poisson
from texloom.stages.vocabulary.facts import Wraps


@pytest.mark.parametrize("wrap", WRAPS)
@pytest.mark.parametrize("shape", [(6, 7), (5, 8)])
@pytest.mark.parametrize("reach", [0.5, 3.0])
def test_it_solves_the_linear_system(
    shape: tuple[int, int], reach: float, wrap: Wraps, rng: np.random.Generator
) -> None:
    excess = rng.normal(size=shape).astype(np.float32)
    places = np.arange(excess.size).reshape(shape)
    matrix = np.eye(excess.size) / reach**2
    for axis in (0, 1):
        beside = np.roll(places, -1, axis)
        for one, other in zip(places.ravel(), beside.ravel(), strict=True):
            last = (one // shape[1], one % shape[1])[axis] == shape[axis] - 1
            if wrap[axis] or not last:
                matrix[one, one] += 1
                matrix[other, other] += 1
                matrix[one, other] -= 1
                matrix[other, one] -= 1
    expected = np.linalg.solve(matrix, -excess.ravel()).reshape(shape)
    np.testing.assert_allclose(screened_poisson(excess, reach, wrap), expected, atol=1e-5)
