"""Light of which the truth is known is removed, and dark materials stay."""

from __future__ import annotations

import numpy as np
import pytest

from tests.synthetic import masked, picture, smooth_noise
from texloom.stages.analysis.light.delight import DelightParams, delight
from texloom.stages.vocabulary.arrays import Image

SHAPE = (144, 160)
AMBIENT = np.array([0.3, 0.36, 0.45])
AUTO = DelightParams()


def plaster(rng: np.random.Generator) -> np.ndarray:
    """A texture of fine grain, linear light."""
    grain = np.exp(0.5 * (smooth_noise(SHAPE, 1.0, rng) - 0.5) * 4)
    return np.asarray(0.25 * grain[..., None] * np.array([1.0, 0.85, 0.7]))


def tiles(rng: np.random.Generator, side: int = 16) -> np.ndarray:
    """A floor of tiles, each of its own tint, with dark joints."""
    row, column = np.indices(SHAPE)
    tint = np.exp(rng.normal(0, 0.05, (SHAPE[0] // side, SHAPE[1] // side)))[row // side, column // side]
    joint = (row % side < 2) | (column % side < 2)
    tone = np.where(joint, 0.1, 0.35 * tint * np.exp(rng.normal(0, 0.03, SHAPE)))
    return np.asarray(tone[..., None] * np.array([1, 0.9, 0.8]))


def edge_of_shadow() -> np.ndarray:
    """Share of direct light behind a straight edge, with a penumbra 10 px wide."""
    row, column = np.indices(SHAPE)
    return np.asarray(np.clip((column + 0.4 * row - 110) / 10 + 0.5, 0, 1))


def dapple() -> np.ndarray:
    """Share of direct light in round spots."""
    row, column = np.indices(SHAPE)
    spots = [
        np.hypot(row - y, column - x) - r for y, x, r in ((40, 40, 26), (95, 60, 22), (50, 115, 30), (115, 125, 20))
    ]
    return np.asarray(np.clip(0.5 - np.min(spots, axis=0) / 6, 0, 1))


def in_shadow(albedo: np.ndarray, share: np.ndarray) -> Image:
    return picture(albedo * (AMBIENT + share[..., None] * (1 - AMBIENT)))


def error(image: Image, albedo: np.ndarray) -> float:
    """Deviation of the light that remains, logarithm."""
    ratio = np.log((image.color + 1e-3) / (albedo + 1e-3)).mean(axis=2)
    return float(np.abs(ratio - np.median(ratio)).mean())


def bars() -> np.ndarray:
    """Share of direct light through bars: nowhere is far from a border."""
    row, column = np.indices(SHAPE)
    return np.asarray(np.clip(0.5 + (np.abs((column + 0.2 * row) % 16 - 8) - 4) / 1.5, 0, 1))


@pytest.mark.parametrize("share", [edge_of_shadow(), dapple()], ids=["edge", "dapple"])
def test_a_cast_shadow_is_removed_with_its_penumbra(share: np.ndarray, rng: np.random.Generator) -> None:
    albedo = plaster(rng)
    lit = in_shadow(albedo, share)
    made = delight(lit, AUTO)
    (found,) = made.table["found"]
    assert found["kind"] == "shadow"
    assert found["confidence"] > 0.7
    assert found["share"] == pytest.approx((share < 0.35).mean(), abs=0.06)
    assert error(made.image, albedo) < 0.15 * error(lit, albedo)
    np.testing.assert_allclose(made.light.pixels[share == 0].mean(axis=0), AMBIENT, atol=0.03)


def test_the_shadow_of_narrow_bars_is_removed(rng: np.random.Generator) -> None:
    albedo = plaster(rng)
    lit = in_shadow(albedo, bars())
    assert error(delight(lit, AUTO).image, albedo) < 0.4 * error(lit, albedo)


def test_a_shadow_across_tiles_is_removed(rng: np.random.Generator) -> None:
    albedo = tiles(rng)
    lit = in_shadow(albedo, edge_of_shadow())
    frame = np.array([[16, 0], [0, 16]], np.float32)
    assert error(delight(lit, AUTO, frame).image, albedo) < 0.3 * error(lit, albedo)


def patches(rng: np.random.Generator) -> np.ndarray:
    """Bright stones on dark, smooth soil."""
    stone = smooth_noise(SHAPE, 7, rng)[..., None] > 0.5
    return np.where(stone, plaster(rng), 0.08 + 0.01 * smooth_noise(SHAPE, 2, rng)[..., None])


@pytest.mark.parametrize("texture", [plaster, tiles, patches])
def test_a_picture_without_shadow_is_kept_bit_for_bit(texture: object, rng: np.random.Generator) -> None:
    assert callable(texture)
    image = picture(texture(rng)).wrapping(True)
    made = delight(image, AUTO)
    np.testing.assert_array_equal(made.image.pixels, image.pixels)
    assert made.image.wraps.both
    assert (made.light.pixels == 1).all()


def test_strength_is_the_share_of_logarithms(rng: np.random.Generator) -> None:
    lit = in_shadow(plaster(rng), edge_of_shadow())
    none, half, whole = (delight(lit, DelightParams(strength=strength)) for strength in (0, 0.5, 1))
    np.testing.assert_array_equal(none.image.pixels, lit.pixels)
    assert none.table == {"found": []}
    assert np.quantile(np.abs(half.light.pixels**2 - whole.light.pixels), 0.99) < 1e-3


def test_what_is_unsure_is_said_and_kept(rng: np.random.Generator, caplog: pytest.LogCaptureFixture) -> None:
    made = delight(in_shadow(plaster(rng), edge_of_shadow()), DelightParams(strength=0.5))
    assert "a cast shadow (" in caplog.text
    assert "was removed to 50%" in caplog.text
    assert made.table["found"][0]["removed"] == 0.5


def test_a_clipped_highlight_is_excluded_and_white_paint_is_not(rng: np.random.Generator) -> None:
    albedo = plaster(rng)
    row, column = np.indices(SHAPE)
    apart = np.hypot(row - 60, column - 70)
    glare = picture(np.minimum(albedo + 2 * np.exp(-((apart / 14) ** 2))[..., None], 1))
    made = delight(glare, AUTO)
    assert made.image.channels[-1] == "usable"
    usable = made.image.pixels[..., -1]
    assert (usable[(glare.pixels >= 1).all(axis=2)] == 0).all()
    assert usable[apart > 60].all()
    assert made.table["found"][0]["share"] == pytest.approx(1 - usable.mean())
    painted = picture(np.where(apart[..., None] < 16, 1.0, albedo))
    np.testing.assert_array_equal(delight(painted, AUTO).image.pixels, painted.pixels)


def test_soft_light_is_told_from_tints_of_tiles(rng: np.random.Generator) -> None:
    albedo = tiles(rng)
    row, column = np.indices(SHAPE)
    glow = 1 + 0.8 * np.exp(-(((row - 50) / 40) ** 2) - ((column - 60) / 50) ** 2)
    lit = picture(albedo * glow[..., None])
    made = delight(lit, AUTO, np.array([[16, 0], [0, 16]], np.float32))
    assert [found["kind"] for found in made.table["found"]] == ["soft light"]
    assert error(made.image, albedo) < 0.4 * error(lit, albedo)


def test_excluded_pixels_have_no_influence(rng: np.random.Generator) -> None:
    lit = in_shadow(plaster(rng), edge_of_shadow())
    usable = np.ones(SHAPE, bool)
    usable[20:60, 30:90] = False
    one, two = (delight(masked(lit, usable, value), AUTO).image for value in (0.1, 0.9))
    np.testing.assert_array_equal(one.pixels[usable], two.pixels[usable])
    assert error(picture(one.color), lit.color) > 0.1


def test_other_maps_stay(rng: np.random.Generator) -> None:
    lit = in_shadow(plaster(rng), edge_of_shadow())
    maps = Image(np.dstack([lit.pixels, lit.pixels[..., :1]]), ("R", "G", "B", "height"), lit.facts)
    made = delight(maps, AUTO).image
    np.testing.assert_array_equal(made.pixels[..., 3], lit.pixels[..., 0])
    assert (made.pixels[..., 0] > lit.pixels[..., 0]).any()
