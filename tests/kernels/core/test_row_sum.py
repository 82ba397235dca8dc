import numba
import numpy as np
import pytest

from texloom.stages.kernels.core.row_sum import sum_of_rows


@pytest.mark.parametrize("count", [0, 1, 7])
@pytest.mark.parametrize("length", [1, 4, 5, 8, 20])
def test_rows_are_added_in_their_order(length: int, count: int, rng: np.random.Generator) -> None:
    run = (0,) * length

    @numba.njit
    def total(table, rows, count):  # type: ignore[no-untyped-def]
        result = np.empty(len(run), np.float32)
        sum_of_rows(table, rows, np.int64(count), result, run)
        return result

    table = rng.normal(size=(9, length)).astype(np.float32)
    rows = rng.integers(0, 9, 7)
    expected = np.zeros(length, np.float32)
    for row in rows[:count]:
        expected = expected + table[row]
    np.testing.assert_array_equal(total(table, rows, count), expected)
