from __future__ import annotations

import dataclasses
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from tests.runs import run_with_threads
from tests.synthetic import picture, smooth_noise
from texloom.stages.analysis.similarity.appearance_stack import AppearanceStackParams, appearance_stack
from texloom.stages.common.features.control import painted_values
from texloom.stages.interactive.canvas import Canvas, CoarseColours, Rect, colours_help
from texloom.stages.interactive.painted_colours import PaintedColours
from texloom.stages.synthesis.control_maps.coarse_level import CoarseLevelParams, coarse_level
from texloom.stages.synthesis.per_pixel.per_pixel import ArrangementParams
from texloom.stages.vocabulary.arrays import Image
from texloom.stages.vocabulary.color import lab_from_linear, srgb_from_linear
from texloom.stages.vocabulary.declare import InputError
from texloom.stages.vocabulary.facts import Wraps

SHAPE = (48, 48)
SIZE = (96, 112)


@pytest.fixture(scope="module")
def image() -> Image:
    return picture(smooth_noise((*SHAPE, 3), 1.5, np.random.default_rng(3)))


@pytest.fixture(scope="module")
def control() -> Image:
    """A ramp of sRGB values from 0.2 to 0.8, and a channel that says nothing."""
    ramp = np.tile(np.linspace(0.2, 0.8, SHAPE[1]), (SHAPE[0], 1))
    planes = np.stack([ramp, np.full(SHAPE, 0.3), ramp.T], axis=2)
    return Image(planes.astype(np.float32), ("wet", "salt", "rust"))


@pytest.fixture(scope="module")
def canvas(image: Image, control: Image) -> Callable[..., Canvas]:
    """Makes a canvas with further arguments."""
    stack = appearance_stack(image, AppearanceStackParams(coarsest=12))

    def make(control: Image = control, size: tuple[int, int] = SIZE, **arguments: Any) -> Canvas:
        return Canvas(image, control, size, stack=stack, **arguments)

    return make


@pytest.mark.parametrize("tileable", [False, True])
def test_every_stroke_gives_the_texture_of_a_new_canvas(
    canvas: Callable[..., Canvas], tileable: bool, rng: np.random.Generator
) -> None:
    painted = canvas(values=0.5, tileable=tileable)
    values = np.full((*SIZE, 2), 0.5, np.float32)
    before = painted.match()
    spared = 0
    places = [(40, 50), (0, 0), (88, 104), (0, 60), (60, 100)]
    for top, left in places:
        dab = rng.random((8, 8, 2), np.float32)
        values[top : top + 8, left : left + 8] = dab
        changed = painted.paint(dab, top, left)
        after = painted.match()
        np.testing.assert_array_equal(after, canvas(values=values, tileable=tileable).match())
        outside = np.ones(SIZE, bool)
        for area in changed:
            outside[area.top : area.bottom, area.left : area.right] = False
        np.testing.assert_array_equal(after[outside], before[outside])
        spared += int(outside.sum())
        before = after
    assert spared > 0.3 * len(places) * before[..., 0].size
    whole = rng.random((*SIZE, 2), np.float32)
    painted.paint(whole)
    np.testing.assert_array_equal(painted.match(), canvas(values=whole, tileable=tileable).match())


def test_a_stroke_without_a_change_changes_no_rectangle(canvas: Callable[..., Canvas]) -> None:
    assert canvas(values=0.5).paint(np.full((30, 30, 2), 0.5, np.float32), 20, 20) == []


def test_planes_are_the_channels_that_vary(canvas: Callable[..., Canvas]) -> None:
    painted = canvas(values=0.5)
    assert painted.channels == ("wet", "rust")
    assert painted.planes == 2


def test_values_are_those_that_were_painted(canvas: Callable[..., Canvas], rng: np.random.Generator) -> None:
    values = rng.uniform(0.2, 0.8, (*SIZE, 2)).astype(np.float32)
    painted = canvas(values=values)
    np.testing.assert_allclose(painted.control(), values, atol=1e-6)
    painted.paint(np.full((4, 5, 2), 7, np.float32), 10, 20)
    np.testing.assert_allclose(painted.control(Rect(10, 14, 20, 25)), 0.8, atol=1e-6)


def test_pixels_and_picture_are_the_exemplar_at_match(image: Image, canvas: Callable[..., Canvas]) -> None:
    painted = canvas(values=0.5)
    match = painted.match()
    assert match.dtype == np.uint32
    pixels = image.pixels[match[..., 0], match[..., 1]]
    np.testing.assert_array_equal(painted.pixels(), pixels)
    np.testing.assert_array_equal(painted.picture(), np.rint(srgb_from_linear(pixels) * 255).astype(np.uint8))
    area = Rect(-5, 30, 100, 200)
    np.testing.assert_array_equal(painted.pixels(area), pixels[:30, 100:])
    assert painted.picture(Rect(50, 40, 0, 10)).size == 0


def test_the_texture_follows_what_is_painted(canvas: Callable[..., Canvas]) -> None:
    painted = canvas(values=0.3, params=ArrangementParams(control_weight=5.0))
    painted.paint(np.full((40, 40, 2), 0.7, np.float32), 30, 40)
    match = painted.match()
    inside, outside = match[40:60, 50:70].mean(axis=(0, 1)), match[:20, :20].mean(axis=(0, 1))
    assert (inside > outside + 15).all()


def test_threads_do_not_matter(canvas: Callable[..., Canvas], monkeypatch: pytest.MonkeyPatch) -> None:
    def paint() -> np.ndarray:
        painted = canvas(values=0.5)
        painted.paint(np.full((20, 20, 2), 0.2, np.float32), 5, 5)
        return painted.match()

    np.testing.assert_array_equal(*run_with_threads(paint, monkeypatch))


def test_bad_requests_are_refused(canvas: Callable[..., Canvas]) -> None:
    painted = canvas()
    for values, top, message in [
        (np.zeros((4, 4, 1), np.float32), 0, r"values of shape \(4, 4, 1\), not \(h, w, 2\)"),
        (np.zeros((4, 4, 2), np.float32), 93, "at row 93, column 0 on a canvas of 112 x 96"),
        (np.zeros((4, 4, 2), np.float32), -1, "at row -1"),
        (np.full((4, 4, 2), np.nan, np.float32), 0, "a value is not finite"),
    ]:
        with pytest.raises(ValueError, match=message):
            painted.paint(values, top, 0)
    with pytest.raises(ValueError, match="for a canvas of"):
        canvas(values=np.zeros((4, 4, 2), np.float32))
    with pytest.raises(InputError, match="cannot be tileable"):
        canvas(size=(100, 96), tileable=True)
    with pytest.raises(InputError, match="control: every channel is constant"):
        canvas(picture(np.zeros(SHAPE)))


@pytest.fixture(scope="module")
def coarse(image: Image, control: Image) -> CoarseColours:
    """Of a texture that the exemplar is a part of, whose left is dark and whose control map does not tell."""
    whole = np.tile(image.pixels, (2, 4, 1)) * np.linspace(0.3, 1, 4 * SHAPE[1])[:, None].astype(np.float32)
    maps = Image(np.tile(control.pixels, (2, 4, 1)), control.channels)
    made = coarse_level(image.elsewhere(whole), CoarseLevelParams(coarser=8))
    return CoarseColours(made.image, maps, made.guide[: SHAPE[0], 72 : 72 + SHAPE[1]])


@pytest.mark.parametrize("tileable", [False, True])
def test_every_stroke_gives_the_coarse_colours_of_a_new_canvas(
    canvas: Callable[..., Canvas], coarse: CoarseColours, tileable: bool, rng: np.random.Generator
) -> None:
    painted = canvas(values=0.5, tileable=tileable, coarse=coarse)
    values = np.full((*SIZE, 2), 0.5, np.float32)
    for top, left in [(40, 50), (0, 0), (88, 104), (0, 60)]:
        dab = rng.uniform(0.2, 0.8, (8, 8, 2)).astype(np.float32)
        values[top : top + 8, left : left + 8] = dab
        before = painted.match()
        changed = painted.paint(dab, top, left)
        after = painted.match()
        np.testing.assert_array_equal(after, canvas(values=values, tileable=tileable, coarse=coarse).match())
        outside = np.ones(SIZE, bool)
        for area in changed:
            outside[area.top : area.bottom, area.left : area.right] = False
        np.testing.assert_array_equal(after[outside], before[outside])
    np.testing.assert_allclose(painted.control(), values, atol=1e-6)


def test_coarse_colours_change_what_control_leaves_open(
    canvas: Callable[..., Canvas], coarse: CoarseColours, monkeypatch: pytest.MonkeyPatch
) -> None:
    def match() -> np.ndarray:
        return canvas(values=0.5, coarse=coarse).match()

    np.testing.assert_array_equal(*run_with_threads(match, monkeypatch))
    assert (match() != canvas(values=0.5).match()).any()


def test_colours_are_those_of_the_texture_under_its_own_map(coarse: CoarseColours) -> None:
    own = painted_values(coarse.control)[..., [0, 2]]
    colours = coarse.level.pixels
    painted = PaintedColours(own, colours, own.shape[:2], Wraps())
    painted.paint(own, 0, 0)
    np.testing.assert_allclose(painted.planes[3::8, 3::8, 2:], colours, atol=0.02)


def test_colours_that_do_not_belong_are_refused(canvas: Callable[..., Canvas], coarse: CoarseColours) -> None:
    swapped = {
        "level": coarse.control,
        "control": coarse.level.with_pixels(coarse.level.pixels, coarse.control.channels),
    }
    changes: list[tuple[dict[str, Any], str]] = [
        ({"guide": coarse.guide[1:]}, "coarse: guide of 48 x 47 px for an image of 48 x 48 px"),
        ({"control": Image(coarse.control.pixels[..., :1], ("wet",))}, "coarse: control has channels wet, that of"),
        (swapped, "coarse: level of 192 x 96 px for a control map of 24 x 12 px"),
    ]
    for changed, message in changes:
        with pytest.raises(InputError, match=message):
            canvas(coarse=dataclasses.replace(coarse, **changed))


def test_colours_help_where_they_bring_the_texture_nearer(
    image: Image, control: Image, coarse: CoarseColours
) -> None:
    stack = appearance_stack(image, AppearanceStackParams(coarsest=12))
    texture = image.elsewhere(np.tile(image.pixels, (2, 4, 1)))
    asked = lab_from_linear(texture.color)
    level = coarse_level(texture, CoarseLevelParams(coarser=8), coarse.control)
    right = CoarseColours(level.image, coarse.control, asked[: SHAPE[0], : SHAPE[1]])
    wrong = dataclasses.replace(right, level=level.image.elsewhere(level.image.pixels[::-1].copy()))
    assert colours_help(texture, image, control, right, stack=stack)
    assert not colours_help(texture, image, control, wrong, stack=stack)
