"""Materials from what texloom exports."""

from __future__ import annotations

from collections.abc import Mapping

import bpy

from . import images
from .node_plan import COLORS, Plan, plan, relief_in, role_of
from .texloom_client import TexloomError

TEXEL_SIZE = "texloom_texel_size_mm"


def from_files(
    name: str, files: Mapping[str, bytes], uv_map: str = "", texel_size: float = 0.0
) -> tuple[bpy.types.Material, list[str]]:
    """A material of the files of the layout `blender`, and what a person is to be told."""
    pictures = {role_of(file): file for file in files if role_of(file)}
    if not pictures:
        raise TexloomError(f"the run has made no maps: {', '.join(files) or 'no files'}")
    documents = [content.decode() for file, content in files.items() if file.endswith(".usda")]
    relief = relief_in(documents[0]) if documents else None
    planned = plan(set(pictures), relief, uv_map)
    loaded = {role: images.loaded(files[file], file, role in COLORS) for role, file in pictures.items()}
    notes = [*planned.notes]
    if "height" in pictures and relief is None:
        notes.append("heights are linked to nothing, as their scale is not known")
    elif "height" in pictures:
        guess = "" if texel_size else ", a guess, as no texel size was given"
        notes.append(f"heights reach {1000 * abs(relief.scale):.3g} mm{guess}; subdivide the mesh to displace it")
    material = build(name, planned, loaded)
    if texel_size:
        material[TEXEL_SIZE] = texel_size
    return material, notes


def from_image(name: str, image: bpy.types.Image, uv_map: str = "") -> bpy.types.Material:
    """A material with a picture as its base colour."""
    return build(name, plan({"base_color"}, None, uv_map), {"base_color": image})


def build(name: str, planned: Plan, pictures: Mapping[str, bpy.types.Image]) -> bpy.types.Material:
    """A new material with the nodes of a plan."""
    material = bpy.data.materials.new(name)
    if bpy.app.version < (5, 0, 0):
        material.use_nodes = True
    material.displacement_method = planned.displacement
    tree = material.node_tree
    tree.nodes.clear()
    for label, node in planned.nodes.items():
        made = tree.nodes.new(node.kind)
        made.name, made.location = label, node.place
        for key, value in node.properties.items():
            setattr(made, key, value)
        for socket, value in node.values.items():
            made.inputs[socket].default_value = value
        if label in pictures:
            made.image, made.label = pictures[label], label
    for source, output, target, socket in planned.links:
        tree.links.new(tree.nodes[source].outputs[output], tree.nodes[target].inputs[socket])
    return material


def assign(target: bpy.types.Object, material: bpy.types.Material) -> None:
    """Give a material to all faces of an object."""
    target.data.materials.clear()
    target.data.materials.append(material)
