"""Tiles whose edges have materials, and what engines read of them."""

from __future__ import annotations

import re
import xml.etree.ElementTree as ElementTree
from typing import Any

import numpy as np
import pytest
import yaml

from tests.synthesis.tiles.test_transition_tiles import TILE, exemplars, tiles_of
from tests.synthetic import picture
from texloom.stages.common.grids.wang import SIDES, WangSet
from texloom.stages.evaluation.wang_tiling import WangTilingParams, wang_tiling
from texloom.stages.synthesis.remix.exemplar_sheet import ExemplarSheet
from texloom.stages.synthesis.tiles.edge_sheets import EdgeSheets, EdgeSheetsParams, edge_sheets
from texloom.stages.synthesis.tiles.tile_materials import band_points, material_points
from texloom.stages.synthesis.tiles.tile_sheets import TileSheetsParams, tile_sheets
from texloom.stages.synthesis.tiles.wang_tiles import WangTiles
from texloom.stages.vocabulary.arrays import Image
from texloom.stages.vocabulary.declare import InputError

AROUND = [(0, 1), (1, 1), (1, 0), (1, -1), (0, -1), (-1, -1), (-1, 0), (-1, 1)]
ANY, THIS, OTHER = 0, 1, 2


@pytest.fixture(scope="module")
def result() -> tuple[ExemplarSheet, WangTiles]:
    made = exemplars(2)
    return made, tiles_of(made, kind="edges")


def atlas(kind: str, colors: int, variants: list[int]) -> tuple[Image, dict[str, Any]]:
    """An atlas of tiles of 24 px that show their row and column in it."""
    layout = {"size": 24, "kind": kind, "colors": colors, "variants": variants}
    places = np.indices(WangSet.of(layout).shape).transpose(1, 2, 0).repeat(24, axis=0).repeat(24, axis=1)
    return picture(np.concatenate([places, places[..., :1]], axis=2).astype(np.float32)), layout


def sheet_of(colors: int, variants: list[int] | None = None) -> EdgeSheets:
    return edge_sheets(*atlas("edges", colors, variants or [1, 1]), ["a", "b", "c"][:colors], EdgeSheetsParams())


def unity(text: str) -> list[Any]:
    """The objects of a YAML file of Unity, whose tags are numbers of classes; scalars are texts."""

    class Loader(yaml.BaseLoader):
        pass

    Loader.add_multi_constructor(
        "tag:unity3d.com,2011:", lambda load, _, node: load.construct_mapping(node, deep=True)
    )
    assert text.startswith(("%YAML 1.1", "fileFormatVersion: 2"))
    # Unity repeats no %TAG before further objects.
    head = "".join(re.findall(r"^%.*\n", text, flags=re.M))
    parts = re.split(r"^(?=---)", re.sub(r"^%.*\n", "", text, flags=re.M), flags=re.M)
    return [yaml.load(head + part, Loader) for part in parts if part.strip()]


def test_materials_cross_the_edges(result: tuple[ExemplarSheet, WangTiles]) -> None:
    made, tiles = result
    second = made.rectangles[1, :2]
    shown = (tiles.match >= second).all(axis=2)  # exemplars lie side by side
    third, middle = TILE // 3, np.s_[TILE // 2 - 3 : TILE // 2 + 3]
    shares, corners = [], []
    for tile in tiles.table["tiles"]:
        own = shown[tile["y"] : tile["y"] + TILE, tile["x"] : tile["x"] + TILE]
        at = {
            "north": own[:4, middle],
            "east": own[middle, -4:],
            "south": own[-4:, middle],
            "west": own[middle, :4],
        }
        shares += [(at[side] == tile[side]).mean() for side in SIDES]
        corners.append(own[: third // 2, : third // 2].mean())
    assert len(shares) == 4 * 16
    assert np.mean(shares) > 0.9
    assert np.mean(corners) < 0.1


def test_borders_do_not_show(result: tuple[ExemplarSheet, WangTiles]) -> None:
    made, tiles = result
    tiling = wang_tiling(tiles.image, tiles.table, WangTilingParams(), tiles.match, made.rectangles)
    assert tiling.table["albedo"]["ratio"] < 1.1


def test_middles_continue_most_edges() -> None:
    tiles = WangSet(3, "edges")
    points = material_points(tiles)
    assert not points[::2, ::2].any()
    for (row, column), middle in np.ndenumerate(points[1::2, 1::2]):
        own = tiles.tiles[row, column].tolist()
        around = [points[2 * row, 2 * column + 1], points[2 * row + 1, (2 * column + 2) % 18],
                  points[(2 * row + 2) % 18, 2 * column + 1], points[2 * row + 1, 2 * column]]  # fmt: skip
        assert around == own
        others = [color for color in own if color]
        assert middle == (max(others, key=lambda color: (others.count(color), color)) if others else 0)
    np.testing.assert_array_equal(band_points(tiles), [[0, 0, 0, 1, 0, 2]] * 2)


@pytest.mark.parametrize(("colors", "variants"), [(2, [2, 1]), (3, [1, 1])])
def test_each_tile_has_its_edges(colors: int, variants: list[int]) -> None:
    made, tiles = sheet_of(colors, variants), WangSet(colors, "edges", (variants[0], variants[1]))
    listed = made.table["edges"]["tiles"]
    assert len(listed) == colors**4 * np.prod(variants)
    for tile in listed:
        row, column = divmod(tile["number"], made.table["edges"]["columns"])
        at = tuple(made.edges.pixels[row * 24, column * 24, :2].astype(int))
        assert tiles.tiles[at].tolist() == [tile[name] for name in SIDES]


@pytest.mark.parametrize("colors", [2, 3])
def test_tiled_and_godot_match_sides(colors: int) -> None:
    made = sheet_of(colors)
    terrain = ElementTree.fromstring(made.tiled).find("wangsets/wangset")
    assert terrain is not None
    assert terrain.get("type") == "edge"
    ids = [str(tile.get("wangid")).split(",") for tile in terrain.findall("wangtile")]
    assert len({tuple(one) for one in ids}) == colors**4
    assert {one[corner] for one in ids for corner in (1, 3, 5, 7)} == {"0"}
    assert "terrain_set_0/mode = 2" in made.godot
    assert len(re.findall(r"peering_bit/(\w+)_side = ", made.godot)) == 4 * colors**4
    assert "_corner = " not in made.godot


def fitting(rules: list[Any], grid: np.ndarray, row: int, column: int, material: int) -> list[int]:
    """Numbers of the sprites of the first rule that fits a cell, as Unity chooses it; y points up there."""
    for rule in rules:
        packed = rule["m_Neighbors"]
        asked = [int.from_bytes(bytes.fromhex(packed[at : at + 8]), "little") for at in range(0, len(packed), 8)]
        places = [(int(one["x"]), int(one["y"])) for one in rule["m_NeighborPositions"]]
        assert places == AROUND
        found = [grid[row - y, column + x] == material for x, y in places]
        if all(ask == ANY or (ask == THIS) == same for ask, same in zip(asked, found, strict=True)):
            return [sprite["fileID"] for sprite in rule["m_Sprites"]]
    return []


@pytest.mark.parametrize("colors", [2, 3])
@pytest.mark.parametrize("kind", ["edges", "blob"])
def test_unity_chooses_tiles_by_neighbours(kind: str, colors: int) -> None:
    names = ["a", "b", "c"][:colors]
    if kind == "edges":
        made = sheet_of(colors, [2, 1])
        meta, asset, listed, sheet = made.slices, made.rules, made.table["edges"], made.edges
    else:
        sheets = tile_sheets(*atlas("corners", colors, [1, 1]), names, TileSheetsParams())
        meta, asset, listed, sheet = sheets.blob_slices, sheets.blob_rules, sheets.table["blob"], sheets.blob
    importer = unity(meta)[0]["TextureImporter"]
    sprites = importer["spriteSheet"]["sprites"]
    side, columns = listed["size"], listed["columns"]
    assert importer["spriteSheet"]["nameFileIdTable"] == {one["name"]: one["internalID"] for one in sprites}
    assert {entry["second"]: entry["first"]["213"] for entry in importer["internalIDToNameTable"]} == importer[
        "spriteSheet"
    ]["nameFileIdTable"]
    assert len({one["internalID"] for one in sprites}) == len(sprites) == len(listed["tiles"])
    assert int(importer["maxTextureSize"]) >= max(sheet.height, sheet.width)
    for number, sprite in enumerate(sprites):
        rect = sprite["rect"]
        assert sprite["name"] == f"{kind}_{number}"
        x, y, width, height = (int(rect[name]) for name in ("x", "y", "width", "height"))
        assert (width, height, x) == (side, side, number % columns * side)
        assert sheet.height - y - side == number // columns * side  # y from below

    number_of = {one["internalID"]: number for number, one in enumerate(sprites)}
    objects = unity(asset)
    assert len(objects) == colors - 1
    rng = np.random.default_rng(0)
    for material, behaviour in enumerate(objects, 1):
        tile = behaviour["MonoBehaviour"]
        assert tile["m_DefaultSprite"]["guid"] == unity(meta)[0]["guid"]
        grid = np.pad(rng.integers(0, 2, (14, 14)) * material, 1)
        for row, column in np.argwhere(grid == material):
            chosen = fitting(tile["m_TilingRules"], grid, row, column, material)
            assert len(chosen) == (2 if kind == "edges" else 1)
            for identity in chosen:
                shown = listed["tiles"][number_of[identity]]
                if kind == "edges":
                    around = [shown[side_] for side_ in SIDES]
                    assert around == [int(grid[row - y, column + x]) for x, y in AROUND[::2]]
                    continue
                assert shown["middle"] == material
                own = [grid[row - y, column + x] == material for x, y in AROUND]
                wanted = [
                    here and (at % 2 == 0 or (own[at - 1] and own[(at + 1) % 8])) for at, here in enumerate(own)
                ]
                assert [one == material for one in shown["around"]] == wanted


def test_tiles_by_corners_are_told() -> None:
    with pytest.raises(InputError, match="these tiles have corners; tile_sheets takes them"):
        edge_sheets(*atlas("corners", 2, [1, 1]), ["a", "b"], EdgeSheetsParams())
