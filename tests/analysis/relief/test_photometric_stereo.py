"""Normals and albedo of rendered surfaces under several lights."""

from __future__ import annotations

import json
import logging
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests.synthetic import smooth_noise
from texloom.stages.analysis.relief.lights import Lights, LightsParams, lights
from texloom.stages.analysis.relief.photometric_stereo import PhotometricStereoParams, photometric_stereo
from texloom.stages.vocabulary.arrays import Image
from texloom.stages.vocabulary.declare import Document, InputError
from texloom.stages.vocabulary.frame_stacks import stack_channels

SIDE, COUNT = 64, 12
SPHERE = (24.0, 40.0, 20.0)


def sources(count: int = COUNT) -> np.ndarray:
    """Unit vectors around the camera, at two elevations."""
    turn = 2 * np.pi * np.arange(count) / count + 0.3
    up = np.deg2rad(np.where(np.arange(count) % 2, 40, 62))
    return np.stack([np.cos(turn) * np.cos(up), np.sin(turn) * np.cos(up), np.sin(up)], axis=1)


def surface(rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """Normals of hills, and an albedo of several tones."""
    height = 30 * smooth_noise((SIDE, SIDE), 7.0, rng)
    down, across = np.gradient(height)
    normals = np.stack([-across, down, np.ones_like(down)], axis=2)
    albedo = 0.15 + 0.6 * smooth_noise((SIDE, SIDE, 3), 3.0, rng)
    return normals / np.linalg.norm(normals, axis=2, keepdims=True), albedo


def photographs(
    normals: np.ndarray, albedo: np.ndarray, towards: np.ndarray, outliers: float, rng: np.random.Generator
) -> Image:
    """Matt, with a share of values in cast shadow or in a highlight, and noise of 1 %."""
    shade = np.maximum(np.einsum("hwi,ni->nhw", normals, towards), 0)
    frames = shade[..., None] * albedo
    wrong, dark = rng.random(shade.shape) < outliers, rng.random(shade.shape) < 0.5
    frames[wrong & dark] = 0.02 * albedo[np.nonzero(wrong & dark)[1:]]
    frames[wrong & ~dark] += 0.6
    frames = np.clip(frames + 0.01 * albedo.mean() * rng.normal(size=frames.shape), 0, 1)
    pixels = np.concatenate(list(frames), axis=2).astype(np.float32)
    return Image(pixels, stack_channels(("R", "G", "B"), len(towards)))


def angle(one: np.ndarray, other: np.ndarray) -> float:
    """Mean, degrees."""
    return float(np.degrees(np.arccos(np.clip((one * other).sum(axis=-1), -1, 1))).mean())


def normals_of(image: Image) -> np.ndarray:
    return image.pixels[..., 3:6].astype(float)


def given(tmp_path: Path, towards: np.ndarray) -> LightsParams:
    path = tmp_path / "lights.json"
    path.write_text(json.dumps({"lights": towards.tolist()}))
    return LightsParams(directions=Document.of(path, {"lights": towards.tolist()}))


@pytest.mark.parametrize("count", [8, 12, 20])
def test_given_lights(count: int, tmp_path: Path, rng: np.random.Generator) -> None:
    """A fifth of all values are wrong."""
    normals, albedo = surface(rng)
    towards = sources(count)
    photos = photographs(normals, albedo, towards, 0.2, rng)
    known = lights(photos, given(tmp_path, 2 * towards))
    assert known.origin == "given"
    np.testing.assert_allclose(known.directions, towards, atol=1e-6)
    made = photometric_stereo(photos, known.directions, PhotometricStereoParams())
    assert angle(normals_of(made.image), normals) < 3
    assert np.median(np.abs(made.image.pixels[..., :3] / albedo - 1)) < 0.03
    assert 0.5 < made.used.mean() < 0.95
    assert made.image.facts.of_map("normal").green == "up"


def test_without_errors_it_is_exact(rng: np.random.Generator) -> None:
    normals, albedo = surface(rng)
    shade = np.maximum(np.einsum("hwi,ni->nhw", normals, sources()), 0)
    pixels = np.concatenate(list(shade[..., None] * albedo), axis=2).astype(np.float32)
    photos = Image(pixels, stack_channels(("R", "G", "B"), COUNT))
    made = photometric_stereo(photos, sources().astype(np.float32), PhotometricStereoParams())
    assert angle(normals_of(made.image), normals) < 0.1
    np.testing.assert_allclose(made.image.pixels[..., :3], albedo, rtol=1e-3)


def test_lights_seen_in_a_sphere(rng: np.random.Generator) -> None:
    normals, albedo = surface(rng)
    photos = photographs(normals, albedo, sources(), 0.2, rng)
    pixels = photos.pixels.copy()
    row, column = np.indices((SIDE, SIDE))
    x, y = (column - SPHERE[1]) / SPHERE[2], (SPHERE[0] - row) / SPHERE[2]
    inside = x * x + y * y < 1
    z = np.sqrt(np.maximum(0, 1 - x * x - y * y))
    for number, towards in enumerate(sources()):
        mirrored = np.stack([2 * z * x, 2 * z * y, 2 * z * z - 1], axis=2) @ towards
        ball = 0.05 + 0.9 / (1 + np.exp(-150 * (mirrored - 0.99)))
        pixels[inside, 3 * number : 3 * number + 3] = ball[inside, None]
    photos = photos.with_pixels(pixels)
    known = lights(photos, LightsParams(sphere=SPHERE))
    assert known.origin == "sphere"
    assert angle(known.directions, sources()) < 1.5
    made = normals_of(photometric_stereo(photos, known.directions, PhotometricStereoParams()).image)
    assert angle(made[~inside], normals[~inside]) < 3


def test_estimated_lights(rng: np.random.Generator, caplog: pytest.LogCaptureFixture) -> None:
    """Up to hills for hollows."""
    normals, albedo = surface(rng)
    photos = photographs(normals, albedo, sources(), 0.2, rng)
    with caplog.at_level(logging.WARNING):
        known = lights(photos, LightsParams())
    assert known.origin == "estimated"
    assert "estimates" in caplog.text
    assert "sources.invert" in caplog.text
    made = normals_of(photometric_stereo(photos, known.directions, PhotometricStereoParams()).image)
    inverted = lights(photos, LightsParams(invert=True)).directions
    np.testing.assert_allclose(inverted, known.directions * [-1, -1, 1], atol=1e-6)
    found = min(angle(made * [sign, sign, 1], normals) for sign in (1, -1))
    print(f"normals with estimated lights: {angle(made, normals):.1f} degrees, {found:.1f} as hills or hollows")
    assert found < 4


def test_what_cannot_be(tmp_path: Path, rng: np.random.Generator) -> None:
    normals, albedo = surface(rng)
    photos = photographs(normals, albedo, sources(4), 0.0, rng)
    with pytest.raises(InputError, match=r"lights\.json: lights: 5 for 4 photographs"):
        lights(photos, given(tmp_path, sources(5)))
    with pytest.raises(InputError, match="6 are needed"):
        lights(photos, LightsParams())
    with pytest.raises(InputError, match="does not lie in the pictures"):
        lights(photos, LightsParams(sphere=(2, 2, 20)))
    flat = np.array([[0, 0, 1], [0.6, 0, 0.8], [-0.6, 0, 0.8], [0.8, 0, 0.6]], np.float32)
    with pytest.raises(InputError, match="near one plane"):
        photometric_stereo(photos, flat, PhotometricStereoParams())


def test_bits_do_not_depend_on_threads(
    rng: np.random.Generator, on_threads: Callable[[Callable[[], Any]], list[Any]]
) -> None:
    photos = photographs(*surface(rng), sources(), 0.2, rng)

    def made() -> np.ndarray:
        known: Lights = lights(photos, LightsParams())
        return photometric_stereo(photos, known.directions, PhotometricStereoParams()).image.pixels

    first, second = on_threads(made)
    np.testing.assert_array_equal(first, second)
