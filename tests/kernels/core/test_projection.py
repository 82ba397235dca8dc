import numpy as np
import pytest

from texloom.stages.kernels.core.projection import project_windows
from texloom.stages.kernels.core.vector_size import DIMENSIONS


@pytest.mark.parametrize("count", [1, 2, 3, 4, 11])
def test_windows_are_projected_and_rounded_towards_zero(rng: np.random.Generator, count: int) -> None:
    """Whole numbers, so that sums are exact in any order."""
    image = rng.integers(-20, 20, (12, 30)).astype(np.float32)
    size, run = 3, 6
    starts = rng.integers(0, 10, count) * 30 + rng.integers(0, 24, count)
    basis = rng.integers(-3, 4, (size * run, DIMENSIONS)).astype(np.float32)
    offset = rng.integers(-5, 5, DIMENSIONS).astype(np.float32) + np.float32(0.25)
    wanted = np.empty((count, DIMENSIONS))
    for number, start in enumerate(starts):
        row, column = divmod(int(start), 30)
        wanted[number] = image[row : row + size, column : column + run].ravel() @ basis - offset
    for longest in (1e6, 100.0):
        out = np.zeros((count, DIMENSIONS), np.int16)
        project_windows(image, starts, size, run, basis, offset, np.float32(longest), out, 0, count)
        length = np.sqrt((wanted**2).sum(axis=1, keepdims=True))
        np.testing.assert_allclose(out, np.trunc(wanted * np.minimum(1, longest / length)), atol=longest < 1e6)


def test_parts_give_the_same_bits(rng: np.random.Generator) -> None:
    image = rng.normal(0, 100, (20, 40)).astype(np.float32)
    starts = np.arange(15)[:, None] * 40 + np.arange(0, 30)
    basis = rng.normal(0, 1, (20, DIMENSIONS)).astype(np.float32)
    offset = np.zeros(DIMENSIONS, np.float32)
    results = []
    for step in (450, 7):
        out = np.zeros((450, DIMENSIONS), np.int16)
        for first in range(0, 450, step):
            span = first, min(first + step, 450)
            project_windows(image, starts.ravel(), 4, 5, basis, offset, np.float32(2047), out, *span)
        results.append(out)
    np.testing.assert_array_equal(*results)
