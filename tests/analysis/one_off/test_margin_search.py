"""Strips and corners of another texture at a border are found; what belongs to one texture never is."""

import numpy as np
import pytest

from benchmarks.foreign_parts import WALLS, noise
from texloom.stages.analysis.exemplars.plain_margins import plain_margins
from texloom.stages.analysis.one_off.foreign_margins import foreign_margins
from texloom.stages.analysis.one_off.margin_search import is_another_texture, margin_search
from texloom.stages.vocabulary.arrays import Image

SIDE = 192
ROWS, COLUMNS = np.indices((SIDE, SIDE))


def wall(name: str = "bricks") -> np.ndarray:
    return WALLS[name](np.random.default_rng(3), SIDE)


def planks() -> np.ndarray:
    """Thin dark planks with light joints: the colours of both are in a wall too."""
    grain = 1 + 0.1 * noise(np.random.default_rng(4), (SIDE, SIDE), 1.0)[..., None]
    joint = (ROWS % 8 < 2) | ((COLUMNS + ROWS // 8 * 23) % 46 < 2)
    colors = np.where(joint[..., None], [0.4, 0.38, 0.35], [0.06, 0.05, 0.05]) * grain
    return np.asarray(np.clip(colors, 0, 1), np.float32)


def beside(strip: np.ndarray, name: str = "bricks") -> np.ndarray:
    return np.asarray(np.where(strip[..., None], planks(), wall(name)), np.float32)


def found(pixels: np.ndarray) -> np.ndarray:
    return margin_search(Image.of(np.ascontiguousarray(pixels)), np.ones(pixels.shape[:2], np.bool_))


STRIPS = {
    "narrow": ROWS < 18,
    "wide": ROWS < 60,
    "beside": COLUMNS >= 150,
    "both": (ROWS < 24) | (ROWS >= 164),
    "frame": (np.minimum(ROWS, COLUMNS) < 16) | (np.maximum(ROWS, COLUMNS) >= 176),
    "corner": (ROWS < 80) & (COLUMNS >= 100),
    "contour": 40 + 7 * np.sin(COLUMNS / 14) > ROWS,
}


@pytest.mark.parametrize("strip", STRIPS)
@pytest.mark.parametrize("name", ["bricks", "plaster"])
def test_a_strip_of_another_texture_is_found(strip: str, name: str) -> None:
    truth = STRIPS[strip]
    made = found(beside(truth, name))
    assert made[truth].mean() > 0.97
    assert made[~truth].mean() < (0.1 if strip == "frame" else 0.06)


@pytest.mark.parametrize("turns", range(4))
@pytest.mark.parametrize("strip", ["narrow", "corner"])
def test_it_is_found_at_every_border(turns: int, strip: str) -> None:
    truth = np.rot90(STRIPS[strip], turns)
    made = found(np.rot90(beside(STRIPS[strip]), turns))
    assert made[truth].mean() > 0.97
    assert made[~truth].mean() < 0.04


@pytest.mark.parametrize("name", ["bricks", "plaster"])
def test_grey_pictures_are_told_by_texture(name: str) -> None:
    """Nothing but its texture tells the strip: means are equal."""
    light = wall(name).mean(axis=2, keepdims=True)
    strip = planks().mean(axis=2, keepdims=True)
    strip *= light.mean() / strip.mean()
    truth = STRIPS["wide"]
    assert found(np.where(truth[..., None], strip, light).astype(np.float32))[truth].mean() > 0.97


def headers() -> np.ndarray:
    """Bricks, every fourth course of which is of halves, with one at the border."""
    pixels = wall()
    header = (ROWS // 16 % 4 == 0) & (ROWS % 16 >= 3) & (COLUMNS % 16 < 3)
    return np.where(header[..., None], np.float32([0.45, 0.43, 0.4]), pixels)


def checks() -> np.ndarray:
    """Few large cells, cut by the border."""
    dark = ((ROWS + 20) // 40 + (COLUMNS + 31) // 40) % 2
    light = 0.1 + 0.5 * dark + 0.02 * noise(np.random.default_rng(5), (SIDE, SIDE), 1.0)
    return np.repeat(light[..., None], 3, axis=2).astype(np.float32)


def courses() -> np.ndarray:
    """A dark course after every five, the first of them at the border."""
    return np.asarray(np.where((ROWS // 16 % 6 == 0)[..., None], wall() * 0.3, wall()), np.float32)


def moss() -> np.ndarray:
    """Patches with soft borders, some of which reach the border."""
    share = np.clip(0.5 + 0.8 * noise(np.random.default_rng(6), (SIDE, SIDE), 14.0), 0, 1)[..., None]
    return np.asarray((1 - share) * wall("pebbles") + share * np.array([0.05, 0.15, 0.02]), np.float32)


UNIFORM = {
    "headers": headers,
    "checks": checks,
    "courses": courses,
    "moss": moss,
    "drift": lambda: wall() * np.linspace(0.3, 1.2, SIDE, dtype=np.float32)[:, None, None],
    "shadow": lambda: wall("plaster") * (0.4 + 0.6 / (1 + np.exp(-(ROWS - 40) / 12)))[..., None],
    "vignette": lambda: wall() * (1 - 0.8 * (np.hypot(ROWS - 96, COLUMNS - 96) / 136) ** 2)[..., None],
    "flat": lambda: np.full((SIDE, SIDE, 3), 0.5),
}


@pytest.mark.parametrize("name", [*WALLS, *UNIFORM])
def test_one_texture_stays_whole(name: str) -> None:
    pixels = np.asarray(UNIFORM[name]() if name in UNIFORM else wall(name), np.float32)
    for part in (pixels, pixels[7:150, 21:180], pixels.transpose(1, 0, 2)):
        assert not found(part).any()


def test_a_strip_of_more_than_a_third_is_half_of_what_the_picture_is_of() -> None:
    assert not found(beside(ROWS < 80)).any()


def test_what_is_excluded_tells_nothing() -> None:
    image = Image.of(beside(STRIPS["wide"]))
    assert not margin_search(image, ~STRIPS["wide"]).any()
    valid = COLUMNS < 150
    made = margin_search(image, valid)
    assert made[STRIPS["wide"] & valid].mean() > 0.97
    assert not made[~valid].any()


@pytest.mark.parametrize(("part", "another"), [("corner", True), ("wide", True), ("inner", False), ("wall", False)])
def test_parts_of_any_contour_are_told(part: str, another: bool) -> None:
    """One within the picture may be a motif; one that looks like the rest is not another texture."""
    inner = (np.abs(ROWS - 96) < 40) & (np.abs(COLUMNS - 96) < 40)
    mask = {**STRIPS, "inner": inner, "wall": ROWS > 150}[part]
    pixels = beside(np.zeros_like(mask) if part == "wall" else mask)
    assert is_another_texture(Image.of(pixels), np.ones(mask.shape, np.bool_), mask) == another


def test_a_plain_margin_is_none_and_a_strip_inside_it_is() -> None:
    pixels = beside(STRIPS["wide"])
    framed = np.pad(pixels, ((12, 12), (12, 12), (0, 0)), constant_values=1.0)
    image = Image.of(framed)
    made, plain = foreign_margins(image).foreign, plain_margins(image)
    assert plain is not None
    assert not (made & plain).any()
    inner = (made | plain)[12:-12, 12:-12]
    assert inner[STRIPS["wide"]].mean() > 0.9
    assert inner[~STRIPS["wide"]].mean() < 0.06
    assert not foreign_margins(
        Image.of(np.pad(wall(), ((12, 12), (12, 12), (0, 0)), constant_values=1.0))
    ).foreign.any()


def test_a_picture_that_continues_across_its_border_has_none() -> None:
    assert not foreign_margins(Image.of(beside(STRIPS["wide"])).wrapping(True)).foreign.any()


def test_small_pictures_are_not_searched() -> None:
    assert not foreign_margins(Image.of(beside(STRIPS["narrow"])[:40, :40])).foreign.any()
