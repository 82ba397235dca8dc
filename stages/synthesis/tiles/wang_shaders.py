"""Shaders that cover a plane with Wang tiles: GLSL and MaterialX."""

import dataclasses
from pathlib import Path
from typing import Any

from texloom.stages.common.grids.wang import CORNERS, HASH_FACTORS, SIDES, WangSet
from texloom.stages.vocabulary.arrays import Glsl, MaterialX
from texloom.stages.vocabulary.declare import InputError, Params, stage
from texloom.stages.vocabulary.templates import templates


class WangShadersParams(Params):
    """The file that is sampled."""

    file: str = "tiles.png"
    """name of the atlas, relative to the MaterialX document"""


@dataclasses.dataclass(frozen=True)
class WangShaders:
    """Source text."""

    glsl: Glsl
    """a function `wang(atlas, position)`, which lays the tiles as `wang_tiling` does with seed 0"""
    materialx: MaterialX
    """a material; its nodes choose tiles by MaterialX's own noise"""


@stage(version=1)
def wang_shaders(layout: dict[str, Any], params: WangShadersParams) -> WangShaders:
    """Write small reference shaders that look up which tile of an atlas covers a point of the plane.

    Parameters
    ----------
    layout : see `wang_tiles`.

    References
    ----------
    [Wei2004]_, with a table in place of its formulas, which serves coloured corners as well.
    """
    tiles = WangSet.of(layout)
    if tiles.shape != (tiles.side, tiles.side):
        raise InputError("layout: shaders choose among tiles by their colours, not among variants of them")
    names = SIDES if tiles.kind == "edges" else CORNERS
    values = {
        "file": params.file, "kind": tiles.kind, "colors": tiles.colors, "side": tiles.side,
        "factors": [f"0x{factor:08x}" for factor in HASH_FACTORS],
        "digits": [
            (name, (across, down), layer)
            for name, (down, across, layer) in zip(names, tiles.digits, strict=True)
        ],
        "places": tiles.places[:, ::-1].reshape(tiles.side, tiles.side, 2).tolist(),
    }  # fmt: skip
    here = Path(__file__)
    glsl, materialx = (
        templates(here.parent).get_template(f"{here.stem}.{kind}.j2").render(values) + "\n"
        for kind in ("glsl", "mtlx")
    )
    return WangShaders(glsl, materialx)
