"""Arrangements of Wang tiles."""

from __future__ import annotations

from typing import get_args

import numpy as np
import pytest

from texloom.stages.common.grids.wang import Kind, WangSet, hashed
from texloom.stages.vocabulary.declare import InputError

SETS = [WangSet(colors, kind) for kind in get_args(Kind) for colors in (2, 3)]
SETS += [WangSet(1, "edges", (2, 3)), WangSet(2, "corners", (1, 2))]


@pytest.fixture(params=SETS, ids=[f"{one.colors} {one.kind} {one.variants}" for one in SETS])
def tiles(request: pytest.FixtureRequest) -> WangSet:
    chosen: WangSet = request.param
    return chosen


def test_the_atlas_has_every_tile_equally_often(tiles: WangSet) -> None:
    colors = tiles.tiles if tiles.kind == "edges" else tiles.tile_corners
    assert colors.shape[:2] == tiles.shape
    assert colors.max() == tiles.colors - 1
    listed = np.repeat(np.arange(tiles.colors**4), np.prod(tiles.variants))
    np.testing.assert_array_equal(tiles.number(colors[tuple(tiles.places.T)]), listed)
    assert len(np.unique(tiles.places, axis=0)) == len(listed)


def test_tiles_that_meet_fit(tiles: WangSet) -> None:
    """In the atlas, a torus, and wherever the plane is covered."""
    cells = np.indices((40, 40)) - 17
    covered = tiles.covering(cells[0], cells[1], 5)
    for laid in (
        np.pad(tiles.tiles, ((0, 1), (0, 1), (0, 0)), mode="wrap"),
        tiles.tiles[tuple(covered.T)].swapaxes(0, 1),
    ):
        north, east, south, west = np.moveaxis(laid, 2, 0)
        np.testing.assert_array_equal(east[:, :-1], west[:, 1:])
        np.testing.assert_array_equal(south[:-1], north[1:])


def test_a_band_has_every_border_once_between_its_corners(tiles: WangSet) -> None:
    corners, borders = tiles.band
    assert sorted(borders) == sorted(np.unique(tiles.borders))
    ends = {
        (int(border), int(first), int(second))
        for border, first, second in zip(
            tiles.borders[0].flat, tiles.corners.flat, np.roll(tiles.corners, -1, 1).flat, strict=True
        )
    }
    assert set(zip(borders.tolist(), corners.tolist(), np.roll(corners, -1).tolist(), strict=True)) == ends


def test_all_tiles_are_used_equally_often(tiles: WangSet) -> None:
    cells = np.indices((300, 300))
    covered = tiles.covering(cells[0], cells[1], 0)
    counts = np.bincount(covered[..., 0].ravel() * tiles.shape[1] + covered[..., 1].ravel())
    assert len(counts) == np.prod(tiles.shape)
    assert counts.min() > 0.8 * counts.mean()
    assert (covered != tiles.covering(cells[0], cells[1], 1)).any()


def test_the_hash_is_that_of_the_shader() -> None:
    """By plain integers."""
    bits = (-3 * 0x8DA6B343 + 70000 * 0xD8163841 + 1 * 0xCB1AB31F) % 2**32
    bits = (bits ^ bits >> 16) * 0x7FEB352D % 2**32
    bits = (bits ^ bits >> 15) * 0x846CA68B % 2**32
    assert hashed(np.array([-3]), np.array([70000]), 1)[0] == bits ^ bits >> 16


def test_other_sets_are_refused() -> None:
    with pytest.raises(InputError, match="1 to 3 colours, not 4 edges"):
        WangSet(4, "edges")
