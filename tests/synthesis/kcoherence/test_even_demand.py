"""Values of control that a smooth target asks for far more often than an exemplar has them."""

from __future__ import annotations

import numpy as np
import pytest

from tests.synthetic import smooth_noise
from texloom.stages.synthesis._kcoherence.comparable_control import comparable
from texloom.stages.synthesis._kcoherence.even_demand import evenly_demanded


def ramp(*ends: float) -> np.ndarray:
    return np.linspace(*ends, 96 * 96, dtype=np.float32).reshape(96, 96, 1)


def largest_overuse(own: np.ndarray, wanted: np.ndarray) -> float:
    """Of a twentieth of the exemplar's pixels, those of similar values."""
    edges = np.quantile(own, np.linspace(0, 1, 21))
    return float(20 * np.histogram(wanted.clip(own.min(), own.max()), edges)[0].max() / wanted.size)


def test_no_value_is_asked_for_far_more_often_than_it_occurs() -> None:
    own, extremes = ramp(0, 1), ramp(0, 1) ** 0.1
    assert largest_overuse(own, extremes) > 7
    moved = evenly_demanded(own, extremes)
    assert largest_overuse(own, moved) < 2.2
    assert (np.diff(moved.ravel()) >= 0).all()
    assert moved.dtype == np.float32


def test_two_extremes_become_the_means_of_the_quarters_that_serve_them() -> None:
    target = (ramp(0, 1) > 0.5).astype(np.float32)
    dark, bright = np.unique(evenly_demanded(ramp(0, 1), target).round(2))
    assert (dark, bright) == pytest.approx((0.125, 0.875), abs=0.01)


def test_what_is_asked_for_as_often_as_it_occurs_stays() -> None:
    own = ramp(0, 1)
    np.testing.assert_allclose(evenly_demanded(own, ramp(0.2, 0.8)), ramp(0.2, 0.8), atol=0.003)
    target = ramp(0, 1) ** 0.1
    moved = evenly_demanded(own, target)
    np.testing.assert_allclose(evenly_demanded(own, moved), moved, atol=0.01)


def test_channels_are_independent() -> None:
    own = np.concatenate([ramp(0, 1), ramp(0, 1)[::-1]], axis=2)
    target = np.concatenate([ramp(0, 1), ramp(0, 1) ** 0.1], axis=2)
    moved = evenly_demanded(own, target)
    for channel in range(2):
        alone = evenly_demanded(own[..., channel, None], target[..., channel, None])
        np.testing.assert_array_equal(moved[..., channel, None], alone)
    none = np.zeros((5, 5, 0), np.float32)
    assert evenly_demanded(none, none) is none


def test_only_a_target_smoother_than_control_is_moved(rng: np.random.Generator) -> None:
    own = rng.random((96, 96, 1), dtype=np.float32)
    smooth = smooth_noise((96, 96), 12, rng)[..., None].astype(np.float32)
    smooth = (smooth - smooth.min()) / np.ptp(smooth)
    moved = comparable(own, smooth, 1.0, toroidal=True)
    assert moved.rare > 0.2
    assert np.corrcoef(moved.wanted.ravel(), smooth.ravel())[0, 1] > 0.9
    as_detailed = comparable(own, own[::-1].copy(), 1.0, toroidal=True)
    assert as_detailed.own is own
    assert as_detailed.rare == 0
