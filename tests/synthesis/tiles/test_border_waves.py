"""Borders between materials that wander, alike in all tiles that have them."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from texloom.stages.common.grids.wang import WangSet
from texloom.stages.synthesis.tiles.border_waves import BorderWaves
from texloom.stages.synthesis.tiles.tile_materials import TileMaterials, band_points, material_points

SIZE, BORDER = 48, 5


def table(kind: str, colors: int = 2, **other: Any) -> dict[str, Any]:
    about = {"kind": kind, "colors": colors, "variants": [1, 1], "size": SIZE, "border": BORDER}
    return {**about, "waves": 0.3, "noise": 9, **other}


def waves_of(*args: Any, **options: Any) -> BorderWaves:
    waves = BorderWaves.of(table(*args, **options))
    assert waves is not None
    return waves


@pytest.mark.parametrize("kind", ["corners", "edges"])
@pytest.mark.parametrize("colors", [2, 3])
def test_tiles_agree_on_the_lines_between_them(kind: str, colors: int) -> None:
    waves = waves_of(kind, colors)
    down, across = waves.atlas()
    for number, moved in ((0, across), (1, down.T)):
        borders = waves.tiles.borders[number]
        borders = borders if number == 0 else borders.T
        rows, columns = borders.shape
        lines = moved[::SIZE].reshape(rows, columns, SIZE)
        for border in np.unique(borders):
            same = lines[borders == border]
            np.testing.assert_array_equal(same, same[:1].repeat(len(same), axis=0))
            assert np.ptp(same[0]) > 1
        # Nothing comes from beyond the line, and what tiles share beside it is the same too.
        other = down if number == 0 else across.T
        for beside in range(-BORDER, BORDER):
            assert (np.roll(other, -beside, axis=0)[::SIZE] == 0).all()
            np.testing.assert_array_equal(np.roll(moved, -beside, axis=0)[::SIZE], moved[::SIZE])


@pytest.mark.parametrize("kind", ["corners", "edges"])
def test_bands_have_the_borders_of_the_atlas(kind: str) -> None:
    waves = waves_of(kind)
    materials = TileMaterials(np.zeros((1, 1, 2), np.float32), np.float32(1))
    side = waves.tiles.side * SIZE
    atlas = materials.between(material_points(waves.tiles), side, side, waves.atlas())
    numbers = waves.tiles.band[1]
    points = band_points(waves.tiles)
    for axis in (0, 1):
        band = waves.band(axis, SIZE // 2)
        shape = band.shape[1:]
        assert shape == ((SIZE // 2, SIZE * len(numbers)) if axis == 0 else (SIZE * len(numbers), SIZE // 2))
        shown = materials.between(points if axis == 0 else points.T, *shape, band)
        for number in numbers.tolist():
            row, column = np.argwhere(waves.tiles.borders[axis] == number)[0] * SIZE
            at = int(np.flatnonzero(numbers == number)[0]) * SIZE
            if axis == 0:
                pair = atlas[row, column : column + SIZE], shown[0, at : at + SIZE]
            else:
                pair = atlas[row : row + SIZE, column], shown[at : at + SIZE, 0]
            np.testing.assert_allclose(*pair, atol=0.05)  # half a pixel from the line itself


def test_waves_repeat_with_the_atlas_and_are_limited() -> None:
    moved = waves_of("corners").atlas()
    assert moved.shape == (2, 4 * SIZE, 4 * SIZE)
    assert 0.1 * SIZE < np.abs(moved).max() <= 0.3 * SIZE
    for axis in (1, 2):
        steps = np.abs(moved - np.roll(moved, 1, axis))
        assert steps.max() < 3  # px a pixel, around the torus too
    assert np.abs(waves_of("edges").atlas()).max() <= 0.15 * SIZE
    assert (moved != waves_of("corners", noise=10).atlas()).any()
    assert (waves_of("corners", waves=0).atlas() == 0).all()


def test_other_tiles_have_none() -> None:
    assert BorderWaves.of({"kind": "edges", "colors": 2, "size": 32, "border": 4}) is None
    assert WangSet(2, "corners").side == 4
