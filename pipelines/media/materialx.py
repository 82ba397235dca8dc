"""MaterialX documents that bind the maps of a material to a surface shader."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence
from typing import Any

from texloom.pipelines.media.color_spaces import ACESCG
from texloom.pipelines.media.conventions import COLORS
from texloom.pipelines.media.relief import UNIT_RELIEF, Relief
from texloom.stages.vocabulary.facts import TORUS, Wraps

_INPUTS: Mapping[str, Mapping[str, str]] = {
    "gltf_pbr": {
        "albedo": "base_color",
        "roughness": "roughness",
        "metallic": "metallic",
        "ao": "occlusion",
        "specular": "specular",
        "opacity": "alpha",
        "emissive": "emissive",
    },
    "standard_surface": {
        "albedo": "base_color",
        "roughness": "specular_roughness",
        "metallic": "metalness",
        "specular": "specular",
        "opacity": "opacity",
        "emissive": "emission_color",
    },
}
"""shader to the inputs of its roles"""
_BLEND = 2  # alpha_mode


@dataclasses.dataclass(frozen=True)
class BoundMap:
    """A file to bind."""

    role: str
    file: str
    """relative to the document"""
    planes: int
    """1 or 3"""
    encoded: bool
    """whether it is in sRGB"""
    directx: bool = False
    """whether green points down in a normal map"""
    relief: Relief = UNIT_RELIEF
    """what the values of a height map mean"""


def identifier(name: str) -> str:
    """The name of a material where only ASCII may stand, in USD and MaterialX: other letters by their numbers."""
    return "".join(one if one.isascii() else f"u{ord(one):04x}" for one in name)


def document(
    name: str,
    maps: Sequence[BoundMap],
    size: tuple[float, float] | None = None,
    shader: str = "gltf_pbr",
    color_space: str = "",
    is_hex_tiled: bool = False,
    width: float | None = None,
    wraps: Wraps = TORUS,
) -> str:
    """The document of a material called ``name`` as text; maps of other roles than the shader has are left out.

    Parameters
    ----------
    name : see `identifier`.
    size : height and width of the texture, m. It becomes the size of images and, as one UV unit has it, of a tile.
    shader : ``gltf_pbr`` or ``standard_surface``.
    color_space : of colours that are not in sRGB, by the name of `texloom.pipelines.media.color_spaces`.
    is_hex_tiled : maps are blended from hexagons at random places and angles, so that they do not repeat; for
        textures without a direction or lattice. Not with ``size``.
    wraps : beyond borders where it does not wrap the maps show the pixels there; not with ``size``.
    width : of the texture on what it lies on, m; scales the displacement. Default: that of ``size``, or 1.
    """
    import MaterialX

    name = identifier(name)
    made = MaterialX.createDocument()
    made.setColorSpace("lin_rec709")
    node = made.addNode(shader, f"{name}_shader", "surfaceshader")
    node.setInputValue("metallic" if shader == "gltf_pbr" else "metalness", 0.0)
    material = made.addMaterialNode(name, node)
    for one in maps:
        if one.role not in (*_INPUTS[shader], "normal", "height"):
            continue
        linear = "acescg" if color_space == ACESCG else "lin_rec709"
        image = (
            _hex_tiled(made, name, one, linear) if is_hex_tiled else _image(made, name, one, size, linear, wraps)
        )
        if one.role == "normal" and is_hex_tiled:
            node.setConnectedNode("normal", image)
        elif one.role == "normal":
            normal = made.addNode("normalmap", f"{name}_normals", "vector3")
            normal.setConnectedNode("in", image)
            normal.setInputValue("scale", MaterialX.Vector2(1.0, -1.0 if one.directx else 1.0))
            node.setConnectedNode("normal", normal)
        elif one.role == "height":
            displacement = made.addNode("displacement", f"{name}_displacement", "displacementshader")
            scale, offset = one.relief.displacement(width or (size[1] if size else 1.0))
            if offset:
                shifted = made.addNode("add", f"{name}_height_offset", "float")
                shifted.setConnectedNode("in1", image)
                shifted.setInputValue("in2", offset / scale)
                image = shifted
            displacement.setConnectedNode("displacement", image)
            displacement.setInputValue("scale", scale)
            material.setConnectedNode("displacementshader", displacement)
        else:
            _connect(made, name, node, one, image, shader)
    return str(MaterialX.writeToXmlString(made))


def _connect(made: Any, name: str, node: Any, one: BoundMap, image: Any, shader: str) -> None:
    """Connect a map to the shader."""
    colored = "specular_color" if one.role == "specular" and one.planes > 1 else _INPUTS[shader][one.role]
    node.removeInput(colored)
    if shader == "gltf_pbr":
        node.setConnectedNode(colored, image)
        if one.role == "opacity":
            node.setInputValue("alpha_mode", _BLEND)
        return
    if one.role == "opacity":  # a colour there
        grey = made.addNode("convert", f"{name}_opacity_color", "color3")
        grey.setConnectedNode("in", image)
        image = grey
    if one.role == "emissive":
        node.setInputValue("emission", 1.0)
    node.setConnectedNode(colored, image)


def _image(made: Any, name: str, one: BoundMap, size: tuple[float, float] | None, linear: str, wraps: Wraps) -> Any:
    import MaterialX

    kind = "vector3" if one.role == "normal" else "color3" if one.planes > 1 else "float"
    image = made.addNode("image" if size is None else "tiledimage", f"{name}_{one.role}", kind)
    image.setInputValue("file", one.file, "filename")
    if size is not None:
        for entry in ("realworldimagesize", "realworldtilesize"):
            image.setInputValue(entry, MaterialX.Vector2(size[1], size[0]))
            image.getInput(entry).setUnitType("distance")
            image.getInput(entry).setUnit("meter")
    else:
        for axis, goes_on in (("u", wraps.across), ("v", wraps.down)):
            if not goes_on:
                image.setInputValue(f"{axis}addressmode", "clamp")
    if kind == "color3":
        _set_color_space(image, one, linear)
    return image


def _hex_tiled(made: Any, name: str, one: BoundMap, linear: str) -> Any:
    """A node that blends a map from hexagons; all maps from the same ones."""
    if one.role == "normal":
        image = made.addNode("hextilednormalmap", f"{name}_normal", "vector3")
        image.setInputValue("flip_g", one.directx)
    else:
        image = made.addNode("hextiledimage", f"{name}_{one.role}", "color3")
    image.setInputValue("file", one.file, "filename")
    image.setInputValue("scale", 0.0)  # features keep their size
    if one.role == "normal":
        return image
    _set_color_space(image, one, linear)
    if one.planes > 1:
        return image
    plane = made.addNode("extract", f"{name}_{one.role}_plane", "float")
    plane.setConnectedNode("in", image)
    return plane


def _set_color_space(image: Any, one: BoundMap, linear: str) -> None:
    is_linear_color = one.role in COLORS and not one.encoded
    space = "srgb_texture" if one.encoded else linear if is_linear_color else "lin_rec709"
    image.getInput("file").setColorSpace(space)
