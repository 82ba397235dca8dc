"""What neighbourhoods of a texture under control are compared by."""

from __future__ import annotations

import numpy as np
import pytest

from texloom.stages.arrays import Image
from texloom.stages.synthesis.control_features import ControlFeaturesParams, control_features


def stripes(period: int) -> Image:
    """Grey, and on the right half with stripes."""
    planes = np.full((64, 128, 3), 0.2, np.float32)
    planes[:, 64:] += 0.05 * np.sign(np.sin((np.arange(64) + 0.5) * 2 * np.pi / period))[:, None]
    return Image(planes, ("R", "G", "B"))


@pytest.mark.parametrize(("name", "period", "other"), [("detail", 2, 16), ("contrast", 16, 2)])
def test_strength_is_that_of_its_own_scale(name: str, period: int, other: int) -> None:
    flat, own, elsewhere = [], [], []
    for width in (period, other):
        params = ControlFeaturesParams(**{"detail": 0.0, "contrast": 0.0, name: 1.0})
        strength = control_features(stripes(width), params).planes[..., 3]
        flat.append(float(strength[:, :32].max()))
        (own if width == period else elsewhere).append(float(strength[:, 96].mean()))
    assert flat == pytest.approx([0.0, 0.0], abs=1e-2)
    assert own[0] > 3
    if name == "detail":
        assert own[0] > 2 * elsewhere[0]


def test_weights_are_factors_and_nought_leaves_out() -> None:
    image = stripes(8)
    none, one, double = (
        control_features(image, ControlFeaturesParams(detail=0, contrast=weight)).planes for weight in (0, 1, 2)
    )
    assert none.shape[2] == 3
    assert one.shape[2] == double.shape[2] == 4
    np.testing.assert_allclose(double[..., 3], 2 * one[..., 3])
    np.testing.assert_array_equal(one[..., :3], none)


def test_what_control_explains(rng: np.random.Generator) -> None:
    spots = rng.random((16, 32, 1)).repeat(4, axis=0).repeat(4, axis=1).astype(np.float32)
    image = Image(spots.repeat(3, axis=2), ("R", "G", "B"))
    own, other = (Image(planes, ("Y",)) for planes in (spots, np.ascontiguousarray(spots[::-1, ::-1])))
    none, told, chance = (
        control_features(image, ControlFeaturesParams(), control).explained for control in (None, own, other)
    )
    assert none == 0.0
    assert told > 0.5
    assert chance < 0.1
