"""MaterialX documents that bind the maps of a material to a surface shader."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np

from texloom.pipelines.media.color_spaces import ACESCG
from texloom.pipelines.media.conventions import COLORS
from texloom.pipelines.media.relief import UNIT_RELIEF, Relief
from texloom.stages.vocabulary.facts import TORUS, Wraps

if TYPE_CHECKING:
    from xml.etree.ElementTree import Element

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
_BLEND = "2"  # alpha_mode
_VERSION = "1.39"  # of MaterialX, in which the nodes below are defined


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
    from xml.etree.ElementTree import Element, indent, tostring

    name = identifier(name)
    made = Element("materialx", version=_VERSION, colorspace="lin_rec709")
    node = _node(made, shader, f"{name}_shader", "surfaceshader")
    _set(node, "metallic" if shader == "gltf_pbr" else "metalness", 0.0)
    material = _node(made, "surfacematerial", name, "material")
    _connect(material, "surfaceshader", node)
    for one in maps:
        if one.role not in (*_INPUTS[shader], "normal", "height"):
            continue
        linear = "acescg" if color_space == ACESCG else "lin_rec709"
        image = (
            _hex_tiled(made, name, one, linear) if is_hex_tiled else _image(made, name, one, size, linear, wraps)
        )
        if one.role == "normal" and is_hex_tiled:
            _connect(node, "normal", image)
        elif one.role == "normal":
            normal = _node(made, "normalmap", f"{name}_normals", "vector3")
            _connect(normal, "in", image)
            _set(normal, "scale", (1.0, -1.0 if one.directx else 1.0))
            _connect(node, "normal", normal)
        elif one.role == "height":
            displacement = _node(made, "displacement", f"{name}_displacement", "displacementshader")
            scale, offset = one.relief.displacement(width or (size[1] if size else 1.0))
            if offset:
                shifted = _node(made, "add", f"{name}_height_offset", "float")
                _connect(shifted, "in1", image)
                _set(shifted, "in2", offset / scale)
                image = shifted
            _connect(displacement, "displacement", image)
            _set(displacement, "scale", scale)
            _connect(material, "displacementshader", displacement)
        else:
            _connect_map(made, name, node, one, image, shader)
    indent(made)
    return f'<?xml version="1.0"?>\n{tostring(made, encoding="unicode")}\n'


def _node(made: Element, category: str, name: str, kind: str) -> Element:
    """A new node of the document ``made``, whose output is of the type ``kind``."""
    from xml.etree.ElementTree import SubElement

    return SubElement(made, category, name=name, type=kind)


def _set(node: Element, name: str, value: float | bool | tuple[float, float]) -> Element:
    """Give an input of a node a value."""
    if isinstance(value, bool):
        return _add_input(node, name, "boolean", value=str(value).lower())
    if isinstance(value, tuple):
        return _add_input(node, name, "vector2", value=", ".join(map(_text, value)))
    return _add_input(node, name, "float", value=_text(value))


def _text(value: float) -> str:
    return f"{np.float32(value):.6g}"  # as MaterialX itself writes floats


def _connect(node: Element, name: str, source: Element) -> None:
    """Have an input of a node take the output of the node ``source``."""
    _add_input(node, name, source.attrib["type"], nodename=source.attrib["name"])


def _add_input(node: Element, name: str, kind: str, **content: str) -> Element:
    from xml.etree.ElementTree import SubElement

    return SubElement(node, "input", {"name": name, "type": kind, **content})


def _connect_map(made: Element, name: str, node: Element, one: BoundMap, image: Element, shader: str) -> None:
    """Connect a map to the shader."""
    colored = "specular_color" if one.role == "specular" and one.planes > 1 else _INPUTS[shader][one.role]
    for preset in node.findall(f"input[@name='{colored}']"):
        node.remove(preset)
    if shader == "gltf_pbr":
        _connect(node, colored, image)
        if one.role == "opacity":
            _add_input(node, "alpha_mode", "integer", value=_BLEND)
        return
    if one.role == "opacity":  # a colour there
        grey = _node(made, "convert", f"{name}_opacity_color", "color3")
        _connect(grey, "in", image)
        image = grey
    if one.role == "emissive":
        _set(node, "emission", 1.0)
    _connect(node, colored, image)


def _image(
    made: Element, name: str, one: BoundMap, size: tuple[float, float] | None, linear: str, wraps: Wraps
) -> Element:
    kind = "vector3" if one.role == "normal" else "color3" if one.planes > 1 else "float"
    image = _node(made, "image" if size is None else "tiledimage", f"{name}_{one.role}", kind)
    file = _add_input(image, "file", "filename", value=one.file)
    if size is not None:
        for entry in ("realworldimagesize", "realworldtilesize"):
            _set(image, entry, (size[1], size[0])).attrib.update(unittype="distance", unit="meter")
    else:
        for axis, goes_on in (("u", wraps.across), ("v", wraps.down)):
            if not goes_on:
                _add_input(image, f"{axis}addressmode", "string", value="clamp")
    if kind == "color3":
        _set_color_space(file, one, linear)
    return image


def _hex_tiled(made: Element, name: str, one: BoundMap, linear: str) -> Element:
    """A node that blends a map from hexagons; all maps from the same ones."""
    if one.role == "normal":
        image = _node(made, "hextilednormalmap", f"{name}_normal", "vector3")
        _set(image, "flip_g", one.directx)
    else:
        image = _node(made, "hextiledimage", f"{name}_{one.role}", "color3")
    file = _add_input(image, "file", "filename", value=one.file)
    _set(image, "scale", 0.0)  # features keep their size
    if one.role == "normal":
        return image
    _set_color_space(file, one, linear)
    if one.planes > 1:
        return image
    plane = _node(made, "extract", f"{name}_{one.role}_plane", "float")
    _connect(plane, "in", image)
    return plane


def _set_color_space(file: Element, one: BoundMap, linear: str) -> None:
    is_linear_color = one.role in COLORS and not one.encoded
    file.set("colorspace", "srgb_texture" if one.encoded else linear if is_linear_color else "lin_rec709")
