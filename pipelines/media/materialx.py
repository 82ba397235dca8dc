"""MaterialX documents that bind the maps of a material to a glTF surface shader."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from typing import Any

_DISPLACEMENT = 0.05  # of the texture's side from black to white; no map tells it
_INPUTS = {
    "albedo": "base_color",
    "roughness": "roughness",
    "metallic": "metallic",
    "ao": "occlusion",
    "specular": "specular",
    "opacity": "alpha",
    "emissive": "emissive",
}
"""role to the shader's input"""
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


def document(name: str, maps: Sequence[BoundMap]) -> str:
    """The document of a material called ``name``, as text; maps of other roles than the shader has are left out."""
    import MaterialX

    made = MaterialX.createDocument()
    made.setColorSpace("lin_rec709")
    shader = made.addNode("gltf_pbr", f"{name}_shader", "surfaceshader")
    shader.setInputValue("metallic", 0.0)
    material = made.addMaterialNode(name, shader)
    for one in maps:
        image = _image(made, name, one)
        if one.role == "normal":
            normal = made.addNode("normalmap", f"{name}_normals", "vector3")
            normal.setConnectedNode("in", image)
            normal.setInputValue("scale", MaterialX.Vector2(1.0, -1.0 if one.directx else 1.0))
            shader.setConnectedNode("normal", normal)
        elif one.role == "height":
            displacement = made.addNode("displacement", f"{name}_displacement", "displacementshader")
            displacement.setConnectedNode("displacement", image)
            displacement.setInputValue("scale", _DISPLACEMENT)
            material.setConnectedNode("displacementshader", displacement)
        elif one.role in _INPUTS:
            colored = "specular_color" if one.role == "specular" and one.planes > 1 else _INPUTS[one.role]
            shader.removeInput(colored)
            shader.setConnectedNode(colored, image)
            if one.role == "opacity":
                shader.setInputValue("alpha_mode", _BLEND)
    return str(MaterialX.writeToXmlString(made))


def _image(made: Any, name: str, one: BoundMap) -> Any:
    kind = "vector3" if one.role == "normal" else "color3" if one.planes > 1 else "float"
    image = made.addNode("image", f"{name}_{one.role}", kind)
    image.setInputValue("file", one.file, "filename")
    if kind == "color3":
        image.getInput("file").setColorSpace("srgb_texture" if one.encoded else "lin_rec709")
    return image
