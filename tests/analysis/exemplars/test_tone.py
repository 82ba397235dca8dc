from __future__ import annotations

import logging
from typing import Any

import numpy as np
import pytest

from tests.synthetic import blobs, masked, picture
from texloom.stages.analysis.exemplars.tone import Tone, ToneParams, tone
from texloom.stages.vocabulary.arrays import Image
from texloom.stages.vocabulary.color import lab_from_linear, linear_from_lab

AUTO = ToneParams()


def texture(rng: np.random.Generator, shape: tuple[int, int] = (160, 192)) -> Image:
    return picture(0.1 + 0.4 * np.stack([blobs(shape, rng)] * 3, axis=2) * rng.uniform(0.5, 1, (1, 1, 3)))


def ramp(shape: tuple[int, int], down: float, across: float, bend: float = 0.0) -> np.ndarray:
    row, column = np.meshgrid(*(np.linspace(-1, 1, side) for side in shape), indexing="ij")
    return np.exp(down * row + across * column + bend * (column**2 - 1 / 3))[..., None]


def lit(image: Image, light: np.ndarray) -> Image:
    pixels = image.pixels.copy()
    pixels[..., :3] *= light
    return Image(pixels, image.channels)


def remaining(result: Tone, even: Image) -> float:
    """Deviation of the light that remains, as a share."""
    ratio = (result.image.color + 1e-4).mean(axis=2) / (even.color + 1e-4).mean(axis=2)
    return float(ratio.std() / ratio.mean())


@pytest.mark.parametrize("drift", [(0.6, 0.0, 0.0), (0.3, -0.7, 0.0), (0.0, 0.2, 0.7)])
def test_uneven_light_is_recovered(drift: tuple[float, float, float], rng: np.random.Generator) -> None:
    even = texture(rng)
    light = ramp((160, 192), *drift)
    result = tone(lit(even, light), AUTO)
    assert result.lightness > 10
    assert remaining(result, even) < 0.1
    assert result.tone.shape[2] == 3


def test_a_tint_that_drifts_is_removed(rng: np.random.Generator) -> None:
    even = texture(rng)
    tint = np.concatenate([ramp((160, 192), 0.0, share) for share in (0.35, 0.0, -0.35)], axis=2)
    drifting = lit(even, tint)
    result = tone(drifting, AUTO)
    assert result.chroma > 4

    def difference(image: Image) -> float:
        lab = lab_from_linear(image.color)
        return float(np.abs(lab[:, :40, 1:].mean(axis=(0, 1)) - lab[:, -40:, 1:].mean(axis=(0, 1))).max())

    assert difference(result.image) < 0.15 * difference(drifting)


@pytest.mark.parametrize("light", [0.6, 0.0])
def test_a_tint_along_with_light_is_removed_although_specks_have_none(
    light: float, rng: np.random.Generator
) -> None:
    """Alone it may be a change of the material."""
    shape = (192, 192)
    specks = (rng.random((48, 48)) < 0.2).repeat(4, 0).repeat(4, 1)[..., None]
    tint = np.concatenate([ramp(shape, share, 0.0) * np.exp(share) for share in (0.3, -0.1, 0.1)], axis=2)
    even = picture(0.2 * rng.uniform(0.9, 1.1, (*shape, 1)) * np.where(specks, 1, tint))
    result = tone(lit(even, ramp(shape, light, 0.0)), AUTO)
    assert bool(result.tone[..., 1:].any()) == (light > 0)


def test_an_even_exemplar_is_returned_unchanged(rng: np.random.Generator) -> None:
    for image in (texture(rng), picture(blobs((130, 140), rng, 12.0)), picture(np.full((80, 90), 0.3))):
        result = tone(image, AUTO)
        np.testing.assert_array_equal(result.image.pixels, image.pixels)
        assert not result.tone.any()
        assert result.lightness == result.chroma == 0


def test_proportions_of_two_materials_are_no_drift(rng: np.random.Generator) -> None:
    """A bright material becomes rare from left to right, neither of the two darkens."""
    shape = (192, 192)
    bright = rng.random((96, 96)).repeat(2, 0).repeat(2, 1) > np.linspace(0.2, 0.8, 192)
    image = picture(np.where(bright, 0.5, 0.1) * rng.uniform(0.95, 1.05, shape))
    np.testing.assert_array_equal(tone(image, AUTO).image.pixels, image.pixels)


@pytest.mark.parametrize("bend", [0.0, -0.5])
@pytest.mark.parametrize("kind", ["from side to side", "at the rim"])
def test_light_is_recovered_whatever_the_proportions_of_two_materials(
    kind: str, bend: float, rng: np.random.Generator
) -> None:
    """Means of blocks follow the proportions: they were evened too, and dark rims glowed."""
    shape = (256, 288)
    down, across = np.meshgrid(*(np.linspace(-1, 1, side) for side in shape), indexing="ij")
    dark = blobs(shape, rng) < (0.5 + 0.35 * across if kind == "from side to side" else 0.6 * (down**2 + across**2))
    even = picture(
        (np.where(dark, 0.05, 0.4) * np.exp(0.2 * rng.standard_normal(shape)))[..., None] * [1, 0.8, 0.5]
    )
    assert not tone(even, AUTO).tone.any()
    result = tone(lit(even, ramp(shape, 0.4, 0.3, bend)), AUTO)
    assert result.lightness > 10
    assert remaining(result, even) < 0.06


def test_a_change_of_hue_is_preserved_with_a_warning(
    rng: np.random.Generator, caplog: pytest.LogCaptureFixture
) -> None:
    """It is the material that changes from red to blue, not the light."""
    tint = np.concatenate([ramp((160, 192), 0.0, share) for share in (1.2, 0.0, -1.2)], axis=2)
    image = lit(texture(rng), tint)
    with caplog.at_level(logging.WARNING):
        np.testing.assert_array_equal(tone(image, AUTO).image.pixels, image.pixels)
    (record,) = caplog.records
    assert "STEP.even=always" in record.getMessage()


def test_strong_light_on_a_coloured_surface_is_evened(rng: np.random.Generator) -> None:
    """Its reflection is less saturated: colour drifts by more than 30 units, and lightness by more than that."""
    share = np.linspace(0, 1, 160)[:, None, None] ** 1.3
    noise = rng.uniform(0.8, 1.2, (160, 192, 1))
    image = picture(noise * ((1 - share) * [0.03, 0.06, 0.2] + share * [0.6, 0.66, 0.8]))
    result = tone(image, AUTO)
    assert result.lightness > result.chroma > 30
    rows = result.image.color.mean(axis=1)
    assert rows[:40].mean(axis=0) / rows[-40:].mean(axis=0) == pytest.approx(1, abs=0.2)


def test_a_border_between_two_colours_is_no_drift(rng: np.random.Generator) -> None:
    shape = (128, 128)
    red = np.arange(128) + 20 * rng.random(shape) < 70
    image = picture(
        np.where(red[..., None], [0.5, 0.05, 0.05], [0.1, 0.45, 0.5]) * rng.uniform(0.8, 1.2, (*shape, 1))
    )
    np.testing.assert_array_equal(tone(image, AUTO).image.pixels, image.pixels)
    assert tone(image, ToneParams(even="always")).chroma > 30


def test_large_objects_are_not_flattened(rng: np.random.Generator) -> None:
    """A dark object leaves the drift of the ground as it is."""
    even = texture(rng)
    light = ramp((160, 192), 0.0, 0.6)
    dark = np.ones((160, 192, 1))
    dark[55:105, 70:120] = 0.2
    removed = tone(lit(even, light), ToneParams(even="always")).tone
    beside = tone(lit(lit(even, light), dark), ToneParams(even="always")).tone
    assert float(np.square(removed - beside)[..., 0].mean() ** 0.5) < 0.03


def test_only_colour_of_a_map_set_is_evened(rng: np.random.Generator) -> None:
    drifting = lit(texture(rng), ramp((160, 192), 0.7, 0.0))
    height = np.linspace(0, 1, 160, dtype=np.float32)[:, None].repeat(192, 1)
    maps = Image(np.concatenate([drifting.pixels, height[..., None]], axis=2), (*drifting.channels, "height"))
    result = tone(maps, AUTO)
    assert result.image.channels == maps.channels
    np.testing.assert_array_equal(result.image.pixels[..., 3], height)
    np.testing.assert_array_equal(result.image.color, tone(drifting, AUTO).image.color)


def test_masked_pixels_have_no_influence(rng: np.random.Generator) -> None:
    drifting = lit(texture(rng), ramp((160, 192), 0.7, 0.0))
    usable = np.ones((160, 192), bool)
    usable[30:90, 50:120] = False
    results = [tone(masked(drifting, usable, value), AUTO) for value in (0.0, 30.0)]
    assert results[0].lightness > 10
    np.testing.assert_array_equal(results[0].tone, results[1].tone)
    np.testing.assert_array_equal(results[0].image.pixels[usable], results[1].image.pixels[usable])


def test_grey_pictures_are_evened_as_well(rng: np.random.Generator) -> None:
    drifting = picture((0.1 + 0.4 * blobs((160, 192), rng))[..., None] * ramp((160, 192), 0.7, 0.0))
    result = tone(drifting, AUTO)
    assert result.image.channels == ("Y",)
    assert result.lightness > 10
    assert result.chroma == 0


def test_it_can_be_turned_off_or_forced(rng: np.random.Generator) -> None:
    drifting = lit(texture(rng), ramp((160, 192), 0.7, 0.0))
    np.testing.assert_array_equal(tone(drifting, ToneParams(even="never")).image.pixels, drifting.pixels)
    even = texture(rng)
    assert tone(even, ToneParams(even="always")).tone.any()


def test_no_warning_where_only_contours_are_found(
    rng: np.random.Generator, caplog: pytest.LogCaptureFixture
) -> None:
    with caplog.at_level(logging.WARNING):
        drifting = lit(texture(rng), ramp((160, 192), 0.7, 0.0))
        assert tone(drifting, ToneParams(warn=False)).lightness > 0
        assert not caplog.records


def test_drift_is_reported_in_one_line(rng: np.random.Generator, caplog: pytest.LogCaptureFixture) -> None:
    with caplog.at_level(logging.WARNING):
        tone(texture(rng), AUTO)
        assert not caplog.records
        tone(lit(texture(rng), ramp((160, 192), 0.7, 0.0)), AUTO)
    (record,) = caplog.records
    assert "STEP.even=never" in record.getMessage()


def test_threads_do_not_matter(rng: np.random.Generator, on_threads: Any) -> None:
    drifting = lit(texture(rng, (400, 500)), ramp((400, 500), 0.7, 0.3))
    first, second = on_threads(lambda: tone(drifting, AUTO))
    np.testing.assert_array_equal(first.image.pixels, second.image.pixels)
    np.testing.assert_array_equal(first.tone, second.tone)


def plain(rng: np.random.Generator, stains: float, detail: float) -> Image:
    """Plaster with stains of one period across, which no polynomial follows, beside masked windows."""
    down, across = np.indices((160, 192)) / 192
    lightness = (
        60 + stains * np.sin(2 * np.pi * down) * np.sin(2 * np.pi * across) + detail * rng.normal(size=down.shape)
    )
    lab = np.stack([lightness, 0 * down, 4 + stains * np.sin(2 * np.pi * across)], axis=2).astype(np.float32)
    usable = np.ones((160, 192, 1), np.float32)
    for row, column in ((20, 10), (20, 70), (20, 130), (90, 10), (90, 70), (90, 130)):
        usable[row : row + 60, column : column + 45] = 0
    return Image(np.concatenate([linear_from_lab(lab), usable], axis=2), ("R", "G", "B", "usable"))


def test_all_slow_changes_of_a_plain_surface_are_drift(rng: np.random.Generator) -> None:
    image = plain(rng, 3.0, 0.5)
    known = image.pixels[..., 3] > 0
    result = tone(image, ToneParams())
    before, after = (lab_from_linear(shown.color)[known].std(axis=0) for shown in (image, result.image))
    assert after[0] < 0.6 * before[0]
    assert after[2] < 0.6 * before[2]
    assert result.lightness > 2
    assert result.chroma > 2


@pytest.mark.parametrize(("stains", "detail"), [(0.0, 0.5), (3.0, 5.0)])
def test_even_surfaces_and_those_with_details_are_not_plain(
    stains: float, detail: float, rng: np.random.Generator
) -> None:
    image = plain(rng, stains, detail)
    np.testing.assert_array_equal(tone(image, ToneParams()).image.pixels, image.pixels)
