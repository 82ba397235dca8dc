"""Pictures seen at other places of them."""

from __future__ import annotations

import numpy as np
import pytest

from texloom.stages.common.grids.resampled import scaled_to
from texloom.stages.vocabulary.arrays import Image
from texloom.stages.vocabulary.facts import Wraps
from texloom.stages.vocabulary.normals import NORMAL, unit


def waves(shape: tuple[int, int]) -> np.ndarray:
    """Whole waves along both axes, at the middles of pixels."""
    y, x = ((np.arange(side) + 0.5) / side * 2 * np.pi for side in shape)
    return np.float32(0.5 + 0.2 * np.sin(3 * y[:, None] + 1) + 0.2 * np.cos(2 * x))


@pytest.mark.parametrize("wraps", ["both", "x", "off"])
def test_a_picture_that_continues_across_its_borders_still_does(wraps: str) -> None:
    image = Image(np.repeat(waves((60, 80))[..., None], 3, axis=2), ("R", "G", "B")).wrapping(Wraps.of(wraps))
    made = scaled_to(image, (66, 74))
    assert made.wraps == image.wraps
    wrong = np.abs(made.color[..., 0] - waves((66, 74)))
    assert wrong[3:-3, 3:-3].max() < 2e-4
    assert (wrong.max() < 2e-4) == (wraps == "both")  # else nobody knows what is beyond


def test_normals_lean_with_a_surface_that_is_stretched() -> None:
    """Planes of known slopes."""
    slopes = np.float32([0.3, -0.6])  # down and across
    normal = np.float32([-slopes[1], slopes[0], 1])
    pixels = unit(np.broadcast_to(normal, (20, 30, 3)).copy())
    image = Image(np.dstack([np.full((20, 30, 3), 0.5, np.float32), pixels]), ("R", "G", "B", *NORMAL))
    made = scaled_to(image, (24, 27))
    down, across = slopes / np.float32([24 / 20, 27 / 30])
    expected = unit(np.float32([[[-across, down, 1]]]))[0, 0]
    np.testing.assert_allclose(made.pixels[5, 5, 3:], expected, atol=1e-6)
