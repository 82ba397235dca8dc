"""Tiles between materials, and the sheets and files that engines take."""

from __future__ import annotations

import re
import xml.etree.ElementTree as ElementTree
from typing import Any

import numpy as np
import pytest

from tests.runs import run_with_threads
from tests.synthetic import picture
from texloom.pipelines.flow.loader import load_flow
from texloom.pipelines.flow.shipped import shipped_flows
from texloom.stages.common.grids.wang import CORNERS, WangSet
from texloom.stages.evaluation.wang_tiling import WangTilingParams, wang_tiling
from texloom.stages.synthesis.remix.exemplar_sheet import ExemplarSheet, ExemplarSheetParams, exemplar_sheet
from texloom.stages.synthesis.tiles.tile_materials import TileMaterials
from texloom.stages.synthesis.tiles.tile_sets import TileSetsParams, tile_sets
from texloom.stages.synthesis.tiles.tile_sheets import TileSheets, TileSheetsParams, tile_sheets
from texloom.stages.synthesis.tiles.wang_borders import WangBordersParams, wang_borders
from texloom.stages.synthesis.tiles.wang_tiles import WangTiles, WangTilesParams, wang_tiles
from texloom.stages.vocabulary.arrays import Image
from texloom.stages.vocabulary.declare import InputError

TILE = 32
QUICK = {"preset": "fast", "patch_size": 5}


def exemplars(count: int) -> ExemplarSheet:
    """Noise of a colour each."""
    rng = np.random.default_rng(5)
    colours = np.eye(4, 3)[:count, None, None] * 0.5 + 0.05
    images: list[Image | None] = [
        picture((colour * (0.5 + rng.random((48, 48, 1)))).astype(np.float32)) for colour in colours
    ]
    return exemplar_sheet(images, [{"name": name} for name in "abcd"[:count]], ExemplarSheetParams())


def tiles_of(made: ExemplarSheet, strength: float = 1.0, **params: Any) -> WangTiles:
    borders = wang_borders(
        made.image, WangBordersParams(**{**QUICK, "tile": TILE, "border": 5, "kind": "corners", **params}),
        np.random.default_rng(1), rectangles=made.rectangles,
    )  # fmt: skip
    parts = (borders.image, borders.match, borders.keep, borders.filled, borders.table)
    return wang_tiles(
        made.image,
        *parts,
        WangTilesParams(**QUICK, strength=strength),
        np.random.default_rng(2),
        rectangles=made.rectangles,
    )


@pytest.fixture(scope="module", params=[2, 3])
def result(request: pytest.FixtureRequest) -> tuple[ExemplarSheet, WangTiles]:
    made = exemplars(request.param)
    return made, tiles_of(made)


@pytest.fixture(scope="module")
def sheets(result: tuple[ExemplarSheet, WangTiles]) -> TileSheets:
    made, tiles = result
    return tile_sheets(tiles.image, tiles.table, made.names, TileSheetsParams())


def test_every_corner_has_its_material(result: tuple[ExemplarSheet, WangTiles]) -> None:
    made, tiles = result
    number = np.zeros((made.image.height, made.image.width), int)
    for exemplar, (row, column, height, width) in enumerate(made.rectangles.tolist()):
        number[row : row + height, column : column + width] = exemplar
    shown = number[tiles.match[..., 0], tiles.match[..., 1]]
    third = TILE // 3
    shares = []
    for tile in tiles.table["tiles"]:
        own = shown[tile["y"] : tile["y"] + TILE, tile["x"] : tile["x"] + TILE]
        parts = (own[:third, :third], own[:third, -third:], own[-third:, -third:], own[-third:, :third])
        for corner, part in zip(CORNERS, parts, strict=True):
            shares.append((part == tile[corner]).mean())
    assert len(tiles.table["tiles"]) == len(made.names) ** 4
    assert np.mean(shares) > 0.95
    assert np.min(shares) > 0.6


def test_borders_do_not_show(result: tuple[ExemplarSheet, WangTiles]) -> None:
    made, tiles = result
    tiling = wang_tiling(tiles.image, tiles.table, WangTilingParams(), tiles.match, made.rectangles)
    assert tiling.table["albedo"]["ratio"] < 1.1


def test_materials_lead_from_corner_to_corner_around_the_torus() -> None:
    made = exemplars(3)
    materials = TileMaterials.of(made.image, made.rectangles)
    planes = materials.between(np.array([[0, 1, 2]]), 10, 30) / materials.strength
    assert planes.shape == (10, 30, 3)
    np.testing.assert_allclose(planes.sum(axis=2), 1, rtol=1e-5)
    np.testing.assert_array_equal(planes[0].argmax(axis=1), np.repeat([0, 1, 2, 0], [5, 10, 10, 5]))
    np.testing.assert_array_equal(planes, np.broadcast_to(planes[:1], planes.shape))
    turned = materials.between(np.array([[0], [1], [2]]), 30, 10) / materials.strength
    np.testing.assert_allclose(turned, planes.swapaxes(0, 1), atol=1e-6)


def test_a_map_of_blob_tiles_is_one_of_corner_tiles_at_half_the_side(
    result: tuple[ExemplarSheet, WangTiles], sheets: TileSheets
) -> None:
    if len(result[0].names) == 3:
        assert [tile["middle"] for tile in sheets.table["blob"]["tiles"]] == [0] + [1] * 47 + [0] + [2] * 47
        return
    blob, corners = sheets.table["blob"], sheets.table["corners"]
    assert (len(blob["tiles"]), blob["size"], corners["size"]) == (48, 2 * TILE, TILE)
    cells = np.random.default_rng(0).integers(0, 2, (8, 8))
    around = [(-1, 0), (-1, 1), (0, 1), (1, 1), (1, 0), (1, -1), (0, -1), (-1, -1)]
    # Materials on a grid of half the side, as the two kinds of tiles agree on them.
    fine = np.zeros((17, 17), int)
    for row, column in np.argwhere(cells):
        fine[2 * row + 1, 2 * column + 1] = 1
        for down, across in around:
            rows, columns = sorted((row, row + down)), sorted((column, column + across))
            block = cells[max(0, rows[0]) : rows[1] + 1, max(0, columns[0]) : columns[1] + 1]
            inside = rows[0] >= 0 and columns[0] >= 0 and rows[1] < 8 and columns[1] < 8
            fine[2 * row + 1 + down, 2 * column + 1 + across] = inside and block.all()

    def cut(sheet: Image, table: dict[str, Any], number: int) -> np.ndarray:
        side, (row, column) = table["size"], divmod(number, table["columns"])
        return sheet.pixels[row * side : (row + 1) * side, column * side : (column + 1) * side]

    by_corners = {tuple(tile[name] for name in CORNERS): tile["number"] for tile in corners["tiles"]}
    by_around = {(tile["middle"], *tile["around"]): tile["number"] for tile in blob["tiles"]}
    assert len(by_around) == 48
    for row, column in np.ndindex(8, 8):
        at = (2 * row + 1, 2 * column + 1)
        middle = int(fine[at])
        key = (middle, *(int(fine[at[0] + down, at[1] + across]) if middle else 0 for down, across in around))
        whole = cut(sheets.blob, blob, by_around[key])
        for down, across in np.ndindex(2, 2):
            top, left = at[0] - 1 + down, at[1] - 1 + across
            own = tuple(int(fine[y, x]) for y, x in
                        ((top, left), (top, left + 1), (top + 1, left + 1), (top + 1, left)))  # fmt: skip
            if middle:
                quarter = whole[down * TILE : (down + 1) * TILE, across * TILE : (across + 1) * TILE]
                np.testing.assert_array_equal(quarter, cut(sheets.corners, corners, by_corners[own]))


def test_tiled_finds_every_tile(result: tuple[ExemplarSheet, WangTiles], sheets: TileSheets) -> None:
    count = len(result[0].names)
    for text, kind, tiles, image in (
        (sheets.corners_tiled, "corner", count**4, sheets.corners),
        (sheets.blob_tiled, "mixed", 1 + 46 * (count - 1), sheets.blob),
    ):
        root = ElementTree.fromstring(text)
        picture_of = root.find("image")
        assert picture_of is not None
        assert (picture_of.get("width"), picture_of.get("height")) == (str(image.width), str(image.height))
        assert int(root.get("columns", 0)) * int(root.get("tilewidth", 0)) == image.width
        assert int(root.get("tilecount", 0)) * int(root.get("tilewidth", 0)) ** 2 == image.width * image.height
        terrain = root.find("wangsets/wangset")
        assert terrain is not None
        assert terrain.get("type") == kind
        assert [color.get("name") for color in terrain.findall("wangcolor")] == result[0].names
        ids = [tile.get("wangid") for tile in terrain.findall("wangtile")]
        assert len(set(ids)) == tiles
        assert len(ids) == (tiles if kind == "corner" else 47 * (count - 1))


def test_godot_finds_every_tile(result: tuple[ExemplarSheet, WangTiles], sheets: TileSheets) -> None:
    count = len(result[0].names)
    for text, mode, tiles, bits in (
        (sheets.corners_godot, 1, count**4, 4),
        (sheets.blob_godot, 0, 48 * (count - 1), 8),
    ):
        sections = re.split(r"^(?=\[)", text, flags=re.M)[1:]
        heads = [re.match(r"\[(\w+)", section) for section in sections]
        assert [head and head[1] for head in heads] == ["gd_resource", "ext_resource", "sub_resource", "resource"]
        source, resource = (
            dict(line.split(" = ", 1) for line in section.splitlines()[1:] if line) for section in sections[2:]
        )
        assert resource["terrain_set_0/mode"] == str(mode)
        assert [resource[f"terrain_set_0/terrain_{n}/name"] for n in range(count)] == [
            f'"{name}"' for name in result[0].names
        ]
        own = [key for key in source if re.fullmatch(r"\d+:\d+/0", key)]
        assert len(own) == tiles
        for key in own:
            assert source[f"{key}/terrain_set"] == "0"
            peering = [value for name, value in source.items() if name.startswith(f"{key}/terrains_peering_bit/")]
            assert len(peering) == bits
            assert set(peering) <= set(map(str, range(count)))


def test_names_are_quoted() -> None:
    made = exemplars(2)
    atlas = picture(np.zeros((4 * 24, 4 * 24, 3), np.float32))
    layout = {"size": 24, "kind": "corners", "colors": 2, "variants": [1, 1]}
    written = tile_sheets(atlas, layout, ['a "<b>', "c"], TileSheetsParams())
    root = ElementTree.fromstring(written.corners_tiled)
    assert [color.get("name") for color in root.iter("wangcolor")] == ['a "<b>', "c"]
    assert '/name = "a \\"\\u003cb\\u003e"' in written.corners_godot
    assert made.names == ["a", "b"]


def test_variants_lie_below() -> None:
    layout = {"size": 24, "kind": "corners", "colors": 2, "variants": [2, 1]}
    shape = WangSet.of(layout).shape
    places = np.indices(shape).transpose(1, 2, 0).repeat(24, axis=0).repeat(24, axis=1)
    atlas = picture(np.concatenate([places, places[..., :1]], axis=2).astype(np.float32))
    written = tile_sheets(atlas, layout, ["a", "b"], TileSheetsParams())
    assert (written.corners.height, written.corners.width) == (8 * 24, 4 * 24)
    tiles = WangSet.of(layout)
    for tile in written.table["corners"]["tiles"]:
        row, column = divmod(tile["number"], 4)
        at = tuple(written.corners.pixels[row * 24, column * 24, :2].astype(int))
        assert tiles.tile_corners[at].tolist() == [tile[name] for name in CORNERS]


def test_large_tiles_have_the_same_borders_wherever_their_corners_are_the_same(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Their blocks are laid at half the size, and bands and corners are less high than they are."""
    monkeypatch.setattr("texloom.stages.synthesis.tiles.tile_synthesis._MIN_HALVED", TILE)
    made, tile = exemplars(2), 2 * TILE
    tiles = tiles_of(made, tile=tile)
    atlas = tiles.image.pixels
    layout = WangSet.of(tiles.table)
    assert atlas.shape[:2] == (4 * tile, 4 * tile)
    wide = np.pad(atlas, ((tile // 2, tile // 2), (0, 0), (0, 0)), mode="wrap")
    upper, first = layout.borders[0], dict[int, np.ndarray]()
    for (row, column), number in np.ndenumerate(upper):
        at = tile // 2 + row * tile
        own = wide[at - 1 : at + 1, column * tile : (column + 1) * tile]
        np.testing.assert_array_equal(own, first.setdefault(number, own))
    tiling = wang_tiling(tiles.image, tiles.table, WangTilingParams(), tiles.match, made.rectangles)
    assert tiling.table["albedo"]["ratio"] < 1.1


def test_any_number_of_threads_gives_the_same_tiles(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("texloom.stages.synthesis.tiles.tile_synthesis._MIN_HALVED", TILE)
    one, two = run_with_threads(lambda: tiles_of(exemplars(2)).match, monkeypatch)
    np.testing.assert_array_equal(one, two)


@pytest.mark.parametrize("count", [1, 4])
def test_two_or_three_exemplars(count: int) -> None:
    with pytest.raises(InputError, match=f"need two or three, got {count}"):
        tiles_of(exemplars(count))


def test_variants_between_materials_are_new_ones() -> None:
    with pytest.raises(InputError, match="strength: variants of tiles between materials are new ones"):
        tiles_of(exemplars(2), strength=0.5, variants=(1, 2))


def test_sets_that_are_not_wanted_do_not_run() -> None:
    chosen = [tile_sets(TileSetsParams(sets=sets)).table["chosen"] for sets in ("both", "corners", "edges")]
    assert chosen == [["corners", "edges"], ["corners"], ["edges"]]
    steps = load_flow(shipped_flows()["transition_tiles"]).steps
    labels = {name: str(step.chosen) for name, step in steps.items() if step.chosen is not None}
    assert labels == {"borders": "sets.corners", "edge_borders": "sets.edges"}
    with pytest.raises(ValueError, match="sets"):
        TileSetsParams(sets="blobs")
