"""Values of control that a target asks for far more often than an exemplar has them."""

from __future__ import annotations

import numpy as np
import pytest

from tests.synthetic import smooth_noise
from texloom.stages.synthesis.control_maps.comparable_control import comparable
from texloom.stages.synthesis.control_maps.even_demand import evenly_demanded


def ramp(*ends: float) -> np.ndarray:
    return np.linspace(*ends, 96 * 96, dtype=np.float32).reshape(96, 96, 1)


def largest_overuse(own: np.ndarray, wanted: np.ndarray) -> float:
    """Of a twentieth of the exemplar's pixels, those of similar values."""
    edges = np.quantile(own, np.linspace(0, 1, 21))
    return float(20 * np.histogram(wanted.clip(own.min(), own.max()), edges)[0].max() / wanted.size)


def test_no_value_is_asked_for_far_more_often_than_it_occurs() -> None:
    own, extremes = ramp(0, 1), ramp(0, 1) ** 0.1
    assert largest_overuse(own, extremes) > 7
    moved = evenly_demanded(own, extremes, 1.0)[1]
    assert largest_overuse(own, moved) < 2.2
    assert (np.diff(moved.ravel()) >= 0).all()
    assert moved.dtype == np.float32


def test_two_even_regions_take_a_quarter_of_the_exemplar_each() -> None:
    target = (ramp(0, 1) > 0.5).astype(np.float32)
    own, moved = evenly_demanded(ramp(0, 1), target, 1.0)
    dark, bright = np.unique(moved)
    assert (dark, bright) == pytest.approx((0.125, 0.875), abs=0.01)
    assert (own == dark).mean() == pytest.approx(0.25, abs=0.01)
    assert (own == bright).mean() == pytest.approx(0.25, abs=0.01)
    between = (ramp(0, 1) > 0.26) & (ramp(0, 1) < 0.74)
    np.testing.assert_array_equal(own[between], ramp(0, 1)[between])


def test_what_is_asked_for_as_often_as_it_occurs_stays() -> None:
    own = ramp(0, 1)
    same, moved = evenly_demanded(own, ramp(0.2, 0.8), 1.0)
    np.testing.assert_array_equal(same, own)
    np.testing.assert_allclose(moved, ramp(0.2, 0.8), atol=0.003)
    moved = evenly_demanded(own, ramp(0, 1) ** 0.1, 1.0)[1]
    np.testing.assert_allclose(evenly_demanded(own, moved, 1.0)[1], moved, atol=0.01)


def test_channels_are_independent() -> None:
    own = np.concatenate([ramp(0, 1), ramp(0, 1)[::-1]], axis=2)
    target = np.concatenate([ramp(0, 1), ramp(0, 1) ** 0.1], axis=2)
    both = evenly_demanded(own, target, 1.0)
    for channel in range(2):
        alone = evenly_demanded(own[..., channel, None], target[..., channel, None], 1.0)
        for moved, part in zip(both, alone, strict=True):
            np.testing.assert_array_equal(moved[..., channel, None], part)
    none = np.zeros((5, 5, 0), np.float32)
    assert evenly_demanded(none, none, 1.0)[1] is none


def test_regions_that_the_exemplar_has_too_change_nothing() -> None:
    own = ramp(-1, 2).clip(0, 1)
    same, moved = evenly_demanded(own, own[::-1].copy(), 1.0)
    np.testing.assert_allclose(same, own, atol=0.002)
    np.testing.assert_allclose(moved, own[::-1], atol=0.002)


def test_values_move_no_farther_than_another_material_is() -> None:
    labels = (ramp(0, 1) > 0.03).astype(np.float32)
    wanted = (ramp(0, 1) > 0.9).astype(np.float32)
    own, moved = evenly_demanded(labels, wanted, 0.25)
    np.testing.assert_array_equal(moved.round(), wanted)
    np.testing.assert_array_equal(own.round(), labels)
    assert evenly_demanded(labels, wanted, 1.0)[1][0, 0] == 1


def test_targets_ask_for_no_value_too_often_however_smooth_control_is(rng: np.random.Generator) -> None:
    rough = rng.random((96, 96, 1), dtype=np.float32)
    smooth = smooth_noise((96, 96), 12, rng)[..., None].astype(np.float32)
    smooth = (smooth - smooth.min()) / np.ptp(smooth)
    for own in (rough, smooth**2):
        moved = comparable(own, smooth, 1.0, toroidal=True)
        assert moved.blurred is (own is rough)
        assert moved.rare > 0.2
        assert np.corrcoef(moved.wanted.ravel(), smooth.ravel())[0, 1] > 0.9
        assert largest_overuse(moved.own, moved.wanted) < 2.5
    as_detailed = comparable(rough, rough[::-1].copy(), 1.0, toroidal=True)
    np.testing.assert_array_equal(as_detailed.own, rough)
    assert as_detailed.rare == 0


def test_pixels_that_are_used_often_serve_as_many() -> None:
    """Half of the target is of a value that a tenth of the exemplar has."""
    own, halves = ramp(0, 1), np.full((96, 96, 1), 0.05, np.float32)
    halves[48:] = ramp(0.1, 1)[::2]
    often = np.where(own[..., 0] <= 0.1, np.float32(9), np.float32(1))
    np.testing.assert_allclose(evenly_demanded(own, halves, 1.0, often)[1][:48], 0.05, atol=0.01)
    assert evenly_demanded(own, halves, 1.0)[1][:48].min() > 0.1
    alike = evenly_demanded(own, halves, 1.0, np.ones_like(often))
    for one, other in zip(alike, evenly_demanded(own, halves, 1.0), strict=True):
        np.testing.assert_allclose(one, other, atol=1e-3)
