import numpy as np
import pytest

from tests.kernels.cells import naive
from texloom.stages.kernels.cells.basins import flood


def flooded(values: np.ndarray, depth: float) -> np.ndarray:
    basin = np.empty(values.size, np.int64)
    flood(values, np.argsort(values, axis=None, kind="stable"), np.float32(depth), basin)
    return basin.reshape(values.shape)


@pytest.mark.parametrize("depth", [0.0, 0.2, 0.5])
def test_equals_twin(depth: float, rng: np.random.Generator) -> None:
    values = np.rint(rng.random((17, 23)) * 20).astype(np.float32) / np.float32(16)
    found, wanted = flooded(values, depth), naive.basins(values, depth)
    same = [one.ravel()[:, None] == one.ravel() for one in (found, wanted)]
    assert np.array_equal(*same)


def test_valleys_are_apart_where_the_ridge_is_high_enough() -> None:
    values = np.zeros((5, 9), np.float32)
    values[:, 4] = 1
    assert len(np.unique(flooded(values, 0.9))) == 2
    assert len(np.unique(flooded(values, 1.1))) == 1
