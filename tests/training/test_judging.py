"""Agreement of contours: known answers."""

from __future__ import annotations

import numpy as np
import pytest

from benchmarks.training.boundaries import Counts, count, f_measure, ods, ois, thinned
from benchmarks.training.judge import judge_picture, table


def line(column: int, size: int = 40) -> np.ndarray:
    mask = np.zeros((size, size), bool)
    mask[:, column] = True
    return mask


def test_f_of_known_maps() -> None:
    true = line(20)
    maps = [line(20), line(22), line(20) | line(35), np.zeros_like(true), np.ones_like(true)]
    exact, near = count(maps, true, (0.0, 2.0))
    np.testing.assert_allclose(exact.f, [1, 0, 2 / 3, 0, f_measure(np.array(1 / 40), np.array(1.0))])
    np.testing.assert_allclose(near.f[:3], [1, 1, 2 / 3])


def test_one_threshold_for_all_is_no_better_than_one_for_each() -> None:
    early = Counts(np.array([10, 0]), np.array([10, 0]), np.array([10, 0]), 10)
    late = Counts(np.array([10, 10]), np.array([90, 10]), np.array([10, 10]), 10)
    assert ods([early, late]) < ois([early, late]) == 1
    assert ods([late]) == ois([late]) == 1


def test_pictures_without_contours_count_as_false_alarms_only() -> None:
    nothing = Counts(np.array([0]), np.array([10]), np.array([0]), 0)
    right = Counts(np.array([10]), np.array([10]), np.array([10]), 10)
    assert ods([nothing, right]) == pytest.approx(2 / 3)
    assert ois([nothing, right]) == 1


@pytest.mark.parametrize("turned", [False, True])
def test_thinning_keeps_the_crest(turned: bool) -> None:
    columns = np.arange(60)
    ridge = np.tile(np.exp(-(((columns - 30) / 4) ** 2)), (60, 1)).astype(np.float32)
    thin = thinned(ridge.T.copy() if turned else ridge)
    thin = thin.T if turned else thin
    assert (thin[5:-5, 30] == 1).all()
    assert (thin[5:-5] > 0.1).sum(axis=1).max() <= 2


def test_table_has_a_line_for_each_detector_and_resolution() -> None:
    lines = table([judge_picture(0, None, 96, 7)]).splitlines()
    assert len(lines) == 2 + 3 * 6
    assert all(row.count("|") == lines[0].count("|") for row in lines)
