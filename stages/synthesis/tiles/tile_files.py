"""The files that tell Tiled, Godot and Unity which tile of a sheet fits where."""

import dataclasses
import hashlib
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, Literal, TypeAlias

from texloom.stages.vocabulary.arrays import GodotTileset, Image, TiledTileset, UnityAsset, UnityMeta
from texloom.stages.vocabulary.templates import templates

By: TypeAlias = Literal["corners", "both", "sides"]

AROUND = ((-1, 0), (-1, 1), (0, 1), (1, 1), (1, 0), (1, -1), (0, -1), (-1, -1))
"""rows and columns of a tile's neighbours, from above, clockwise"""

_PLACES = (
    "top_side", "top_right_corner", "right_side", "bottom_right_corner",
    "bottom_side", "bottom_left_corner", "left_side", "top_left_corner",
)  # fmt: skip
_COLORS = ((0.9, 0.45, 0.6), (0.4, 0.65, 0.35), (0.35, 0.5, 0.85))  # of materials in editors
_TILED = {"corners": "corner", "both": "mixed", "sides": "edge"}
_GODOT = {"both": 0, "corners": 1, "sides": 2}
_ANY, _THIS, _OTHER = 0, 1, 2  # neighbours of a RuleTile
_TEXTURE_SIDES = tuple(2**power for power in range(5, 15))  # px that Unity reduces larger textures to
_ENDINGS = ("tsx", "tres", "meta", "asset")


@dataclasses.dataclass(frozen=True)
class TileFiles:
    """A sheet's files, which name its picture."""

    tiled: TiledTileset
    godot: GodotTileset
    slices: UnityMeta
    """beside the picture: a sprite for each tile, named by the picture's name and the tile's number"""
    rules: UnityAsset
    """a RuleTile for each material but the first, the main one that of the second"""


def tile_files(
    sheet: Image, file: str, size: int, by: By, names: Sequence[str], tiles: Sequence[Mapping[str, Any]]
) -> TileFiles:
    """Write the files of a sheet, rows of tiles of ``size`` px.

    Parameters
    ----------
    file : of the picture.
    by : what is around a tile: materials at corners, at both corners and sides, or at sides.
    names : of the materials.
    tiles : of each its ``number`` in the sheet, the material of its ``middle``, and those ``around``, see `AROUND`,
        None where there is none.

    References
    ----------
    The formats are those that Tiled 1.10, Godot 4, and Unity's 2D Tilemap Extras 3 and texture importer document.
    Of RuleTiles, a neighbour is of the same RuleTile or not.
    """
    longest = max(sheet.height, sheet.width)
    stem = file.rpartition(".")[0] or file
    rows, columns = sheet.height // size, sheet.width // size
    shown = [
        {
            "number": tile["number"],
            "middle": tile["middle"],
            # Tiled knows nothing of a tile's middle: that of a cell alone would be as one of the first material.
            "alone": by == "both" and tile["middle"] and not any(tile["around"]),
            "around": [0 if one is None else one + 1 for one in tile["around"]],
            "peering": [
                (place, one) for place, one in zip(_PLACES, tile["around"], strict=True) if one is not None
            ],
        }
        for tile in tiles
    ]
    # The same picture has the same identity wherever it is made; another one never the same.
    identity = hashlib.sha256(f"{file} {sheet.pixels.shape} ".encode() + sheet.pixels.tobytes()).hexdigest()[:32]
    sprites = [
        {
            "number": number,
            "name": f"{stem}_{number}",
            "id": _sprite_id(stem, number),
            "identity": hashlib.sha256(f"{identity} {number}".encode()).hexdigest()[:32],
            "x": number % columns * size,
            "y": (rows - 1 - number // columns) * size,
        }
        for number in range(rows * columns)
    ]
    values = {
        "file": file, "stem": stem, "size": size, "columns": columns, "rows": rows, "names": names,
        "tiled": _TILED[by], "godot": _GODOT[by], "tiles": shown, "shares": _COLORS,
        "colors": ["#" + "".join(f"{round(255 * share):02x}" for share in color) for color in _COLORS],
        "identity": identity, "sprites": sprites, "rules": list(_rules(by, len(names), tiles)),
        "side": next((side for side in _TEXTURE_SIDES if side >= longest), _TEXTURE_SIDES[-1]),
        "positions": [(column, -row) for row, column in AROUND],
    }  # fmt: skip
    here = Path(__file__)
    found = templates(here.parent)
    return TileFiles(*(found.get_template(f"{here.stem}.{kind}.j2").render(values) + "\n" for kind in _ENDINGS))


def _sprite_id(stem: str, number: int) -> int:
    """A positive number of 63 bits, as Unity gives sprites."""
    return int.from_bytes(hashlib.sha256(f"{stem} {number}".encode()).digest()[:8], "big") >> 1 or 1


def _rules(by: By, materials: int, tiles: Sequence[Mapping[str, Any]]) -> Iterator[dict[str, Any]]:
    """Of each material but the first: ``whole``, its tile for where no rule fits, and which ``tiles`` are for which
    neighbours; variants are together.
    """
    for material in range(1, materials):
        found = dict[str, list[int]]()
        whole = 0
        for tile in tiles:
            around = tile["around"]
            alone = by == "sides" and not any(one for one in around if one is not None)
            if by == "corners" or (tile["middle"] != material and not alone):
                continue
            if any(one not in (None, 0, material) for one in around):
                continue
            asked = [_ANY if one is None else _THIS if one == material else _OTHER for one in around]
            for corner in range(1, 8, 2):  # without both sides beside it, a corner is as it is
                if by == "both" and _OTHER in (asked[corner - 1], asked[(corner + 1) % 8]):
                    asked[corner] = _ANY
            found.setdefault("".join(f"{one:02x}000000" for one in asked), []).append(tile["number"])
            if all(one in (None, material) for one in around):
                whole = tile["number"]
        if found:
            yield {"whole": whole, "tiles": found, "material": material}
