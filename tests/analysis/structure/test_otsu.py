from __future__ import annotations

import numpy as np
import pydantic
import pytest

from texloom.stages.analysis.structure.otsu import OtsuParams, otsu
from texloom.stages.numerics.threshold import otsu_threshold

KEEP_ALL = OtsuParams(min_extent=0)


def test_two_levels_are_told_apart() -> None:
    strength = np.full((40, 60), 0.2, np.float32)
    strength[10:20, 5:50] = 0.8
    result = otsu(strength, OtsuParams())
    assert 0.2 < result.threshold < 0.8
    np.testing.assert_array_equal(result.structure, strength == np.float32(0.8))


@pytest.mark.parametrize("share", [0.05, 0.3, 0.5, 0.9])
def test_threshold_agrees_with_scikit_image(share: float, rng: np.random.Generator) -> None:
    from skimage.filters import threshold_otsu

    high = rng.random(5000) < share
    values = np.where(high, rng.normal(0.7, 0.1, 5000), rng.normal(0.3, 0.05, 5000))
    assert otsu_threshold(values) == pytest.approx(threshold_otsu(values), abs=1e-9)


@pytest.mark.parametrize(("factor", "shift"), [(100.0, 0.0), (1.0, -5.0), (1e-3, 7.0)])
def test_threshold_follows_scale_and_shift(factor: float, shift: float, rng: np.random.Generator) -> None:
    values = np.concatenate([rng.normal(0.3, 0.05, 500), rng.normal(0.7, 0.1, 200)])
    bin_width = factor * np.ptp(values) / 256
    assert abs(otsu_threshold(values * factor + shift) - (otsu_threshold(values) * factor + shift)) <= bin_width


@pytest.mark.parametrize("level", [0.0, 0.5, 1.0])
def test_constant_strength_has_no_features(level: float) -> None:
    result = otsu(np.full((9, 11), level, np.float32), KEEP_ALL)
    assert not result.structure.any()
    assert result.structure.shape == (9, 11)


def test_gaps_of_a_pixel_are_closed_and_wider_ones_are_not() -> None:
    strength = np.zeros((21, 40), np.float32)
    strength[10, 2:38] = 1
    strength[10, 12] = 0
    strength[10, 24:29] = 0
    structure = otsu(strength, KEEP_ALL).structure
    assert structure[10, 12]
    assert not structure[10, 24:29].any()


def test_crumbs_are_dropped_by_their_diagonal() -> None:
    strength = np.zeros((60, 80), np.float32)  # diagonal 100
    strength[30, 10:22] = 1  # 12 px
    strength[50, 60:66] = 1  # 6 px
    strength[np.arange(8) + 5, np.arange(8) + 60] = 1  # 8 px each way, 11.3 along the diagonal, corners touching
    diagonal = otsu(strength, OtsuParams(min_extent=0.10)).structure
    assert diagonal[30, 10:22].all()
    assert diagonal[8, 63]
    assert not diagonal[50].any()
    assert not otsu(strength, OtsuParams(min_extent=0.13)).structure.any()
    assert otsu(strength, KEEP_ALL).structure[50, 60:66].all()


def test_min_extent_is_a_share() -> None:
    with pytest.raises(pydantic.ValidationError, match="min_extent"):
        OtsuParams(min_extent=1.0)
