import numpy as np
import pytest

from tests.kernels.lattice import naive
from texloom.stages.kernels.lattice.score import lattice_sums

PAIRS = {
    "upright": [[3.0, 0.0], [0.0, 4.0]],
    "upside down": [[-3.0, 0.0], [0.0, -4.0]],
    "crossed": [[0.0, 5.0], [2.0, 0.0]],
    "sheared": [[3.25, 1.5], [-1.5, 4.75]],
    "sharp": [[4.0, 4.0], [4.0, 5.0]],
    "beyond": [[30.0, 1.0], [2.0, 3.0]],
    "out of reach": [[40.0, 0.0], [0.0, 40.0]],
    "without area": [[3.0, 6.0], [1.0, 2.0]],
}


@pytest.mark.parametrize("shape", [(17, 15), (9, 23)])
def test_equals_twin(shape: tuple[int, int], rng: np.random.Generator) -> None:
    density = np.maximum(0, rng.normal(size=shape)).astype(np.float32)
    mass = rng.random(shape).astype(np.float32)
    first, second = (np.array([pair[index] for pair in PAIRS.values()]) for index in (0, 1))
    sums = np.full((len(PAIRS), 3), np.nan)
    lattice_sums(density, mass, 0.7, first, second, sums)
    expected = [naive.lattice_sums(density, mass, 0.7, a, b) for a, b in zip(first, second, strict=True)]
    np.testing.assert_allclose(sums, expected, rtol=1e-12, err_msg=str(list(PAIRS)))
    assert sums[:, 1].tolist()[-2:] == [0, 0]
    assert (sums[:-2, 1] > 0).all()


def test_known_points() -> None:
    """Steps of 2 and 3 in a box that reaches 4 and 6: 5 x 5 points, without the origin, by halves."""
    density = np.zeros((9, 13), np.float32)
    density[::2, ::3] = 1
    sums = np.empty((1, 3))
    lattice_sums(density, 2 * density, 3.0, np.array([[2.0, 0.0]]), np.array([[0.0, 3.0]]), sums)
    assert sums.tolist() == [[12, 12, 24]]
    density[4, 9] = density[4, 3] = 0  # (0, 3), which is counted, and its opposite
    lattice_sums(density, 2 * density, 3.0, np.array([[2.0, 0.0]]), np.array([[0.0, 3.0]]), sums)
    assert sums.tolist() == [[11 - 3, 12, 22]]
