"""Paths across edges, on smooth and rough grounds."""

from __future__ import annotations

import numpy as np
import pytest

from tests.synthesis.tiles.test_transition_tiles import tiles_of
from tests.synthetic import blobs, picture, smooth_noise
from texloom.stages.common.grids.wang import WangSet
from texloom.stages.common.similarity.neighbourhoods import numbers_in
from texloom.stages.evaluation.wang_tiling import WangTilingParams, wang_tiling
from texloom.stages.synthesis.remix.exemplar_sheet import ExemplarSheet, ExemplarSheetParams, exemplar_sheet
from texloom.stages.synthesis.tiles.tile_materials import edges_shown
from texloom.stages.synthesis.tiles.wang_tiles import WangTiles
from texloom.stages.vocabulary.arrays import Image

SIDE, TILE = 192, 32


def exemplar(kind: str) -> Image:
    rng = np.random.default_rng(3)
    if kind == "gravel":
        return picture(
            np.where(blobs((SIDE, SIDE), rng)[..., None] > 0.5, 0.55, 0.08).repeat(3, axis=2).astype("f4")
        )
    noise = smooth_noise((SIDE, SIDE), 1.0, rng)[..., None]
    amount, color = {"sand": (0.06, (0.5, 0.4, 0.28)), "grass": (0.4, (0.12, 0.25, 0.06))}[kind]
    shown = np.array(color) * (1 + amount * (noise - noise.mean()) / noise.std())
    return picture(np.clip(shown, 0.01, 1).astype(np.float32))


def pair(*kinds: str) -> ExemplarSheet:
    return exemplar_sheet(
        [exemplar(kind) for kind in kinds], [{"name": kind} for kind in kinds], ExemplarSheetParams()
    )


def shown(made: ExemplarSheet, tiles: WangTiles) -> np.ndarray:
    numbers = numbers_in(made.rectangles, made.image.height, made.image.width).astype(np.int64) - 1
    return edges_shown(numbers[tiles.match[..., 0], tiles.match[..., 1]], WangSet(2, "edges"), TILE)


@pytest.mark.parametrize("kinds", [("sand", "gravel"), ("gravel", "sand"), ("grass", "gravel")])
def test_every_edge_shows_its_material(kinds: tuple[str, str], caplog: pytest.LogCaptureFixture) -> None:
    made = pair(*kinds)
    tiles = tiles_of(made, kind="edges")
    assert shown(made, tiles).min() > 0.8
    tiling = wang_tiling(tiles.image, tiles.table, WangTilingParams(), tiles.match, made.rectangles)
    assert tiling.table["albedo"]["ratio"] <= 1.1
    assert "edges" not in caplog.text


def test_paths_that_end_are_counted(caplog: pytest.LogCaptureFixture) -> None:
    made = pair("sand", "gravel")
    tiles = tiles_of(made, kind="edges", occurrence=1e4)
    missing = int((shown(made, tiles)[:, 1] < 0.5).sum())
    assert missing == 2
    assert "2 of 2 edges that others than the first material cross do not show them" in caplog.text


def test_an_edge_is_as_its_worst_tile_on_both_sides() -> None:
    tiles, size = WangSet(2, "edges"), 32
    painted = np.zeros((4 * size, 4 * size), np.int64)
    for row, column in np.ndindex(4, 4):
        own, (north, east, south, west) = painted[row * size :, column * size :], tiles.tiles[row, column]
        own[: size // 2, 12:20], own[size // 2 : size, 12:20] = north, south
        own[12:20, : size // 2], own[12:20, size // 2 : size] = west, east
    np.testing.assert_array_equal(edges_shown(painted, tiles, size), np.ones((2, 2)))
    row, column = np.argwhere(tiles.tiles[..., 1] == 1)[0]
    painted[row * size + 12 : row * size + 18, (column + 1) * size - 2 : (column + 1) * size] = 0
    np.testing.assert_array_equal(edges_shown(painted, tiles, size), [[1, 1], [1, 0.25]])
