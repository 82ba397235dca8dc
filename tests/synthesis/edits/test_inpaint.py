"""Bands and holes of an image, filled with blocks of it."""

from __future__ import annotations

from typing import Any

import numpy as np
import pydantic
import pytest

from tests.synthetic import blobs, identity, masked, picture, smooth_noise, tiled
from tests.wraps import X, Y
from texloom.stages.common.grids.border_steps import border_steps
from texloom.stages.lookup.registry import find_stage
from texloom.stages.synthesis.edits.border_band import BorderBandParams, border_band
from texloom.stages.synthesis.edits.inpaint import Inpainted, InpaintParams, inpaint
from texloom.stages.synthesis.optimisation.optimise import optimise
from texloom.stages.synthesis.optimisation.optimise_params import OptimiseParams
from texloom.stages.vocabulary.arrays import Image
from texloom.stages.vocabulary.declare import InputError
from texloom.stages.vocabulary.facts import TORUS, Wraps

SHAPE = (112, 120)


@pytest.fixture
def pattern(rng: np.random.Generator) -> Image:
    """A pattern that does not fit its picture a whole number of times."""
    return tiled(blobs((24, 26, 3), rng, 2.0), 0, SHAPE)[0]


def run(image: Image, keep: np.ndarray, **params: Any) -> Inpainted:
    return inpaint(image, keep, InpaintParams(**params))


@pytest.mark.parametrize(
    "hole", [(slice(40, 62), slice(30, 55)), (slice(0, 18), slice(90, 120)), (slice(50, 64), slice(0, 120))]
)
def test_a_hole_in_a_pattern_is_filled(pattern: Image, hole: tuple[slice, slice]) -> None:
    """Inside, in a corner and right across: exactly, since the pattern shows the same elsewhere."""
    keep = np.ones(SHAPE, bool)
    keep[hole] = False
    result = run(masked(pattern, keep, 7.0), keep)
    np.testing.assert_array_equal(result.image.pixels[keep], pattern.pixels[keep])
    np.testing.assert_array_equal(result.match[keep], identity(SHAPE)[keep])
    assert keep[tuple(np.moveaxis(result.match, 2, 0))].all()
    assert result.image.channels == ("R", "G", "B")
    np.testing.assert_allclose(result.image.pixels, pattern.pixels, atol=1e-6)


def test_values_in_a_hole_make_no_difference(rng: np.random.Generator) -> None:
    image = picture(smooth_noise((*SHAPE, 3), 3.0, rng))
    keep = np.ones(SHAPE, bool)
    keep[30:60, 20:80] = False
    one, other = (run(masked(image, keep, value), keep) for value in (0.0, 50.0))
    np.testing.assert_array_equal(one.match, other.match)


def border_jump(pixels: np.ndarray) -> float:
    """Difference across the borders relative to that of neighbours inside, the larger of the two axes."""
    ratios = []
    for axis in (0, 1):
        steps = np.abs(pixels - np.roll(pixels, 1, axis)).mean(axis=(1 - axis, 2))
        ratios.append(float(steps[0] / steps[1:].mean()))
    return max(ratios)


def test_a_band_makes_a_picture_tile(rng: np.random.Generator) -> None:
    """The start, and better still the optimisation; kept pixels are unchanged."""
    image = picture(blobs((*SHAPE, 3), rng))
    keep = border_band(image, BorderBandParams(width=18)).keep
    start = run(image, keep, tileable=True)
    params = OptimiseParams(preset="fast", tileable=True, coarsest=60)
    done = optimise(image, start.match, params, np.random.default_rng(1), keep=keep)
    for result in (start, done):
        np.testing.assert_array_equal(result.image.pixels[keep], image.pixels[keep])
    assert border_jump(image.pixels) > 3
    assert border_jump(start.image.pixels) < 0.7 * border_jump(image.pixels)
    assert border_jump(done.image.pixels) < 1.3


def test_an_image_without_holes_is_unchanged(pattern: Image) -> None:
    keep = np.ones(SHAPE, bool)
    for tileable in (False, True):
        np.testing.assert_array_equal(run(pattern, keep, tileable=tileable).image.pixels, pattern.pixels)
    with pytest.raises(ValueError, match="keep of shape"):
        run(pattern, keep.T)


def test_too_small_images_are_refused(pattern: Image) -> None:
    keep = np.broadcast_to(np.arange(SHAPE[1]) % 20 < 12, SHAPE)
    with pytest.raises(InputError, match="leaves no whole block of 16 px"):
        run(masked(pattern, keep, 7.0), keep)
    check = find_stage("synthesis.inpaint").check
    assert check is not None
    check(InpaintParams(block=56), {"image": pattern})
    with pytest.raises(InputError, match="120 x 112 px is too small for blocks of 57 px"):
        check(InpaintParams(block=57), {"image": pattern})


@pytest.mark.parametrize(("width", "expected"), [(None, 16), (20, 20)])
def test_bands_run_along_all_borders(pattern: Image, width: int | None, expected: int) -> None:
    keep = border_band(pattern, BorderBandParams(width=width)).keep
    row, column = np.indices(SHAPE)
    away = np.minimum.reduce([row, SHAPE[0] - 1 - row, column, SHAPE[1] - 1 - column])
    np.testing.assert_array_equal(keep, away >= expected)
    check = find_stage("synthesis.border_band").check
    assert check is not None
    with pytest.raises(InputError, match="too small for bands of 30 px") as caught:
        check(BorderBandParams(width=30), {"image": pattern})
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("wrap", [X, Y])
def test_bands_run_along_the_borders_of_one_axis(pattern: Image, wrap: Wraps) -> None:
    keep = border_band(pattern, BorderBandParams(width=20, tileable=wrap)).keep
    both = border_band(pattern, BorderBandParams(width=20)).keep
    inner = both.any(axis=0) if wrap == X else both.any(axis=1)[:, None]
    np.testing.assert_array_equal(keep, np.broadcast_to(inner, SHAPE))
    check = find_stage("synthesis.border_band").check
    assert check is not None
    check(BorderBandParams(width=28, tileable=wrap), {"image": pattern.cropped(*_long(wrap))})
    with pytest.raises(pydantic.ValidationError, match="off leaves the picture as it is"):
        BorderBandParams(tileable=False)


def _long(wrap: Wraps) -> tuple[slice, slice]:
    """A part that has bands of 28 px along one axis only."""
    return (slice(40), slice(None)) if wrap == X else (slice(None), slice(40))


@pytest.mark.parametrize("wrap", [X, Y])
def test_a_picture_is_made_to_continue_along_one_axis(wrap: Wraps) -> None:
    """The steps across the borders of that axis become those inside; the band alone is changed."""
    rows, columns = np.mgrid[:96, :128]
    values = 0.5 + 0.3 * np.sin(rows / 3.1) * np.sin(columns / 2.7) + 0.002 * (rows + columns)
    drift = Image(values.astype(np.float32)[..., None], ("Y",))
    keep = border_band(drift, BorderBandParams(width=16, tileable=wrap)).keep
    made = run(drift, keep, tileable=wrap).image
    assert made.wraps == wrap
    np.testing.assert_array_equal(made.pixels[keep], drift.pixels[keep])
    before, after = border_steps(drift), border_steps(made)
    assert after[wrap.across] < 1.6 < before[wrap.across]


def test_a_picture_that_wraps_along_one_axis_gets_the_other(pattern: Image) -> None:
    """`make_tileable --tileable=x` of a tile along y is a tile along both."""
    keep = border_band(pattern, BorderBandParams(width=20, tileable=X)).keep
    start = run(pattern.wrapping(Y), keep, tileable=X)
    assert start.image.wraps == TORUS
    params = OptimiseParams(preset="fast", tileable=X, coarsest=100)
    made = optimise(pattern.wrapping(Y), start.match, params, np.random.default_rng(0), keep=keep)
    assert made.image.wraps == TORUS
    assert not run(pattern.wrapping(Y), keep, tileable=False).image.wraps


@pytest.mark.parametrize("wrap", [X, Y])
def test_a_picture_that_wraps_along_one_axis_stays_so(
    pattern: Image, wrap: Wraps, caplog: pytest.LogCaptureFixture
) -> None:
    keep = np.ones((pattern.height, pattern.width), bool)
    keep[:8, 20:40] = keep[-8:, 20:40] = keep[20:40, :8] = keep[20:40, -8:] = False
    asked = run(pattern, keep, tileable=wrap)
    kept = run(pattern.wrapping(wrap), keep)
    assert f"keeps tiling ({wrap})" in caplog.text
    np.testing.assert_array_equal(kept.match, asked.match)
    assert kept.image.wraps == asked.image.wraps == wrap


def test_a_picture_that_wraps_stays_so(pattern: Image, caplog: pytest.LogCaptureFixture) -> None:
    keep = np.ones((pattern.height, pattern.width), bool)
    keep[:8, 20:40] = keep[-8:, 20:40] = False
    asked = run(pattern, keep, tileable=True)
    assert not caplog.records
    kept = run(pattern.wrapping(True), keep)
    assert "keeps tiling" in caplog.text
    np.testing.assert_array_equal(kept.match, asked.match)
    assert kept.image.wraps == asked.image.wraps == TORUS
    assert not run(pattern.wrapping(True), keep, tileable=False).image.wraps
