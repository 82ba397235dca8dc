"""Whether the opposite borders of a picture fit."""

import logging

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter

from tests.synthetic import picture
from texloom.stages.common.grids.border_steps import border_steps, fitting_borders
from texloom.stages.vocabulary.arrays import Image


@pytest.fixture
def tile() -> Image:
    """Noise on a torus."""
    noise = gaussian_filter(np.random.default_rng(5).normal(size=(64, 64)), 2, mode="wrap")
    return picture(0.5 + noise)


def test_steps_across_the_borders_of_a_tile_are_like_those_inside(tile: Image) -> None:
    assert max(border_steps(tile)) < 1.5
    part = tile.cropped(slice(0, 45), slice(None))
    down, across = border_steps(part)
    assert down > 3
    assert across < 1.5
    assert border_steps(picture(np.full((8, 8), 0.5))) == (np.inf, np.inf)


def test_what_is_marked_does_not_count(tile: Image) -> None:
    hole = np.zeros((64, 64), bool)
    hole[:8, 20:40] = True
    damaged = picture(np.where(hole, 1.0, tile.pixels[..., 0]))
    assert max(border_steps(damaged, hole)) < 1.5 < max(border_steps(damaged))


def test_a_tile_stays_one_where_a_border_that_fits_is_touched(
    tile: Image, caplog: pytest.LogCaptureFixture
) -> None:
    log, hole = logging.getLogger("texloom.stages.borders"), np.zeros((64, 64), bool)
    hole[20:30, 20:30] = True
    assert not fitting_borders(log, tile, hole)
    hole[:5, 20:30] = True
    part = tile.cropped(slice(0, 45), slice(None))
    assert not fitting_borders(log, part, hole[:45])  # touches only borders that do not fit
    assert not caplog.records
    assert fitting_borders(log, tile, hole).both
    assert "--tileable=off does not" in caplog.text
    assert str(fitting_borders(log, part, hole.T[:45])) == "x"
    caplog.clear()
    fitting_borders(log, part, hole[:45] | hole[:45][::-1])
    assert "goes on beyond opposite borders (y), but the picture is not taken as a tile there" in caplog.text
    assert caplog.text.rstrip().endswith("--tileable=both keeps it one")
