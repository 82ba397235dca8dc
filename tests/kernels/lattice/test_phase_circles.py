import numpy as np

from texloom.stages.kernels.core.elementary_functions import phasor
from texloom.stages.kernels.lattice.phase_circles import fill_circles


def test_points_are_those_of_phasors_to_the_last_bit() -> None:
    random = np.random.default_rng(1)
    rows, columns = random.uniform(-40, 3000, 23), random.uniform(-40, 3000, 31)
    for count in (1, 2):
        cells, origin = random.normal(size=(2, count)) / 20, random.uniform(-1, 1, count)
        points = np.empty((23, 31, 2 * count), np.float32)
        fill_circles(rows, columns, cells, origin, points)
        turns = rows[:, None, None] * cells[0] + columns[None, :, None] * cells[1] + origin
        expected = phasor(2 * np.pi * turns)
        np.testing.assert_array_equal(
            points, np.concatenate([expected.real, expected.imag], axis=2, dtype=np.float32)
        )
    eighths = np.empty((17, 1, 2), np.float32)
    fill_circles(np.arange(-8.0, 9.0), np.zeros(1), np.array([[0.125], [0.0]]), np.zeros(1), eighths)
    np.testing.assert_allclose(
        eighths[::2, 0], [[1, 0], [0, 1], [-1, 0], [0, -1], [1, 0], [0, 1], [-1, 0], [0, -1], [1, 0]], atol=1e-6
    )
