"""Lines that fan out are told; others are not."""

import logging

import numpy as np
import pytest
import skimage.data
import skimage.transform

from texloom.stages.analysis.regularity.fanning_lines import fan_of_lines
from texloom.stages.analysis.regularity.lattice_selection import LatticeSelectionParams, lattice_selection
from texloom.stages.vocabulary.arrays import Image


def wall(rng: np.random.Generator) -> np.ndarray:
    """Upright planks of several tones, with ends here and there."""
    pixels = np.repeat(rng.uniform(0.3, 0.7, (1, 24)), 14, axis=1).repeat(300, axis=0)
    pixels[:, ::14] = 0.1
    for plank in range(24):
        pixels[rng.integers(10, 290, 4), 14 * plank : 14 * plank + 14] = 0.1
    return pixels + 0.02 * rng.random(pixels.shape)


def seen(pixels: np.ndarray, narrower: float) -> Image:
    """The wall, whose upper end is ``narrower`` on each side."""
    height, width = pixels.shape
    inset = narrower * width
    corners = np.array([[inset, 0], [width - inset, 0], [width, height], [0, height]], float)
    flat = np.array([[0, 0], [width, 0], [width, height], [0, height]], float)
    warp = skimage.transform.ProjectiveTransform.from_estimate(corners, flat)
    made = skimage.transform.warp(pixels, warp, output_shape=(height, width), mode="edge")
    left = int(np.ceil(inset))
    return Image.of(np.ascontiguousarray(made[:, left : width - left], np.float32))


def test_the_fan_of_a_wall_in_perspective_is_measured(rng: np.random.Generator) -> None:
    found = fan_of_lines(seen(wall(rng), 0.12))
    outermost = 2 * np.degrees(np.arctan(0.12 * 336 / 300))  # of the whole wall, whose upper corners are cropped
    assert 0.6 * outermost < found < outermost


@pytest.mark.parametrize("name", ["grass", "gravel", "checkerboard"])
def test_what_is_seen_from_the_front_has_no_fan(name: str) -> None:
    assert fan_of_lines(Image.of(getattr(skimage.data, name)())) == 0


def test_a_photograph_of_bricks_has_one() -> None:
    assert fan_of_lines(Image.of(skimage.data.brick())) == pytest.approx(20, abs=1)


def test_excluded_lines_do_not_count(rng: np.random.Generator) -> None:
    image = seen(wall(rng), 0.12)
    shown = np.zeros((image.height, image.width), np.float32)
    shown[:, :40] = 1
    masked = image.with_pixels(np.dstack([image.pixels, shown]), (*image.channels, "A"))
    assert fan_of_lines(image) > 0
    assert fan_of_lines(masked) == 0


def test_a_lattice_selection_warns(rng: np.random.Generator, caplog: pytest.LogCaptureFixture) -> None:
    pixels, found = wall(rng), []
    for narrower in (0.0, 0.12):
        image = seen(pixels, narrower)
        caplog.clear()
        with caplog.at_level(logging.WARNING):
            density = np.zeros((image.height, image.width), np.float32)
            found.append(lattice_selection(image, density, LatticeSelectionParams()).fan)
        assert ("fan out by" in caplog.text) == (narrower > 0)
    assert found[0] == 0 < found[1]
