"""Shaders of hex tiling: GLSL, HLSL, Godot and OSL."""

import dataclasses
from typing import Any

import numpy as np
from pydantic import Field

from texloom.stages.synthesis.endless.endless_shaders import number
from texloom.stages.synthesis.endless.hex_tiling import FLATTEST, LUMINANCE
from texloom.stages.synthesis.endless.shader_texts import shader_maps, shader_texts
from texloom.stages.synthesis.endless.triangle_grid import SHARE
from texloom.stages.vocabulary.arrays import Glsl, GodotShader, Hlsl, Image, Osl
from texloom.stages.vocabulary.declare import Params, stage
from texloom.stages.vocabulary.tileable import check_continues


class HexShadersParams(Params):
    """How tiles are laid and blended."""

    tile: float = Field(SHARE, ge=0.05, le=1.0)
    """distance of neighbouring tiles, as a share of the texture's shorter side"""
    rotation: float = Field(0.0, ge=0, le=180)
    """largest angle by which a tile is turned, degrees; 180 for textures that have no direction"""
    contrast: float = Field(0.6, ge=0, le=1)
    """how much lightness decides which tile is seen, 0..1"""
    exponent: float = Field(7.0, ge=1, le=16)
    """how narrow the zones are in which tiles are blended"""


@dataclasses.dataclass(frozen=True)
class HexShaders:
    """Source text, of the texture itself: no other pictures are needed."""

    glsl: Glsl
    """a function `hexTiled`, which returns all maps"""
    hlsl: Hlsl
    """the same, and an entry for Unity's Shader Graph, see there for Unreal's Custom node"""
    godot: GodotShader
    """a spatial shader of Godot 4"""
    osl: Osl
    """a shader with an output for each map"""
    layout: dict[str, Any]
    """`size` (width, height, px), `spacing` (px), `rotation` (degrees), `contrast`, `exponent`, `levels`"""


@stage(version=1)
def hex_shaders(image: Image, params: HexShadersParams) -> HexShaders:
    """Write shaders that lay a texture in hexagonal tiles, shifted and turned at random, blended by lightness.

    Normals are blended as slopes, turned back in turned tiles. One set of weights, from colour, serves all maps, so
    that they fit to each other; [Mikkelsen2022]_ weighs normals by their own.

    Parameters
    ----------
    image : continues across its borders; maps other than colour may follow.

    Raises
    ------
    InputError
        it does not continue across its borders, or a map has more than four channels.

    References
    ----------
    [Mikkelsen2022]_.
    """
    check_continues(image)
    spacing = params.tile * min(image.height, image.width)
    layout = {
        "size": [image.width, image.height], "spacing": spacing,
        "rotation": params.rotation, "contrast": params.contrast, "exponent": params.exponent,
        "levels": max(image.height, image.width).bit_length(),
    }  # fmt: skip
    color = " + ".join(f"{share} * color.{axis}" for share, axis in zip(LUMINANCE, "xyz", strict=True))
    values = {
        "maps": shader_maps(image), "size": layout["size"], "levels": layout["levels"], "spacing": number(spacing),
        "rotation": number(float(np.deg2rad(params.rotation))), "contrast": number(params.contrast),
        "exponent": number(params.exponent), "flattest": number(FLATTEST),
        "luminance": "color.x" if image.channels[0] == "Y" else color,
        "down": number(3**0.5 / 2), "across": number(3**-0.5), "twice": number(2 * 3**-0.5),
        "weights": LUMINANCE,
    }  # fmt: skip
    return HexShaders(*shader_texts(__file__, values), layout)
