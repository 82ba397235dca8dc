"""Shaders of the cells of a lattice: GLSL, HLSL, Godot and OSL."""

import dataclasses
from typing import Any

from texloom.stages.synthesis.endless.endless_shaders import number
from texloom.stages.synthesis.endless.shader_texts import shader_maps, shader_texts
from texloom.stages.vocabulary.arrays import Glsl, GodotShader, Hlsl, Image, Osl, ScalarMap
from texloom.stages.vocabulary.declare import NoParams, stage


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
    first, second = layout["generators"]
    values = {
        **layout, "maps": shader_maps(image), "window": window.shape, "first": first, "second": second,
        "inverse": [[number(one) for one in row] for row in layout["inverse"]],
        "low": [number(one) for one in layout["low"]], "along": [number(one) for one in layout["along"]],
        "shifted": any(layout["shift"][:2]), "drawn": layout["cells"] // layout["groups"],
        "levels": max(image.height, image.width).bit_length(),
    }  # fmt: skip
    return CellShaders(*shader_texts(__file__, values))
