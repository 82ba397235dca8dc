"""Values of control that an exemplar hardly has."""

from __future__ import annotations

import numpy as np

from texloom.stages.synthesis.control_maps.known_control import extrapolated
from texloom.stages.synthesis.reconstruction.expected_use import expected_use


def test_missing_values_take_the_nearest_known() -> None:
    """Control from 0 to 0.5 and at 1, which is all that is known; the target is a ramp."""
    own = np.full((60, 100, 1), 10.0, np.float32)
    own[:, :90, 0] = np.linspace(0, 5, 90)
    target = np.linspace(0, 10, 201, dtype=np.float32)[None, :, None].repeat(20, axis=0)
    moved, share = extrapolated(own, target, 10.0)
    np.testing.assert_array_equal(moved[:, :95], target[:, :95])
    np.testing.assert_allclose(moved[:, 199:], target[:, 199:], atol=0.1)
    assert 0.4 < share < 0.5
    between = moved[0, 110:190, 0]
    assert ((np.abs(between - 4.75) < 0.4) | (between > 9.6)).all()
    assert (between[:35] < 6).all()
    assert (between[-35:] > 9).all()


def test_values_that_are_asked_for_far_too_often_become_means_of_those_around(rng: np.random.Generator) -> None:
    """Control around its middle, and a target that asks for all values alike."""
    own = rng.beta(6, 6, (100, 100, 1)).astype(np.float32) * 10
    target = np.linspace(0, 10, 201, dtype=np.float32)[None, :, None].repeat(20, axis=0)
    moved, share = extrapolated(own, target, 10.0)
    np.testing.assert_array_equal(moved[:, 55:145], target[:, 55:145])
    assert 0.3 < share < 0.5
    for value in (moved[0, 0, 0], moved[0, 200, 0]):
        assert (np.abs(own - value) < 0.6).mean() > 0.02
    assert moved[0, :60].min() > np.quantile(own, 0.005)
    assert moved[0, 140:].max() < np.quantile(own, 0.995)
    assert np.diff(moved[0, :, 0]).min() > -0.5


def test_a_line_is_not_replaced(rng: np.random.Generator) -> None:
    """A hundredth of the exemplar, that the target asks for twice as often."""
    own = rng.uniform(5, 10, (100, 100, 1)).astype(np.float32)
    own[50] = 0
    target = rng.uniform(5, 10, (100, 100, 1)).astype(np.float32)
    target[50:52] = 0
    moved, share = extrapolated(own, target, 10.0)
    assert share == 0
    assert moved is target


def test_a_label_that_is_asked_for_far_too_often_keeps_its_material() -> None:
    """One of three labels in a fiftieth of the exemplar, and in half of the target; its edges are soft."""
    labels = np.eye(3, dtype=np.float32) * 10
    own = labels[np.repeat([0, 1], 50)][None].repeat(100, axis=0)
    own[40:60, :10] = labels[2]
    own[39:61, 10] = (labels[2] + labels[0]) / 2
    target = labels[np.repeat([0, 2], 50)][None].repeat(100, axis=0)
    moved, share = extrapolated(own, target, 10.0)
    np.testing.assert_allclose(moved, target, atol=0.2)
    assert share == 0


def test_known_values_and_those_beside_them_stay(rng: np.random.Generator) -> None:
    own = rng.uniform(0, 10, (80, 80, 2)).astype(np.float32)
    own[..., 1] = own[..., 0]
    moved, share = extrapolated(own, own, 10.0)
    assert share == 0
    assert moved is own


def test_places_of_one_control_are_used_as_often_as_the_original_has_them(rng: np.random.Generator) -> None:
    own, wanted = np.zeros((20, 20, 1), np.float32), np.zeros((40, 40, 1), np.float32)
    own[:, 10:], wanted[:, 10:] = 1, 1
    use = np.where(np.arange(20)[:, None] < 10, 3.0, 1.0) * np.ones((1, 20))
    expected = expected_use(own, wanted, 1, use.astype(np.float32))
    assert expected.sum() == 1600
    np.testing.assert_allclose(expected[:10].sum() / expected[10:].sum(), 3, rtol=1e-5)
    np.testing.assert_allclose(expected[:, 10:].sum() / expected[:, :10].sum(), 3, rtol=1e-5)
    even = expected_use(own, wanted, 1, None)
    np.testing.assert_allclose(even[:10].sum() / even[10:].sum(), 1, rtol=1e-5)
