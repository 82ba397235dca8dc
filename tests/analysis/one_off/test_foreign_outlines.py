"""Outlines lie where colours change, stains are dropped, and what colours cannot tell stays whole."""

import numpy as np

from texloom.stages.analysis.one_off.foreign_outlines import likewise, outlined

SIDE = 96
ALL = np.ones((SIDE, SIDE), np.bool_)
NONE = ~ALL


def wide(margin: int) -> np.ndarray:
    """A square of 32 px, and a margin around it."""
    part = np.zeros((SIDE, SIDE), np.bool_)
    part[32 - margin : 64 + margin, 32 - margin : 64 + margin] = True
    return part


def surface() -> np.ndarray:
    lab = np.random.default_rng(2).normal((50, 0, 0), (6, 2, 2), (SIDE, SIDE, 3))
    return lab.astype(np.float32)


def test_an_outline_lies_where_colours_change() -> None:
    lab, true = surface(), wide(0)
    lab[true] += (0, 30, 0)
    made = outlined(lab, ALL, wide(12), NONE)
    assert (made & true).sum() > 0.97 * true.sum()
    assert (made & ~wide(2)).sum() == 0


def test_what_has_the_colours_of_the_rest_is_foreign_only_where_it_is_sure() -> None:
    lab = surface()
    assert not outlined(lab, ALL, wide(12), NONE).any()
    assert outlined(lab, ALL, wide(12), wide(0)).any()


def test_excluded_pixels_have_no_influence() -> None:
    lab, true = surface(), wide(0)
    lab[true] += (0, 30, 0)
    valid = ALL.copy()
    valid[:, :16] = False
    other = lab.copy()
    other[:, :8] = (90, -60, 60)
    one, two = (outlined(each, valid, wide(12), NONE) for each in (lab, other))
    np.testing.assert_array_equal(one, two)


def test_nothing_found_and_everything_found_stay() -> None:
    np.testing.assert_array_equal(outlined(surface(), ALL, NONE, NONE), NONE)
    np.testing.assert_array_equal(outlined(surface(), ALL, ALL, NONE), ALL)


def test_another_part_of_the_same_look_is_found_and_smaller_ones_are_not() -> None:
    lab, first = surface(), wide(0)
    second = np.zeros_like(first)
    second[4:24, 4:28] = True
    lab[first | second] += (0, 30, 0)
    found = likewise(lab, ALL, first, 200.0)
    assert (found & second).sum() > 0.8 * second.sum()
    assert not (found & first).any()
    assert (found & ~second).sum() < 0.25 * second.sum()
    assert not likewise(lab, ALL, first, 9000.0).any()
    assert not likewise(lab, ALL, NONE, 1.0).any()


def test_a_smaller_part_is_found_where_it_is_surely_alike() -> None:
    """A leaf beside a plant; but not a stain that has a little of its colour."""
    first, second = np.zeros((2, 192, 192), np.bool_)
    first[64:128, 64:128] = second[8:36, 8:36] = True
    for shift, share in ((30, 0.8), (12, 0.0)):
        lab = np.random.default_rng(2).normal((50, 0, 0), (6, 2, 2), (192, 192, 3)).astype(np.float32)
        lab[first] += (0, 30, 0)
        lab[second] += (0, shift, 0)
        found = likewise(lab, np.ones_like(first), first, 2000.0)
        assert found[second].mean() >= share
        assert found.any() == (share > 0)
