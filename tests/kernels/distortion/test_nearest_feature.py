import numpy as np
import pytest

from tests.kernels.distortion import naive
from texloom.stages.kernels.distortion.nearest_feature import spread, walk

SHAPE = (9, 11)


@pytest.fixture
def jacobian(rng: np.random.Generator) -> np.ndarray:
    return (np.array([1, 0, 0, 1]) + rng.uniform(-0.3, 0.3, (*SHAPE, 4))).astype(np.float32)


@pytest.fixture
def mask(rng: np.random.Generator) -> np.ndarray:
    features = rng.random(SHAPE) < 0.1
    features[4, 4], features[0, 0] = True, False
    return features


def test_distances_spread_from_features(mask: np.ndarray, jacobian: np.ndarray) -> None:
    inverse = np.linalg.inv(jacobian.astype(np.float64).reshape(*SHAPE, 2, 2)).reshape(*SHAPE, 4)
    nearest = np.where(mask, np.arange(99).reshape(SHAPE), -1)
    square = np.where(mask, 0.0, np.inf)
    spread(nearest, square, inverse)
    np.testing.assert_allclose(np.sqrt(square), naive.feature_distances(mask, inverse), atol=1e-9)
    assert mask.ravel()[nearest].all()


@pytest.mark.parametrize("axis", [0, 1])
def test_distances_along_a_direction(mask: np.ndarray, jacobian: np.ndarray, axis: int) -> None:
    out = np.zeros(SHAPE, np.float32)
    walk(mask, jacobian, axis, 6.0, out, 0, SHAPE[0])
    wanted = [[naive.way_to_border(mask, jacobian, axis, 6.0, y, x) for x in range(11)] for y in range(9)]
    np.testing.assert_allclose(out, wanted, rtol=1e-5)
