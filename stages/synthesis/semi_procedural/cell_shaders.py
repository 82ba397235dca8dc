"""Shaders of the cells of a lattice: GLSL, HLSL, Godot and OSL."""

import dataclasses
from pathlib import Path
from typing import Any

from texloom.stages.common.features.maps import map_channels
from texloom.stages.common.grids.wang import HASH_FACTORS
from texloom.stages.synthesis.endless.endless_shaders import SIGNED_FACTORS, named, number
from texloom.stages.vocabulary.arrays import Glsl, GodotShader, Hlsl, Image, Osl, ScalarMap
from texloom.stages.vocabulary.declare import InputError, NoParams, stage
from texloom.stages.vocabulary.normals import NORMAL
from texloom.stages.vocabulary.templates import templates

_TYPES = ("float", "vec2", "vec3", "vec4")


@dataclasses.dataclass(frozen=True)
class CellShaders:
    """Source text; all of them lay the same cells."""

    glsl: Glsl
    """a function `cells`, which returns all maps"""
    hlsl: Hlsl
    """the same, and an entry for Unity's Shader Graph, see there for Unreal's Custom node"""
    godot: GodotShader
    """a spatial shader of Godot 4"""
    osl: Osl
    """a shader with an output for each map"""


@stage(version=1)
def cell_shaders(image: Image, window: ScalarMap, layout: dict[str, Any], params: NoParams) -> CellShaders:  # noqa: ARG001
    """Write shaders that lay the cells of a lattice without end, with all maps of a material in one lookup.

    MaterialX has no integers by whose bits cells could be drawn, so that its documents cannot lay them.

    Parameters
    ----------
    image, window, layout : see `cell_texture`.

    Raises
    ------
    InputError
        a map has more than four channels.

    References
    ----------
    [Guehl2020]_.
    """
    channels = {"color": list(range(1 if image.channels[0] == "Y" else 3)), **map_channels(image.channels)}
    maps = []
    for name, own in zip(named(channels), channels.values(), strict=True):
        if len(own) > len(_TYPES):
            raise InputError(f"image: {name} has {len(own)} channels; shaders have at most four")
        maps.append(
            {
                "name": name, "type": _TYPES[len(own) - 1], "count": len(own), "swizzle": "xyzw"[: len(own)],
                "is_normal": tuple(image.channels[index] for index in own) == NORMAL,
            }
        )  # fmt: skip
    first, second = layout["generators"]
    values = {
        **layout, "maps": maps, "window": window.shape, "first": first, "second": second,
        "inverse": [[number(one) for one in row] for row in layout["inverse"]],
        "low": [number(one) for one in layout["low"]], "along": [number(one) for one in layout["along"]],
        "shifted": any(layout["shift"][:2]), "drawn": layout["cells"] // layout["groups"],
        "levels": max(image.height, image.width).bit_length(),
        "factors": [f"0x{factor:08x}" for factor in HASH_FACTORS], "signed_factors": SIGNED_FACTORS,
    }  # fmt: skip
    here = Path(__file__)

    def written(kind: str, is_godot: bool = False) -> str:
        template = templates(here.parent).get_template(f"{here.stem}.{kind}.j2")
        return str(template.render({**values, "godot": is_godot})) + "\n"

    return CellShaders(written("glsl"), written("hlsl"), written("glsl", True), written("osl"))
