from __future__ import annotations

import numpy as np
import pytest

from tests.kernels.seams import naive
from tests.wraps import WRAPS
from texloom.stages.synthesis.stitching.seam_map import SeamMap, seam_errors, slopes
from texloom.stages.vocabulary.facts import NOWHERE, TORUS, Wraps


@pytest.fixture
def features(rng: np.random.Generator) -> np.ndarray:
    return rng.random((20, 23, 3), np.float32)


def pieces(rng: np.random.Generator) -> np.ndarray:
    """A result of 21 x 18 px from three pieces, cut anywhere."""
    at = np.stack(np.indices((18, 21)), axis=-1)
    match = at + np.array([1, 2])
    match[:, 9:] = (at + np.array([2, -3]))[:, 9:]
    match[7:, 4:15] = (at + np.array([-5, 5]))[7:, 4:15]
    match[tuple(rng.integers(0, 18, (2, 9)))] = [3, 3]
    return match.astype(np.uint32)


def test_slopes_are_lengths_of_gradients_by_their_mean() -> None:
    plane = np.stack([np.add.outer(3.0 * np.arange(6), 4.0 * np.arange(7)), np.zeros((6, 7))], axis=2)
    np.testing.assert_allclose(slopes(plane.astype(np.float32)), 1, rtol=1e-6)
    assert (slopes(np.zeros((4, 5, 3), np.float32)) == 0).all()


@pytest.mark.parametrize("wrap", WRAPS)
def test_costs_are_those_of_all_seams(wrap: Wraps, features: np.ndarray, rng: np.random.Generator) -> None:
    match, slope = pieces(rng), slopes(features)
    seams = SeamMap(features, slope, match, wrap)
    assert seams.costs.shape == (3, 3)
    assert seams.costs.sum() == pytest.approx(naive.seam_costs(features, slope, match, wrap).sum(), rel=1e-5)
    assert seams.total(np.array([3, 2]), 9) == pytest.approx(seams.costs[:2, :2].sum())


def test_one_piece_has_no_seams(features: np.ndarray) -> None:
    match = (np.stack(np.indices((9, 10)), axis=-1) + 4).astype(np.uint32)
    assert not SeamMap(features, slopes(features), match, NOWHERE).costs.any()
    assert SeamMap(features, slopes(features), match, TORUS).costs.any()


@pytest.mark.parametrize("wrap", WRAPS)
@pytest.mark.parametrize("top", [(0, 0), (4, 6), (12, 15), (16, 19)])
def test_the_cost_of_a_change_is_predicted(
    wrap: Wraps, top: tuple[int, int], features: np.ndarray, rng: np.random.Generator
) -> None:
    top = (top[0] if wrap.down else min(top[0], 18 - 6), top[1] if wrap.across else min(top[1], 21 - 6))
    match, slope = pieces(rng), slopes(features)
    seams = SeamMap(features, slope, match, wrap)
    before = naive.seam_costs(features, slope, match, wrap).sum()
    new = rng.random((6, 6)) < 0.7
    source = np.array([8, 11])
    increase = seams.cost_increase(np.array(top), new, source)
    for i, j in np.argwhere(new):
        match[(top[0] + i) % 18, (top[1] + j) % 21] = source + np.array([i, j])
    after = naive.seam_costs(features, slope, match, wrap).sum()
    assert increase == pytest.approx(after - before, rel=1e-4, abs=1e-5)
    seams.changed(np.array(top), 6)
    np.testing.assert_allclose(seams.costs, SeamMap(features, slope, match, wrap).costs)


def test_the_worst_window_has_the_costliest_seams(features: np.ndarray) -> None:
    match = (np.stack(np.indices((64, 80)), axis=-1) % 20).astype(np.uint32)
    seams = SeamMap(features, slopes(features), match, NOWHERE)
    seams.costs[:] = 1
    seams.costs[5, 7] = 9
    top = seams.worst(16)
    assert tuple(top) == (5 * 8 + 4 - 8, 7 * 8 + 4 - 8)
    for _ in range(8):
        seams.worst(16)
    assert tuple(seams.worst(16)) != tuple(top)  # others have their turn
    assert ((seams.worst(60) >= 0) & (seams.worst(60) <= [4, 20])).all()


def test_seams_cost_more_where_both_sides_are_smooth() -> None:
    difference = np.array([[[3, 4], [3, 4], [0, 1]]], np.float32)
    slope = np.array([[0, 1, 0]], np.float32)
    costs = seam_errors(difference, slope, np.array([[True, True, True]]))
    np.testing.assert_allclose(costs, [[125, 62.5, 1]])
    assert seam_errors(difference, slope, np.array([[False, True, True]]))[0, 0] == 0
