"""Directions of textures whose direction is known."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from tests.synthetic import picture, smooth_noise
from texloom.stages.analysis.control.orientation_field import (
    OrientationField,
    OrientationFieldParams,
    orientation_field,
)
from texloom.stages.common.geometry.orientation import angle_of, diffused, doubled, smoothed
from texloom.stages.lookup.registry import find_stage
from texloom.stages.vocabulary.arrays import Image
from texloom.stages.vocabulary.declare import InputError

SHAPE = (120, 150)
DEGREES = np.pi / 180


def measured(image: Image, strokes: Image | None = None, **params: object) -> OrientationField:
    return orientation_field(image, OrientationFieldParams(**params), strokes)  # type: ignore[arg-type]


def off(angle: np.ndarray, true: np.ndarray | float, border: int = 6) -> np.ndarray:
    """By how much angles differ, a half turn being none; degrees."""
    turned = np.abs((angle - true + np.pi / 2) % np.pi - np.pi / 2) / DEGREES
    height, width = turned.shape
    return np.asarray(turned[border : height - border, border : width - border])


def waves(angle: np.ndarray | float, length: float) -> Image:
    """Straight waves whose crests run along an angle."""
    rows, columns = np.indices(SHAPE)
    across = rows * np.cos(angle) - columns * np.sin(angle)
    return picture(0.4 + 0.3 * np.sin(2 * np.pi * across / length))


@pytest.mark.parametrize("length", [4.0, 7.0, 14.0])
@pytest.mark.parametrize("degrees", [0, 30, 90, 135])
def test_straight_waves(degrees: float, length: float) -> None:
    field = measured(waves(degrees * DEGREES, length))
    assert np.quantile(off(field.angle, degrees * DEGREES), 0.99) < 3
    assert field.confidence.mean() > 0.6
    assert field.angle.min() >= 0
    assert field.angle.max() <= np.float32(np.pi)


@pytest.mark.parametrize("length", [5.0, 11.0])
def test_rings_turn_all_the_way(length: float, rng: np.random.Generator) -> None:
    rows, columns = np.indices(SHAPE) - np.array([60, 75])[:, None, None]
    radius = np.hypot(rows, columns)
    image = picture(0.4 + 0.3 * np.sin(2 * np.pi * radius / length) + rng.normal(0, 0.05, SHAPE))
    true = np.arctan2(rows, columns) + np.pi / 2
    away = radius[6:-6, 6:-6] > 2 * length
    error = off(measured(image).angle, true)[away]
    assert np.quantile(error, 0.95) < 5
    assert np.median(error) < 2


def test_scratches_of_colour_alone(rng: np.random.Generator) -> None:
    """Red and green of the same lightness; noise smeared along 40 degrees."""
    noise = smooth_noise((2 * SHAPE[1], 2 * SHAPE[1]), 1.0, rng)
    rows, columns = np.indices(SHAPE)
    along = (columns * np.cos(40 * DEGREES) + rows * np.sin(40 * DEGREES)) / 8
    across = rows * np.cos(40 * DEGREES) - columns * np.sin(40 * DEGREES)
    tone = noise[(along + 80).astype(int), (across + 140).astype(int)]
    image = picture(np.stack([0.2 + 0.6 * tone, 0.5 - 0.178 * tone, 0.3 + 0 * tone], axis=2))
    assert np.median(off(measured(image).angle, 40 * DEGREES)) < 5


def test_a_transposed_picture_has_transposed_directions(rng: np.random.Generator) -> None:
    image = waves(25 * DEGREES, 6.0)
    turned = picture(image.pixels[..., 0].T)
    np.testing.assert_allclose(off(measured(turned).angle.T, np.pi / 2 - measured(image).angle), 0, atol=0.5)


def test_plain_places_take_the_directions_around_them() -> None:
    image = waves(70 * DEGREES, 6.0)
    image.pixels[45:75, 50:100] = 0.4
    field = measured(image)
    assert np.median(off(field.angle, 70 * DEGREES, 0)[50:70, 55:95]) < 5
    assert field.confidence[55:65, 65:85].mean() < 0.2 * field.confidence[:30].mean()


def test_a_plain_picture_is_not_sure_of_anything() -> None:
    field = measured(picture(np.full(SHAPE, 0.5)))
    assert field.confidence.max() < 1e-3
    assert np.isfinite(field.angle).all()


@pytest.mark.parametrize("transparent", [True, False])
def test_painted_strokes_overrule(transparent: bool) -> None:
    """A line of 6 px painted down the middle of level waves."""
    import cv2

    paint = np.zeros(SHAPE, np.uint8)
    cv2.line(paint, (60, 20), (95, 100), 255, 6)
    cover = (paint > 0).astype(np.float32)
    planes = np.stack([0 * cover, cover, 0 * cover, cover], axis=2) if transparent else cover[..., None]
    strokes = Image(np.ascontiguousarray(planes), ("R", "G", "B", "A") if transparent else ("Y",))
    true = np.arctan2(80, 35)
    image = waves(0, 6.0)
    field = measured(image, strokes, stroke_radius=15.0)
    inside = paint[6:-6, 6:-6] > 0
    error = off(field.angle, true)
    assert np.median(error[inside]) < 3
    assert np.median(error[50:58, 60:68]) < 10  # beside it
    assert np.median(off(field.angle, 0)[:, :15]) < 3  # and far away


def test_strokes_alone_direct_a_plain_picture() -> None:
    import cv2

    paint = np.zeros(SHAPE, np.uint8)
    cv2.line(paint, (15, 15), (15, 105), 255, 5)
    cv2.line(paint, (110, 60), (145, 60), 255, 5)
    field = measured(picture(np.full(SHAPE, 0.5)), picture(paint / 255))
    assert np.median(off(field.angle, np.pi / 2)[:, :20]) < 5
    assert np.median(off(field.angle, 0.0)[40:60, -20:]) < 10


def test_diffusion_is_laplaces_equation() -> None:
    """Between two fixed columns doubled vectors change evenly."""
    vectors = np.zeros((12, 21, 2), np.float32)
    vectors[:, 0], vectors[:, 20] = [1, 0], [0, 1]
    between = diffused(vectors, 1e-6)
    share = np.linspace(0, 1, 21)
    expected = np.broadcast_to(np.stack([1 - share, share], axis=1), (12, 21, 2))
    np.testing.assert_allclose(between, expected, atol=1e-3)


def test_doubled_angles_and_back(rng: np.random.Generator) -> None:
    angle = (np.pi * rng.random((9, 9))).astype(np.float32)
    np.testing.assert_allclose(angle_of(doubled(angle, np.ones_like(angle))), angle, atol=1e-5)


def test_threads_do_not_matter(on_threads: Any) -> None:
    one, three = on_threads(lambda: measured(waves(0.3, 9.0)))
    np.testing.assert_array_equal(one.angle, three.angle)
    np.testing.assert_array_equal(one.picture.pixels, three.picture.pixels)


def test_wrong_strokes_are_said() -> None:
    check = find_stage("analysis.orientation_field").check
    assert check is not None
    image = picture(np.zeros(SHAPE))
    with pytest.raises(InputError, match="strokes: 15 x 12 px; must have the size of the texture, 150 x 120 px"):
        check(OrientationFieldParams(), {"image": image, "strokes": picture(np.zeros((12, 15)))})
    with pytest.raises(InputError, match="nothing is painted"):
        measured(image, picture(np.zeros(SHAPE)))


@pytest.mark.parametrize("sigma", [0.5, 1.5])
def test_smoothing_is_a_mean_over_pixels_that_are_near_and_alike(sigma: float, rng: np.random.Generator) -> None:
    vectors = rng.normal(size=(9, 11, 2)).astype(np.float32)
    guide = rng.uniform(0, 9, (9, 11, 3)).astype(np.float32)
    rows, columns = np.indices((9, 11))
    radius = int(np.ceil(2 * sigma))
    for y, x in ((4, 5), (5, 3)):  # what is beyond the border is mirrored
        squared = (rows - y) ** 2 + (columns - x) ** 2
        differences = np.abs(guide - guide[y, x]).sum(axis=2)
        weight = np.exp(-squared / (2 * sigma**2) - differences**2 / (2 * 6.0**2)) * (squared <= radius**2)
        expected = (weight[..., None] * vectors).sum(axis=(0, 1)) / weight.sum()
        np.testing.assert_allclose(smoothed(vectors, guide, sigma, 6.0)[y, x], expected, atol=1e-4)
