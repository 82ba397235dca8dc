"""Tiles between materials by their corners as sheets for engines, with files that tell which tile fits where."""

import dataclasses
import itertools
from typing import Any

import numpy as np
from jaxtyping import Int64

from texloom.stages.common.grids.wang import CORNERS, WangSet, laid
from texloom.stages.synthesis.tiles.tile_files import AROUND, tile_files
from texloom.stages.vocabulary.arrays import GodotTileset, Image, TiledTileset, UnityAsset, UnityMeta
from texloom.stages.vocabulary.declare import Params, stage

_BLOB_COLUMNS = 8


class TileSheetsParams(Params):
    """Names of the sheets."""

    corners: str = "corners.png"
    """file of the sheet of tiles by the materials of their corners, as the tile sets name it"""
    blob: str = "blob.png"
    """file of the sheet of tiles by all that is around them"""


@dataclasses.dataclass(frozen=True)
class TileSheets:
    """Sheets, and tables of what each tile shows."""

    corners: Image
    """a tile for each way in which materials meet at the corners, 16 of two or 81 of three, as of a dual grid;
    variants below"""
    blob: Image
    """48 tiles of twice the side for each material but the first: one of the first alone, and 47 with the other in
    one cell, by which of the eight around it have it too"""
    corners_tiled: TiledTileset
    """terrain of corners"""
    blob_tiled: TiledTileset
    """terrain of corners and sides"""
    corners_godot: GodotTileset
    """terrain that matches corners"""
    blob_godot: GodotTileset
    """terrain that matches corners and sides"""
    corners_slices: UnityMeta
    """a sprite for each tile, named by its number; a RuleTile knows cells and not corners"""
    blob_slices: UnityMeta
    """a sprite for each tile"""
    blob_rules: UnityAsset
    """a RuleTile by corners and sides for each material but the first, with these sprites"""
    table: dict[str, Any]
    """``names`` of the materials; ``corners`` and ``blob``, each with `file`, `size` of a tile, px, `columns`, and
    `tiles`: `number` in the sheet, row by row, and numbers of materials; `northwest`, `northeast`, `southeast`,
    `southwest`, or `around`, from above clockwise; of `corners` also `variant`"""


@stage(version=1)
def tile_sheets(image: Image, layout: dict[str, Any], names: list[str], params: TileSheetsParams) -> TileSheets:
    """Arrange tiles between materials as engines expect them.

    A blob tile is made of four tiles by corners: its middle has the second material, the middle of a side where the
    cell beyond has it too, a corner where all cells around have it. So borders are as exact as those of the tiles.

    Parameters
    ----------
    image, layout : the atlas and its table, see `wang_tiles`.
    names : of the materials.

    References
    ----------
    [Lagae2006]_ for corners. See `tile_files` for the formats.
    """
    tiles, size = WangSet.of(layout), int(layout["size"])
    variants = int(np.prod(tiles.variants))
    places = tiles.places.reshape(-1, variants, 2)
    columns = tiles.side
    number = np.arange(len(places))
    colors = np.stack([number // tiles.colors**power % tiles.colors for power in (3, 2, 1, 0)], axis=1)
    corners = [
        {"number": variant * len(places) + at, "variant": variant, **dict(zip(CORNERS, own, strict=True))}
        for variant in range(variants)
        for at, own in enumerate(colors.tolist())
    ]
    order = np.moveaxis(places, 1, 0).reshape(-1, columns, 2)
    around = _blob_cells(tiles.colors)
    blob = [
        {"number": at, "middle": int(cells[1, 1]), "around": [int(cells[1 + y, 1 + x]) for y, x in AROUND]}
        for at, cells in enumerate(around)
    ]
    table: dict[str, Any] = {
        "names": names,
        "corners": {"file": params.corners, "size": size, "columns": columns, "tiles": corners},
        "blob": {"file": params.blob, "size": 2 * size, "columns": _BLOB_COLUMNS, "tiles": blob},
    }
    corner_sheet = image.elsewhere(laid(image.pixels, order, size))
    blob_sheet = image.elsewhere(laid(image.pixels, _blob_places(tiles, around), size))
    of_corners = [
        {
            "number": tile["number"],
            "middle": max(tile[name] for name in CORNERS),
            "around": [None, tile["northeast"], None, tile["southeast"], None, tile["southwest"], None,
                       tile["northwest"]],
        }
        for tile in corners
    ]  # fmt: skip
    corner_files = tile_files(corner_sheet, params.corners, size, "corners", names, of_corners)
    blob_files = tile_files(blob_sheet, params.blob, 2 * size, "both", names, blob)
    return TileSheets(
        corners=corner_sheet,
        blob=blob_sheet,
        corners_tiled=corner_files.tiled,
        blob_tiled=blob_files.tiled,
        corners_godot=corner_files.godot,
        blob_godot=blob_files.godot,
        corners_slices=corner_files.slices,
        blob_slices=blob_files.slices,
        blob_rules=blob_files.rules,
        table=table,
    )


def _blob_cells(materials: int) -> Int64[np.ndarray, "m 3 3"]:
    """Materials of a cell and of those around it: for each but the first, the first alone and all ways that differ.

    A diagonal neighbour counts only where both sides beside it have the same material too.
    """
    found = [np.zeros((3, 3), np.int64)]
    for sides in itertools.product((0, 1), repeat=8):
        cells = np.ones((3, 3), np.int64)
        for (row, column), one in zip(AROUND, sides, strict=True):
            cells[1 + row, 1 + column] = one
        if all(cells[y, x] <= min(cells[1, x], cells[y, 1]) for y in (0, 2) for x in (0, 2)):
            found.append(cells)
    return np.concatenate([material * np.stack(found) for material in range(1, materials)])


def _blob_places(tiles: WangSet, cells: Int64[np.ndarray, "n 3 3"]) -> Int64[np.ndarray, "m c 2"]:
    """Places in the atlas of the tiles of which blob tiles are made, as a sheet: two rows and columns each."""
    variants = int(np.prod(tiles.variants))
    corners = np.stack([cells[:, y : y + 2, x : x + 2] for y, x in ((0, 0), (0, 1), (1, 1), (1, 0))], axis=-1)
    chosen = tiles.places[tiles.number(corners) * variants + np.arange(len(cells))[:, None, None] % variants]
    sheet = chosen.reshape(-1, _BLOB_COLUMNS, 2, 2, 2)
    return np.asarray(np.moveaxis(sheet, 2, 1).reshape(-1, 2 * _BLOB_COLUMNS, 2))
