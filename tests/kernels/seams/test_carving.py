import numpy as np
import pytest

from tests.kernels.seams import naive
from texloom.stages.kernels.seams.carving import close_seam, gradient_energy


@pytest.mark.parametrize("shape", [(7, 9, 3), (1, 5, 2), (6, 1, 1)])
def test_steepness_is_the_slow_one(shape: tuple[int, int, int], rng: np.random.Generator) -> None:
    pixels = rng.integers(-4800, 4800, shape).astype(np.int16)
    errors = np.empty(shape[:2], np.float32)
    gradient_energy(pixels, errors)
    np.testing.assert_array_equal(errors, naive.gradient_energy(pixels))


def test_only_the_columns_in_use_are_looked_at(rng: np.random.Generator) -> None:
    pixels = rng.integers(0, 99, (6, 8, 2)).astype(np.int16)
    errors = np.empty((6, 5), np.float32)
    gradient_energy(pixels, errors)
    np.testing.assert_array_equal(errors, naive.gradient_energy(pixels[:, :5]))


def test_a_seam_is_gone_and_nothing_else(rng: np.random.Generator) -> None:
    pixels = rng.integers(0, 99, (5, 7, 2)).astype(np.int16)
    number = np.arange(35, dtype=np.int32).reshape(5, 7)
    path = np.array([0, 1, 2, 5, 6])
    kept = [[column for column in range(7) if column != path[row]] for row in range(5)]
    expected = np.stack([pixels[row, kept[row]] for row in range(5)])
    close_seam(pixels, number, path, 7)
    np.testing.assert_array_equal(pixels[:, :6], expected)
    np.testing.assert_array_equal(number[:, :6], [[7 * row + column for column in kept[row]] for row in range(5)])
