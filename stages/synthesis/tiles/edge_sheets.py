"""Tiles between materials by their edges as a sheet for engines, with the files that tell which tile fits where."""

import dataclasses
from typing import Any

import numpy as np

from texloom.stages.common.grids.wang import SIDES, WangSet, laid
from texloom.stages.synthesis.tiles.tile_files import tile_files
from texloom.stages.synthesis.tiles.tile_materials import material_points
from texloom.stages.vocabulary.arrays import GodotTileset, Image, TiledTileset, UnityAsset, UnityMeta
from texloom.stages.vocabulary.declare import InputError, Params, stage


class EdgeSheetsParams(Params):
    """Name of the sheet."""

    edges: str = "edges.png"
    """file of the sheet, as the tile sets name it"""


@dataclasses.dataclass(frozen=True)
class EdgeSheets:
    """The sheet, and a table of what each tile shows."""

    edges: Image
    """a tile for each way in which its four edges have materials, 16 of two or 81 of three; variants below"""
    tiled: TiledTileset
    """terrain of edges"""
    godot: GodotTileset
    """terrain that matches sides"""
    slices: UnityMeta
    """a sprite for each tile"""
    rules: UnityAsset
    """a RuleTile by sides for each material but the first, with these sprites"""
    table: dict[str, Any]
    """``names`` of the materials; ``edges``: `file`, `size` of a tile, px, `columns`, and `tiles`: `number` in the
    sheet, row by row, `variant`, and numbers of materials: `north`, `east`, `south`, `west` and `middle`"""


@stage(version=1)
def edge_sheets(image: Image, layout: dict[str, Any], names: list[str], params: EdgeSheetsParams) -> EdgeSheets:
    """Arrange tiles whose edges have materials as engines expect them.

    All corners have the first material, in which the others lie like paths that cross the edges.

    Parameters
    ----------
    image, layout : the atlas and its table, see `wang_tiles`.
    names : of the materials.

    Raises
    ------
    InputError
        the tiles have materials at corners.

    References
    ----------
    [Cohen2003]_ for coloured edges. See `tile_files` for the formats.
    """
    tiles, size = WangSet.of(layout), int(layout["size"])
    if tiles.kind != "edges":
        raise InputError(f"layout: these tiles have {tiles.kind}; tile_sheets takes them")
    variants = int(np.prod(tiles.variants))
    order = np.moveaxis(tiles.places.reshape(-1, variants, 2), 1, 0).reshape(-1, 2)
    middles = material_points(tiles)[1::2, 1::2]
    found = [
        {
            "number": number,
            "variant": number // tiles.colors**4,
            **dict(zip(SIDES, tiles.tiles[row, column].tolist(), strict=True)),
            "middle": int(middles[row, column]),
        }
        for number, (row, column) in enumerate(order.tolist())
    ]
    sheet = image.elsewhere(laid(image.pixels, order.reshape(-1, tiles.side, 2), size))
    shown = [
        {
            "number": tile["number"],
            "middle": tile["middle"],
            "around": [tile["north"], None, tile["east"], None, tile["south"], None, tile["west"], None],
        }
        for tile in found
    ]
    files = tile_files(sheet, params.edges, size, "sides", names, shown)
    table = {
        "names": names,
        "edges": {"file": params.edges, "size": size, "columns": tiles.side, "tiles": found},
    }
    return EdgeSheets(sheet, files.tiled, files.godot, files.slices, files.rules, table)
