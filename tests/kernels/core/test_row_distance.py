import numba
import numpy as np
import pytest

from texloom.stages.kernels.core.row_distance import LENGTHS, row_distance, two_row_distance


def compiled(rows: int, length: int):
    of_rows = two_row_distance if rows == 2 else row_distance

    @numba.njit
    def distance(first, first_start, second, second_start):
        return of_rows(first, first_start, second, second_start, length)

    return distance


@pytest.mark.parametrize("rows", [1, 2])
@pytest.mark.parametrize("length", [1, 9, 44])
def test_equals_the_sum_of_squares_of_the_rows(rows: int, length: int, rng: np.random.Generator) -> None:
    first = rng.integers(-2000, 2000, (6, 60)).astype(np.int16)
    second = rng.integers(-2000, 2000, (5, 50)).astype(np.int16)
    distance = compiled(rows, length)
    for (r, c), (s, d) in (((0, 0), (0, 0)), ((1, 3), (2, 5)), ((4, 60 - length), (3, 50 - length))):
        difference = first[r : r + rows, c : c + length].astype(np.int64) - second[s : s + rows, d : d + length]
        found = distance(first, np.uint64(60 * r + c), second, np.uint64(50 * s + d))
        assert found == (difference**2).sum()


@pytest.mark.parametrize("rows", [1, 2])
def test_the_compiler_need_not_know_the_length(rows: int, rng: np.random.Generator) -> None:
    of_rows = two_row_distance if rows == 2 else row_distance

    @numba.njit
    def distance(first, first_start, second, second_start, length):
        return of_rows(first, first_start, second, second_start, length)

    longest = LENGTHS[-1]
    for length in (*LENGTHS[:50], *LENGTHS[-20:]):
        first = rng.integers(-4000, 4000, (3, longest + 2)).astype(np.int16)
        second = rng.integers(-4000, 4000, (2, length)).astype(np.int16)  # which end where the runs do
        difference = first[1 : 1 + rows, 2 : 2 + length].astype(np.int64) - second[:rows]
        found = distance(first, np.uint64(longest + 4), second, np.uint64(0), length)
        assert found == (difference**2).sum()
