import numpy as np
import pytest

from texloom.stages.common.similarity import appearance


@pytest.mark.parametrize("width", [256, 320, 512])
def test_the_sample_of_windows_is_spread_over_all_columns_whatever_the_width(width: int) -> None:
    rows, columns = appearance._sample(np.ones((512, width), np.bool_))
    per_row, per_column = np.bincount(rows, minlength=512), np.bincount(columns, minlength=width)
    for counts in (per_row, per_column):
        assert counts.min() > 0
        assert counts.max() < 2 * counts.mean()


def test_all_windows_of_a_small_exemplar_are_in_the_sample() -> None:
    complete = np.zeros((40, 50), np.bool_)
    complete[3:37, 4:46] = True
    rows, columns = appearance._sample(complete)
    np.testing.assert_array_equal(np.stack([rows, columns]), np.nonzero(complete))
