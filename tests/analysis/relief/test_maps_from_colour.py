"""Height, normals, occlusion and roughness of surfaces that are known."""

from __future__ import annotations

import logging
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from tests.synthetic import masked, picture, smooth_noise
from texloom.stages.analysis.relief.ao_from_height import AoFromHeightParams, ao_from_height
from texloom.stages.analysis.relief.height_from_colour import HeightFromColourParams, height_from_colour
from texloom.stages.analysis.relief.height_from_normal import height_from_normal
from texloom.stages.analysis.relief.normal_from_height import NormalFromHeightParams, normal_from_height
from texloom.stages.analysis.relief.roughness_from_colour import RoughnessFromColourParams, roughness_from_colour
from texloom.stages.vocabulary.arrays import Image
from texloom.stages.vocabulary.declare import InputError
from texloom.stages.vocabulary.facts import DISPLACEMENT, TORUS

SIDE = 96
AUTO = HeightFromColourParams()


def with_height(height: np.ndarray, wraps: bool = False) -> Image:
    pixels = np.stack([np.full_like(height, 0.5), height], axis=2).astype(np.float32)
    return Image(pixels, ("Y", "height")).wrapping(wraps)


def plane(image: Image, name: str) -> np.ndarray:
    return image.pixels[..., image.channels.index(name)]


def normals(image: Image) -> np.ndarray:
    return np.stack([plane(image, f"normal.{axis}") for axis in "XYZ"], axis=2)


def relief(rng: np.random.Generator, sigma: float = 6.0) -> np.ndarray:
    return smooth_noise((SIDE, SIDE), sigma, rng)


def correlation(one: np.ndarray, other: np.ndarray) -> float:
    return float(np.corrcoef(one.ravel(), other.ravel())[0, 1])


def wall(mortar: float, rng: np.random.Generator) -> tuple[Image, np.ndarray]:
    """Bricks of several tones, and true on the joints, 4 px wide."""
    row, column = np.indices((SIDE, SIDE))
    joints = (row % 24 < 4) | ((column + 16 * (row // 24 % 2)) % 32 < 4)
    bricks = rng.uniform(0.2, 0.5, (4, 4))[row // 24, (column + 16 * (row // 24 % 2)) // 32]
    return picture(np.where(joints, mortar, bricks) * rng.uniform(0.95, 1.05, (SIDE, SIDE))), joints


def test_heights_under_light_from_all_sides_are_found(rng: np.random.Generator) -> None:
    """Better than by luminance, of two sizes of forms, on a material with grain."""
    true = 0.7 * relief(rng, 8.0) + 0.3 * relief(rng, 1.5)
    lit = plane(ao_from_height(with_height(true), AoFromHeightParams(relief=0.3, reach=0.5)).image, "ao")
    lit = lit * rng.uniform(0.3, 0.5, lit.shape)
    made = height_from_colour(picture(lit), HeightFromColourParams(scale=0.5)).image
    found = correlation(plane(made, "height"), true)
    assert found > 0.4
    assert found > correlation(lit, true) + 0.1


def test_relief_is_the_depth_in_shares_of_the_width(rng: np.random.Generator) -> None:
    height = plane(height_from_colour(picture(relief(rng)), HeightFromColourParams(relief=0.02)).image, "height")
    assert np.ptp(height) * DISPLACEMENT == pytest.approx(0.02, rel=1e-4)
    assert (height.min() + height.max()) / 2 == pytest.approx(0.5, abs=1e-6)


def test_dark_may_be_high(rng: np.random.Generator) -> None:
    image = picture(relief(rng))
    deep, high = (
        plane(height_from_colour(image, HeightFromColourParams(dark=side)).image, "height")
        for side in ("deep", "high")
    )
    np.testing.assert_allclose(deep, 1 - high, atol=1e-5)


@pytest.mark.parametrize("mortar", [0.02, 0.9])
def test_joints_are_low_whatever_their_tone(
    mortar: float, rng: np.random.Generator, caplog: pytest.LogCaptureFixture
) -> None:
    image, joints = wall(mortar, rng)
    with caplog.at_level(logging.WARNING):
        made = height_from_colour(image, AUTO, structure=joints)
    assert "height.joints" in caplog.text
    assert "height.dark" in caplog.text
    np.testing.assert_array_equal(made.joints, joints)
    height = plane(made.image, "height")
    assert np.quantile(height[joints], 0.8) < np.quantile(height[~joints], 0.2)
    raised = plane(height_from_colour(image, HeightFromColourParams(joints=-0.9), structure=joints).image, "height")
    assert raised[joints].mean() > raised[~joints].mean()


def test_bricks_of_several_tones_are_level(rng: np.random.Generator) -> None:
    image, joints = wall(0.02, rng)

    def uneven(structure: np.ndarray | None) -> float:
        height = plane(height_from_colour(image, AUTO, structure=structure).image, "height")
        middles = [
            height[24 * i + 10 : 24 * i + 19, 32 * j + 10 - 16 * (i % 2) + 32 * (i % 2) :][:, :9].mean()
            for i in range(4)
            for j in range(2)
        ]
        return float(np.std(middles) / np.ptp(height))

    assert uneven(joints) < 0.5 * uneven(None)


def test_mortar_between_outlines_is_a_joint(rng: np.random.Generator) -> None:
    image, joints = wall(0.9, rng)
    inner = joints.copy()
    for axis in (0, 1):
        inner &= np.roll(joints, 1, axis) & np.roll(joints, -1, axis)
    found = height_from_colour(image, AUTO, structure=joints & ~inner).joints
    assert (found == joints).mean() > 0.98


def test_features_without_a_network_are_no_joints(rng: np.random.Generator) -> None:
    image = picture(relief(rng))
    spots = np.zeros((SIDE, SIDE), bool)
    spots[10:20, 10:20] = spots[60:70, 60:70] = True
    made = height_from_colour(image, AUTO, structure=spots)
    assert not made.joints.any()
    np.testing.assert_array_equal(made.image.pixels, height_from_colour(image, AUTO).image.pixels)


def test_maps_of_a_torus_move_with_it(rng: np.random.Generator) -> None:
    image = picture(np.tile(relief(rng)[:48, :48], (2, 2))).wrapping(True)

    def maps(one: Image) -> np.ndarray:
        with_heights = height_from_colour(one, AUTO).image
        made = roughness_from_colour(with_heights, RoughnessFromColourParams()).image
        return ao_from_height(
            normal_from_height(made, NormalFromHeightParams()).image, AoFromHeightParams()
        ).image.pixels

    moved = image.with_pixels(np.roll(image.pixels, (13, 29), (0, 1)))
    np.testing.assert_allclose(maps(moved), np.roll(maps(image), (13, 29), (0, 1)), atol=2e-4)


@pytest.mark.parametrize(
    ("stage", "params"), [(height_from_colour, AUTO), (roughness_from_colour, RoughnessFromColourParams())]
)
def test_excluded_pixels_have_no_influence(
    stage: Callable[..., Any], params: Any, rng: np.random.Generator
) -> None:
    usable = np.ones((SIDE, SIDE), bool)
    usable[20:50, 30:60] = False
    image = picture(relief(rng))
    dark, bright = (stage(masked(image, usable, value), params).image for value in (0.0, 5.0))
    np.testing.assert_array_equal(dark.pixels[..., -1], bright.pixels[..., -1])


def test_normals_are_slopes_of_the_heights(rng: np.random.Generator) -> None:
    """Green points up, and the slopes have no curl."""
    row, column = np.indices((40, 50))
    rising = with_height(0.002 * row + 0.004 * column)
    x, y, z = np.moveaxis(normals(normal_from_height(rising, NormalFromHeightParams(relief=0.1)).image), 2, 0)
    np.testing.assert_allclose(-x / z, 0.004 * 0.1 * 50, rtol=1e-3)
    np.testing.assert_allclose(y / z, 0.002 * 0.1 * 50, rtol=1e-3)
    made = normal_from_height(with_height(relief(rng), wraps=True), NormalFromHeightParams()).image
    assert made.facts.of_map("normal").green == "up"
    assert made.wraps == TORUS
    x, y, z = np.moveaxis(normals(made).astype(float), 2, 0)

    def slope(values: np.ndarray, axis: int) -> np.ndarray:
        return np.asarray(np.roll(values, -1, axis) - np.roll(values, 1, axis)) / 2

    np.testing.assert_allclose(slope(y / z, 1), slope(-x / z, 0), atol=1e-4)
    height = plane(made, "height").astype(float) * DISPLACEMENT * SIDE
    np.testing.assert_allclose(-x / z, slope(height, 1), atol=1e-4)


@pytest.mark.parametrize("wraps", [False, True])
def test_heights_of_normals_are_those_they_came_from(wraps: bool, rng: np.random.Generator) -> None:
    """But for what central differences do not see."""
    true = 0.5 + 0.4 * (relief(rng) - 0.5)
    if wraps:
        row, column = 2 * np.pi * np.indices((SIDE, SIDE)) / SIDE
        true = 0.5 + 0.2 * np.sin(2 * row) * np.cos(3 * column + row)
    image = normal_from_height(with_height(true, wraps), NormalFromHeightParams()).image
    kept = [place for place, name in enumerate(image.channels) if name != "height"]
    names = tuple(image.channels[place] for place in kept)
    made = plane(height_from_normal(image.with_pixels(image.pixels[..., kept], names)).image, "height")
    np.testing.assert_allclose(made - made.mean(), true - true.mean(), atol=0.01 * np.ptp(true))
    with pytest.raises(InputError, match="no normals"):
        height_from_normal(picture(true))


def test_occlusion_of_a_trench() -> None:
    """In the middle of its bottom half of the sky's light that walls of this slope leave comes from each side."""
    height = np.ones((64, 64))
    height[:, 28:37] = 0
    params = AoFromHeightParams(relief=5 / 64, reach=0.4, directions=128)
    ao = plane(ao_from_height(with_height(height), params).image, "ao")
    np.testing.assert_allclose(ao[:, :20], 1, atol=1e-6)
    across = np.abs(np.cos(2 * np.pi * np.arange(128) / 128))
    known = np.mean(1 / (1 + (across * 5 / 5) ** 2))  # walls 5 px high, 5 px away
    assert ao[32, 32] == pytest.approx(known, abs=0.03)
    assert ao[32, 29] < ao[32, 32] < 1


def test_maps_that_are_there_are_kept(rng: np.random.Generator, caplog: pytest.LogCaptureFixture) -> None:
    image = with_height(relief(rng))
    with caplog.at_level(logging.WARNING):
        made = height_from_colour(image, AUTO).image
    assert made is image
    assert "height" in caplog.text
    with pytest.raises(InputError, match="no map height"):
        normal_from_height(picture(relief(rng)), NormalFromHeightParams())


def test_a_plain_picture_is_level() -> None:
    image = picture(np.full((32, 40), 0.3))
    made = normal_from_height(height_from_colour(image, AUTO).image, NormalFromHeightParams()).image
    np.testing.assert_array_equal(plane(made, "height"), 0.5)
    np.testing.assert_array_equal(normals(made), np.broadcast_to([0, 0, 1], (32, 40, 3)))


def test_roughness_is_more_where_there_is_detail(
    rng: np.random.Generator, caplog: pytest.LogCaptureFixture
) -> None:
    pixels = np.full((SIDE, SIDE), 0.3)
    pixels[:, 48:] += rng.uniform(-0.1, 0.1, (SIDE, 48))
    with caplog.at_level(logging.WARNING):
        rough = plane(roughness_from_colour(picture(pixels), RoughnessFromColourParams()).image, "roughness")
    assert rough[:, :40].mean() < rough[:, 56:].mean() - 0.1
    assert "guess" in caplog.text


def test_bits_do_not_depend_on_threads(
    rng: np.random.Generator, on_threads: Callable[[Callable[[], Any]], list[Any]]
) -> None:
    image, joints = wall(0.1, rng)

    def maps() -> np.ndarray:
        made = height_from_colour(image, AUTO, structure=joints).image
        return ao_from_height(
            roughness_from_colour(made, RoughnessFromColourParams()).image, AoFromHeightParams()
        ).image.pixels

    first, second = on_threads(maps)
    np.testing.assert_array_equal(first, second)
