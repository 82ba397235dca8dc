import numpy as np
import pytest

from texloom.stages.kernels.per_pixel.control_pyramid import halve, place_control


@pytest.mark.parametrize("shape", [(6, 8), (7, 5), (1, 1)])
def test_means_of_control(shape: tuple[int, int], rng: np.random.Generator) -> None:
    fine = rng.random((*shape, 2), np.float32)
    coarse = np.full((-(-shape[0] // 2), -(-shape[1] // 2), 2), -1, np.float32)
    halve(fine, coarse, 0, coarse.shape[1], 0, coarse.shape[0])
    even = np.pad(fine, ((0, shape[0] % 2), (0, shape[1] % 2), (0, 0)), mode="edge")
    expected = even.reshape(coarse.shape[0], 2, coarse.shape[1], 2, 2).mean(axis=(1, 3))
    np.testing.assert_allclose(coarse, expected, atol=1e-6)
    given = np.full((12, 9, 8), 7, np.int16)
    place_control(fine, given, -3, 2, np.float32(1000), 1, 9, 2, 12)
    rows, columns = np.clip(np.arange(12) - 3, 0, shape[0] - 1), np.clip(np.arange(9) + 2, 0, shape[1] - 1)
    around = np.rint(fine[rows][:, columns] * np.float32(1000))
    np.testing.assert_array_equal(given[2:, 1:, :2], around[2:, 1:])
    assert (given[:2] == 7).all()
    assert (given[..., 2:] == 7).all()
