"""What neighbourhoods of a texture under control are compared by."""

from __future__ import annotations

import numpy as np
import pytest

from tests.synthetic import picture
from texloom.stages.synthesis.control_maps.coarse_level import CoarseLevelParams, coarse_level
from texloom.stages.synthesis.control_maps.control_features import ControlFeaturesParams, control_features
from texloom.stages.vocabulary.arrays import Image
from texloom.stages.vocabulary.declare import InputError


def stripes(period: int) -> Image:
    """Grey, and on the right half with stripes."""
    planes = np.full((64, 128, 3), 0.2, np.float32)
    planes[:, 64:] += 0.05 * np.sign(np.sin((np.arange(64) + 0.5) * 2 * np.pi / period))[:, None]
    return Image(planes, ("R", "G", "B"))


@pytest.mark.parametrize(("name", "period", "other"), [("detail", 2, 16), ("contrast", 16, 2)])
def test_strength_is_that_of_its_own_scale(name: str, period: int, other: int) -> None:
    params = ControlFeaturesParams(**{"detail": 0.0, "contrast": 0.0, name: 1.0})
    own, elsewhere = (control_features(stripes(width), params).planes[..., 3] for width in (period, other))
    assert max(own[:, :32].max(), elsewhere[:, :32].max()) < 1e-2
    assert own[:, 96].mean() > 3
    if name == "detail":
        assert own[:, 96].mean() > 2 * elsewhere[:, 96].mean()


def test_weights_are_factors_and_zero_omits_the_plane() -> None:
    image = stripes(8)
    none, one, double = (
        control_features(image, ControlFeaturesParams(detail=0, contrast=weight)).planes for weight in (0, 1, 2)
    )
    assert none.shape[2] == 3
    assert one.shape[2] == double.shape[2] == 4
    np.testing.assert_allclose(double[..., 3], 2 * one[..., 3])
    np.testing.assert_array_equal(one[..., :3], none)


def test_colours_of_a_coarse_level_follow_detail() -> None:
    image = stripes(8)
    level = coarse_level(image, CoarseLevelParams())
    plain, guided, without = (
        control_features(image, ControlFeaturesParams(coarse=weight), guide=guide).planes
        for weight, guide in ((2, None), (2, level.guide), (0, level.guide))
    )
    np.testing.assert_array_equal(guided[..., :-3], plain)
    np.testing.assert_array_equal(guided[..., -3:], 2 * level.guide)
    np.testing.assert_array_equal(without, plain)


def test_what_control_explains(rng: np.random.Generator) -> None:
    spots = rng.random((16, 32, 1)).repeat(4, axis=0).repeat(4, axis=1).astype(np.float32)
    image = Image(spots.repeat(3, axis=2), ("R", "G", "B"))
    own, other = (Image(planes, ("Y",)) for planes in (spots, np.ascontiguousarray(spots[::-1, ::-1])))
    without, related, unrelated = (
        control_features(image, ControlFeaturesParams(), control).explained for control in (None, own, other)
    )
    assert without == 0.0
    assert related > 0.5
    assert unrelated < 0.1


def test_the_control_map_at_the_size_of_the_texture() -> None:
    ramp = np.linspace(0.1, 0.9, 30, dtype=np.float32) * np.ones((22, 1), np.float32)
    coarse = picture(ramp[::2, ::2])
    made = [control_features(picture(ramp), ControlFeaturesParams(), one) for one in (None, picture(ramp), coarse)]
    assert made[0].control is None
    np.testing.assert_array_equal(made[1].control.pixels, picture(ramp).pixels, "a map of that size is unchanged")
    assert made[2].control.pixels.shape == picture(ramp).pixels.shape
    assert np.abs(made[2].control.pixels - picture(ramp).pixels).max() < 0.05


RAMP = np.broadcast_to(np.linspace(0.1, 0.9, 30), (22, 30))
SPOILED = np.where(RAMP > 0.8, np.nan, RAMP)


@pytest.mark.parametrize(
    ("texture", "control", "message"),
    [
        (0 * RAMP, RAMP, "^texture: every channel is constant, so there is nothing to summarise$"),
        (SPOILED, RAMP, "^texture has values that are not finite"),
        (RAMP, SPOILED, "^control has values that are not finite"),
        (RAMP, 0 * RAMP, "^control: every channel is constant"),
        (RAMP, RAMP[:15], "^control: 30 x 15 px has another aspect ratio than texture, 30 x 22 px"),
    ],
)
def test_inputs_that_do_not_fit_or_hold_no_information_are_refused(
    texture: np.ndarray, control: np.ndarray, message: str
) -> None:
    with pytest.raises(InputError, match=message):
        control_features(picture(texture), ControlFeaturesParams(), picture(control))
