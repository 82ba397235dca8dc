"""Tiles between materials as sheets for engines, with the files that tell Godot and Tiled which tile fits where."""

import dataclasses
import itertools
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Int64

from texloom.stages.common.grids.wang import CORNERS, WangSet, laid
from texloom.stages.vocabulary.arrays import GodotTileset, Image, TiledTileset
from texloom.stages.vocabulary.declare import Params, stage
from texloom.stages.vocabulary.templates import templates

_BLOB_COLUMNS = 8
_AROUND = ((-1, 0), (-1, 1), (0, 1), (1, 1), (1, 0), (1, -1), (0, -1), (-1, -1))  # from above, clockwise
_PLACES = (
    "top_side", "top_right_corner", "right_side", "bottom_right_corner",
    "bottom_side", "bottom_left_corner", "left_side", "top_left_corner",
)  # fmt: skip
_COLORS = ((0.9, 0.45, 0.6), (0.4, 0.65, 0.35), (0.35, 0.5, 0.85))  # of materials in editors


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
    """48 tiles of twice the side: the second material in one cell, by which of the eight around it have it too, 47
    of them, and one of the first alone; of three materials only one of the first"""
    corners_tiled: TiledTileset
    """terrain of corners"""
    blob_tiled: TiledTileset
    """terrain of corners and sides"""
    corners_godot: GodotTileset
    """terrain that matches corners"""
    blob_godot: GodotTileset
    """terrain that matches corners and sides"""
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
    [Lagae2006]_ for corners. The formats are those that Tiled 1.10 and Godot 4 document.
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
    around = _blob_cells() if tiles.colors == 2 else np.zeros((1, 3, 3), np.int64)
    blob = [
        {"number": at, "middle": int(cells[1, 1]), "around": [int(cells[1 + y, 1 + x]) for y, x in _AROUND]}
        for at, cells in enumerate(around)
    ]
    blob_columns = min(_BLOB_COLUMNS, len(blob))
    table: dict[str, Any] = {
        "names": names,
        "corners": {"file": params.corners, "size": size, "columns": columns, "tiles": corners},
        "blob": {"file": params.blob, "size": 2 * size, "columns": blob_columns, "tiles": blob},
    }
    of_corners = [
        {
            "number": tile["number"],
            "middle": max(tile[name] for name in CORNERS),
            "around": [None, tile["northeast"], None, tile["southeast"], None, tile["southwest"], None,
                       tile["northwest"]],
        }
        for tile in corners
    ]  # fmt: skip
    corner_files = _files(params.corners, size, columns, len(order), False, names, of_corners)
    blob_files = _files(params.blob, 2 * size, blob_columns, len(blob) // blob_columns, True, names, blob)
    return TileSheets(
        corners=image.elsewhere(laid(image.pixels, order, size)),
        blob=image.elsewhere(laid(image.pixels, _blob_places(tiles, around), size)),
        corners_tiled=corner_files[0],
        blob_tiled=blob_files[0],
        corners_godot=corner_files[1],
        blob_godot=blob_files[1],
        table=table,
    )


def _blob_cells() -> Int64[np.ndarray, "48 3 3"]:
    """The materials of a cell and of those around it, for the first material alone, then for all ways that differ.

    A diagonal neighbour counts only where both sides beside it have the second material too.
    """
    found = []
    for sides in itertools.product((0, 1), repeat=8):
        cells = np.ones((3, 3), np.int64)
        for (row, column), material in zip(_AROUND, sides, strict=True):
            cells[1 + row, 1 + column] = material
        if all(cells[y, x] <= min(cells[1, x], cells[y, 1]) for y in (0, 2) for x in (0, 2)):
            found.append(cells)
    return np.stack([np.zeros((3, 3), np.int64), *found])


def _blob_places(tiles: WangSet, cells: Int64[np.ndarray, "n 3 3"]) -> Int64[np.ndarray, "m c 2"]:
    """Places in the atlas of the tiles of which blob tiles are made, as a sheet: two rows and columns each."""
    variants = int(np.prod(tiles.variants))
    corners = np.stack([cells[:, y : y + 2, x : x + 2] for y, x in ((0, 0), (0, 1), (1, 1), (1, 0))], axis=-1)
    chosen = tiles.places[tiles.number(corners) * variants + np.arange(len(cells))[:, None, None] % variants]
    columns = min(_BLOB_COLUMNS, len(cells))
    sheet = chosen.reshape(-1, columns, 2, 2, 2)
    return np.asarray(np.moveaxis(sheet, 2, 1).reshape(-1, 2 * columns, 2))


def _files(
    file: str, size: int, columns: int, rows: int, sides: bool, names: list[str], tiles: list[dict[str, Any]]
) -> tuple[str, str]:
    """The tile sets of Tiled and of Godot for a sheet."""
    shown = [
        {
            "number": tile["number"],
            "middle": tile["middle"],
            # Tiled knows nothing of a tile's middle: that of a cell alone would be as one of the first material.
            "alone": sides and tile["middle"] and not any(tile["around"]),
            "around": [0 if one is None else one + 1 for one in tile["around"]],
            "peering": [
                (place, one) for place, one in zip(_PLACES, tile["around"], strict=True) if one is not None
            ],
        }
        for tile in tiles
    ]
    values = {
        "file": file, "size": size, "columns": columns, "rows": rows, "sides": sides, "names": names,
        "tiles": shown, "shares": _COLORS,
        "colors": ["#" + "".join(f"{round(255 * share):02x}" for share in color) for color in _COLORS],
    }  # fmt: skip
    here = Path(__file__)
    tiled, godot = (
        templates(here.parent).get_template(f"{here.stem}.{kind}.j2").render(values) + "\n"
        for kind in ("tsx", "tres")
    )
    return tiled, godot
