from __future__ import annotations

import numpy as np
import pytest

from tests.synthetic import blobs, picture
from texloom.stages.analysis.exemplars.tone import ToneParams, tone
from texloom.stages.synthesis.edits.restore_tone import RestoreToneParams, restore_tone
from texloom.stages.vocabulary.arrays import Image
from texloom.stages.vocabulary.declare import InputError

PARAMS = RestoreToneParams()


@pytest.fixture
def even(rng: np.random.Generator) -> Image:
    return picture(0.1 + 0.4 * np.stack([blobs((160, 192), rng)] * 3, axis=2))


def halves(image: Image, axis: int) -> float:
    """Ratio of the mean light of the last half to that of the first."""
    first, last = np.array_split(image.color, 2, axis=axis)
    return float(last.mean() / first.mean())


def test_the_drift_of_the_exemplar_comes_back(even: Image) -> None:
    light = np.exp(np.linspace(-0.7, 0.7, 192))[:, None]
    drifting = picture(even.pixels * light)
    parts = tone(drifting, ToneParams())
    assert halves(parts.image, 1) == pytest.approx(halves(even, 1), abs=0.1)
    restored = restore_tone(parts.image, PARAMS, tone=parts.tone)
    np.testing.assert_allclose(restored.image.pixels, drifting.pixels, rtol=0.02, atol=0.002)


def test_it_is_stretched_over_a_larger_texture(even: Image) -> None:
    drift = np.zeros((4, 4, 3), np.float32)
    drift[..., 0] = np.linspace(-0.15, 0.15, 4)[:, None]
    large = Image(np.tile(even.pixels, (2, 2, 1)), even.channels)
    result = restore_tone(large, PARAMS, tone=drift).image
    assert halves(result, 0) > 1.4
    assert halves(result, 1) == pytest.approx(halves(large, 1), rel=0.01)


def test_a_picture_controls_light_but_not_its_detail(even: Image, rng: np.random.Generator) -> None:
    shade = np.linspace(0.1, 0.6, 90)[:, None] * rng.uniform(0.8, 1.2, (90, 70))
    result = restore_tone(even, PARAMS, control=picture(shade)).image
    assert halves(result, 0) > 1.5
    smooth = restore_tone(even, PARAMS, control=picture(np.linspace(0.1, 0.6, 90)[:, None].repeat(70, 1))).image
    np.testing.assert_allclose(result.pixels, smooth.pixels, rtol=0.25)


def test_chroma_follows_the_picture_unless_turned_off(even: Image) -> None:
    tint = np.full((60, 60, 3), 0.3)
    tint[:, 30:, 2] = 0.1
    result = restore_tone(even, PARAMS, control=picture(tint)).image
    blue = result.pixels[..., 2] / result.pixels[..., 0]
    assert blue[:, -20:].mean() < 0.8 * blue[:, :20].mean()
    grey = restore_tone(even, RestoreToneParams(chroma=False), control=picture(tint)).image
    np.testing.assert_allclose(grey.pixels[..., 2], grey.pixels[..., 0], rtol=1e-5)


def test_tileable_textures_stay_so(even: Image) -> None:
    flat = picture(np.full((64, 64), 0.3))
    shade = picture(np.linspace(0.2, 0.5, 50)[:, None].repeat(50, 1))
    wrapped = restore_tone(flat.wrapping(True), PARAMS, control=shade).image.pixels
    assert np.abs(wrapped[0] - wrapped[-1]).max() <= np.abs(np.diff(wrapped, axis=0)).max()
    with pytest.raises(InputError, match="it wraps, but the exemplar's drift does not"):
        restore_tone(even.wrapping(True), PARAMS, tone=np.zeros((4, 4, 3), np.float32))


def test_other_maps_and_strength_zero_change_nothing(even: Image) -> None:
    maps = Image(np.concatenate([even.pixels, even.pixels[..., :1]], axis=2), (*even.channels, "height"))
    shade = picture(np.linspace(0.1, 0.6, 50)[:, None].repeat(50, 1))
    result = restore_tone(maps, PARAMS, control=shade).image
    np.testing.assert_array_equal(result.pixels[..., 3], maps.pixels[..., 3])
    none = restore_tone(maps, RestoreToneParams(strength=0), control=shade).image
    np.testing.assert_array_equal(none.pixels, maps.pixels)


def test_something_has_to_be_restored(even: Image) -> None:
    with pytest.raises(InputError, match="tone: give"):
        restore_tone(even, PARAMS)
