"""Seam carving of textures."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from tests.synthetic import picture, smooth_noise
from texloom.stages.synthesis.inverse.seam_carving import SeamCarvingParams, seam_carving
from texloom.stages.vocabulary.declare import InputError


def carved(pixels: np.ndarray, size: tuple[int, int] | None, **inputs: Any) -> Any:
    """A grey picture, whose values are the features."""
    texture = picture(pixels)
    return seam_carving(texture, texture.pixels * 100, SeamCarvingParams(size=size), **inputs)


def test_smooth_pixels_are_removed_first() -> None:
    """A striped square on a plain ground: all of the square stays."""
    pixels = np.full((40, 48), 0.5)
    pixels[12:28, 20:36] = np.indices((16, 16)).sum(axis=0) % 3 / 2
    result = carved(pixels, (22, 22))
    held = set(map(tuple, result.source.reshape(-1, 2).tolist()))
    assert {(row, column) for row in range(12, 28) for column in range(20, 36)} <= held


def test_pixels_stay_in_order_and_are_the_textures(rng: np.random.Generator) -> None:
    pixels = smooth_noise((50, 70), 2.0, rng)
    control = picture(np.broadcast_to(np.linspace(0, 1, 35), (25, 35)).copy())
    result = carved(pixels, (30, 20), control=control)
    assert result.image.pixels.shape == (30, 20, 1)
    row, column = result.source[..., 0].astype(int), result.source[..., 1].astype(int)
    np.testing.assert_array_equal(result.image.pixels[..., 0], pixels.astype(np.float32)[row, column])
    assert result.control is not None
    np.testing.assert_allclose(result.control.pixels[..., 0], (column + 0.5) / 70, atol=0.02)
    assert len(np.unique(row * 70 + column)) == row.size
    np.testing.assert_array_equal(carved(pixels, (30, 20)).source, result.source)


def test_one_column_goes_along_the_cheapest_path() -> None:
    """By hand: a slope with one flat step."""
    pixels = np.tile([0.0, 0.1, 0.2, 0.3, 0.3, 0.3, 0.4, 0.5, 0.6], (6, 1))
    result = carved(pixels, (6, 8))
    np.testing.assert_array_equal(result.source[0, :, 1], [0, 1, 2, 3, 5, 6, 7, 8])


def test_the_size_is_that_of_a_compaction(rng: np.random.Generator) -> None:
    assert carved(smooth_noise((30, 40), 2.0, rng), None, sides=[12, 17]).source.shape == (12, 17, 2)


def test_wrong_sizes_are_refused() -> None:
    texture = picture(np.zeros((30, 40)))
    with pytest.raises(InputError, match="size: 20 x 31 px is larger than the texture of 40 x 30 px"):
        carved(np.zeros((30, 40)), (31, 20))
    with pytest.raises(InputError, match="neither size nor the sides"):
        carved(np.zeros((30, 40)), None)
    with pytest.raises(ValueError, match="do not belong"):
        seam_carving(texture, texture.pixels[:20], SeamCarvingParams(size=(9, 9)))
