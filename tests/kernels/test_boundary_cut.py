from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from stages.synthesis._cuts import Strips, cheapest_path, laid_over
from tests import naive

small = st.tuples(st.integers(1, 6), st.integers(1, 4)).flatmap(
    lambda shape: arrays(np.float32, shape, elements=st.integers(0, 9).map(float))
)


@given(small)
def test_no_path_costs_less(errors: np.ndarray) -> None:
    path = cheapest_path(errors)
    assert path.shape == errors.shape[:1]
    assert (np.abs(np.diff(path)) <= 1).all()
    assert errors[np.arange(len(path)), path].sum() == naive.cheapest_cut(errors)


def test_a_path_follows_the_only_gap(rng: np.random.Generator) -> None:
    gap = np.cumsum(rng.integers(-1, 2, 60)) + 60
    errors = np.ones((60, 121), np.float32)
    errors[np.arange(60), gap] = 0
    np.testing.assert_array_equal(cheapest_path(errors), gap)


def test_without_strips_all_is_new() -> None:
    assert laid_over(np.ones((5, 7), np.float32), Strips()).all()
    assert not Strips().mask((5, 7)).any()


def test_a_strip_covers_its_own_side() -> None:
    mask = Strips(top=1, left=2, bottom=3, right=4).mask((9, 11))
    expected = np.ones((9, 11), bool)
    expected[1:6, 2:7] = False
    np.testing.assert_array_equal(mask, expected)


@pytest.mark.parametrize("side", ["top", "left", "bottom", "right"])
def test_a_cut_keeps_the_outside_of_its_strip(side: str, rng: np.random.Generator) -> None:
    """What is outside the gap stays, on whichever side; the rest is new."""
    errors = rng.uniform(1, 2, (10, 10)).astype(np.float32)
    seen = {"left": errors, "top": errors.T, "right": errors[:, ::-1], "bottom": errors[::-1].T}[side]
    gap = np.array([1, 1, 2, 3, 2, 1, 0, 0, 1, 2])
    seen[np.arange(10), gap] = 0
    new = laid_over(errors, Strips(**{side: 4}))
    line = {"left": new, "top": new.T, "right": new[:, ::-1], "bottom": new[::-1].T}[side]
    np.testing.assert_array_equal(line, np.arange(10) >= gap[:, None])


def test_cuts_meet_in_corners(rng: np.random.Generator) -> None:
    errors = rng.random((12, 14), np.float32)
    alone = [laid_over(errors, Strips(**{side: 3})) for side in ("top", "left", "bottom", "right")]
    np.testing.assert_array_equal(laid_over(errors, Strips(3, 3, 3, 3)), np.logical_and.reduce(alone))
