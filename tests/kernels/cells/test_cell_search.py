import numpy as np

from tests.kernels.cells import naive
from texloom.stages.kernels.cells.cell_search import search_cells


def test_equals_twin(rng: np.random.Generator) -> None:
    lab = rng.uniform(0, 100, (30, 40, 3)).astype(np.float32)
    forbidden = rng.random((30, 40)) < 0.004
    sums = np.zeros((31, 41), np.int64)
    sums[1:, 1:] = forbidden.cumsum(axis=0).cumsum(axis=1)
    count = 6
    boxes = np.array([[y, x, y + 6, x + 7] for y, x in rng.integers(0, 50, (count, 2))])
    points = np.concatenate([box[:2] + rng.integers(0, 6, (9, 2)) for box in boxes])
    weights = rng.choice([0.5, 1], len(points)).astype(np.float32)
    wanted = rng.uniform(0, 100, (len(points), 3)).astype(np.float32)
    ends = np.arange(count + 1) * 9
    bases = np.array([10, 12]) - boxes[:, :2]
    offsets = rng.integers(-14, 30, (80, 2))
    taken = bases[:, None] + rng.integers(-5, 5, (count, 2, 2))
    found, costs = bases.copy(), np.full(count, np.inf)
    for span in ((0, 2), (2, count)):
        search_cells(lab, sums, points, weights, wanted, ends, boxes, bases, offsets, taken, *span, found, costs)
    for cell in range(count):
        own = slice(9 * cell, 9 * cell + 9)
        place, cost = naive.search_cell(
            lab, forbidden, points[own], weights[own], wanted[own], boxes[cell], bases[cell], offsets, taken[cell]
        )
        np.testing.assert_array_equal(found[cell], place)
        np.testing.assert_allclose(costs[cell], cost)
    assert np.isfinite(costs).any()
