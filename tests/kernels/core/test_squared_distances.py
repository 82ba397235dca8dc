from __future__ import annotations

import numpy as np

from texloom.stages.kernels.core.squared_distances import squared_distances


def test_distances_are_sums_in_the_order_of_the_columns(rng: np.random.Generator) -> None:
    rows = rng.standard_normal((37, 8))
    expected = np.zeros((37, 37))
    for column in rows.T:
        expected += np.square(column[:, None] - column)
    found = np.full((37, 37), np.nan)
    columns = np.ascontiguousarray(rows.T)
    squared_distances(columns, found, 0, 20)
    assert np.isnan(found[20:]).all()
    squared_distances(columns, found, 20, 37)
    np.testing.assert_array_equal(found, expected)
    np.testing.assert_array_equal(found, found.T)
