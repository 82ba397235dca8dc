import numpy as np

from tests.kernels.distortion import naive
from texloom.stages.kernels.distortion.flat_positions import find_positions


def test_positions_of_a_bent_chart_equal_their_twins(rng: np.random.Generator) -> None:
    row, column = np.indices((16, 18)).astype(float)
    chart = np.stack([0.7 * row + 0.1 * column + 0.2 * np.sin(column / 4), 0.8 * column - 0.1 * row], axis=2)
    jacobian = np.empty((16, 18, 4), np.float32)
    jacobian[:] = np.linalg.inv([[0.7, 0.1], [-0.1, 0.8]]).ravel()
    sharp = rng.random((16, 18)) < 0.9
    start = rng.uniform(0, 15, (11, 13, 2))
    position, shown = start.copy(), np.empty((11, 13), np.bool_)
    for first, last in ((0, 4), (4, 11)):
        find_positions(chart, jacobian, sharp, 4, 0.5, position, shown, first, last)
    expected, seen = naive.find_positions(chart, jacobian, sharp, 4, 0.5, start)
    np.testing.assert_allclose(position, expected, atol=1e-9)
    np.testing.assert_array_equal(shown, seen)
    assert 0.5 < shown.mean() < 1
