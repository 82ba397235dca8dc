import numpy as np

from tests.kernels.cells import naive
from texloom.stages.kernels.cells.cell_costs import fit_cells


def test_best_shifts_equal_twin(rng: np.random.Generator) -> None:
    lab = rng.uniform(0, 100, (30, 40, 3)).astype(np.float32)
    places = rng.random((30, 40)) > 0.004
    ends, tried, count = np.array([0, 9, 15, 24]), np.array([0, 30, 70, 100]), 3
    points = rng.integers(0, 9, (24, 2))
    weights = rng.choice([0.5, 1], 24).astype(np.float32)
    wanted = rng.uniform(0, 100, (24, 3)).astype(np.float32)
    shifts, factors = rng.integers(-3, 30, (100, 2)), rng.uniform(1, 2, 100)
    jitter = np.array([[0, 0], [0, 1], [-1, 0]])
    costs, best = np.full(100, np.inf), np.zeros(100, np.int64)
    for span in ((0, 1), (1, count)):
        fit_cells(lab, places, points, weights, wanted, ends, shifts, factors, tried, jitter, *span, costs, best)
    for cell in range(count):
        own = np.s_[ends[cell] : ends[cell + 1]]
        every = np.array(
            [
                [
                    naive.fit(lab, places, points[own], weights[own], wanted[own], shifts[index] + move)
                    for move in jitter
                ]
                for index in range(tried[cell], tried[cell + 1])
            ]
        )
        every *= factors[tried[cell] : tried[cell + 1], None]
        found = costs[tried[cell] : tried[cell + 1]]
        place = int(found.argmin())
        assert np.isfinite(found[place])
        assert place == every.min(axis=1).argmin()
        np.testing.assert_allclose(found[place], every.min())
        assert best[tried[cell] + place] == every[place].argmin()
        close = found < 1.9 * found[place]  # the others may be left out
        np.testing.assert_allclose(found[close], every.min(axis=1)[close])
