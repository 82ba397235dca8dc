"""Texture in photographs: holes that are filled, detail that does not alias."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from tests.photographs import analysed, made, surfaces
from tests.synthetic import picture
from texloom.stages.analysis.gaussian_stack import GaussianStackParams, gaussian_stack
from texloom.stages.analysis.hole_window import HoleWindowParams, hole_window
from texloom.stages.analysis.jacobian_field import JacobianFieldParams, jacobian_field
from texloom.stages.arrays import Image
from texloom.stages.declare import InputError
from texloom.stages.synthesis.place_texture import place_texture

SHAPE = (96, 120)
CORNERS = [[-30, 20], [-30, 100], [120, 150], [120, -30]]
HOLE = [[[40, 50], [40, 70], [60, 70], [60, 50]]]
REGION = [[[4, 3], [4, 118], [94, 118], [94, 3]]]


def stretched(by: np.ndarray | float, shape: tuple[int, int] = SHAPE) -> np.ndarray:
    """Jacobians of a texture that is as much larger."""
    return np.asarray(np.broadcast_to(by, shape)[..., None] * np.array([1, 0, 0, 1]), np.float32)


def test_a_hole_is_filled_and_all_else_stays(tmp_path: Path) -> None:
    """Stripes that run away from the viewer go on through the hole."""
    columns = np.arange(SHAPE[1]) - 60
    across = columns / (40 + 40 * (np.arange(SHAPE[0])[:, None] + 30) / 150)
    whole = picture(0.5 + 0.4 * np.sin(2 * np.pi * 5 * across))
    surface = surfaces(
        whole, tmp_path, detail=0.5, patches=[{"corners": CORNERS, "size": [1, 1]}], region=REGION, hole=HOLE
    )
    holed = Image(np.where(surface.hole[..., None], np.float32(0.5), whole.pixels), whole.channels)
    levels, look = analysed(holed, surface)
    known = hole_window(surface.hole, surface.jacobian, HoleWindowParams(margin=16), surface.region, levels.corner)
    assert known.hole.shape == (53, 53)
    inputs = {
        "target_jacobian": known.jacobian, "fixed": known.fixed, "fixed_match": known.fixed_match,
    }  # fmt: skip
    match = made(levels, look, inputs=inputs).match
    own = np.stack(np.indices(known.hole.shape), axis=2) + known.corner - levels.corner
    np.testing.assert_array_equal(match[known.fixed], own[known.fixed])
    # nothing is taken from the hole
    rows, columns = np.moveaxis(match[known.hole] + levels.corner, 1, 0)
    assert not surface.hole[rows, columns].any()
    filled = place_texture(match, levels.colors, known.jacobian, holed, known.hole, known.corner).image
    np.testing.assert_array_equal(filled.pixels[~surface.hole], holed.color[~surface.hole])
    error = np.abs(filled.pixels - whole.color)[surface.hole].mean()
    grey = np.abs(holed.color - whole.color)[surface.hole].mean()
    assert error < 0.5 * grey


def test_what_is_small_is_a_mean() -> None:
    """A checkerboard that shrinks to nothing becomes even, and is itself where it is not smaller."""
    cells = picture((np.indices(SHAPE).sum(axis=0) % 2) * 1.0)
    surface = jacobian_field(cells, JacobianFieldParams())
    levels = gaussian_stack(
        cells, surface.jacobian, surface.level, surface.region, GaussianStackParams(max_levels=4, min_whole=0.01)
    )
    ramp = np.linspace(1, 0.1, SHAPE[1])
    own = np.stack(np.indices(SHAPE), axis=2).astype(np.uint32)
    everywhere = np.ones(SHAPE, bool)
    pixels = place_texture(own, levels.colors, stretched(ramp), cells, everywhere).image.pixels
    inner = pixels[20:-20]
    np.testing.assert_array_equal(inner[:, 0], cells.color[20:-20, 0])
    contrast = inner.std(axis=(0, 2))
    assert (np.diff(contrast[:60]) < 1e-3).all()
    assert contrast[70:110].max() < 0.05  # four cells a pixel or more
    np.testing.assert_allclose(inner[:, 70:110].mean(), 0.5, atol=0.02)


def test_between_levels() -> None:
    colors = np.stack([np.full((*SHAPE, 3), value, np.float32) for value in (0.0, 1.0, 4.0)])
    photo, match = picture(np.zeros(SHAPE)), np.zeros((*SHAPE, 2), np.uint32)
    hole = np.zeros(SHAPE, bool)
    hole[10, 10] = True
    for level, expected in ((-1, 0), (0, 0), (0.5, 0.5), (1, 1), (1.5, 2.5), (7, 4)):
        result = place_texture(match, colors, stretched(2.0**-level), photo, hole)
        assert result.image.pixels[10, 10] == pytest.approx(expected, abs=1e-5)
        assert result.image.pixels.sum() == pytest.approx(3 * expected, abs=1e-4)
        assert result.texture.pixels.min() == pytest.approx(expected, abs=1e-5)


def test_nothing_to_fill() -> None:
    nothing = np.zeros(SHAPE, bool)
    with pytest.raises(InputError, match=r"^hole: empty; give its polygons in the geometry file"):
        hole_window(nothing, stretched(1.0), HoleWindowParams())
    colors = np.zeros((1, *SHAPE, 3), np.float32)
    match = np.zeros((*SHAPE, 2), np.uint32)
    with pytest.raises(InputError, match=r"^hole: no pixel is marked"):
        place_texture(match, colors, stretched(1.0), picture(np.zeros(SHAPE)), nothing)
