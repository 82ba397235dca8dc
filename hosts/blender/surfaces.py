"""Meshes of Blender as texloom takes them, with what leads and controls the texture."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import bpy
import numpy as np
from mathutils import Vector
from mathutils.kdtree import KDTree

from .glb import glb
from .texloom_client import TexloomError

NEW_LAYER = "Texloom"
_MARGIN = 0.01  # between new charts, of the texture's side
_ANGLE = 1.15  # radians, between faces of one chart; Blender's own
_REACH = 0.05  # of the mesh's diagonal: curves that lie farther away are not on it


class Surface(NamedTuple):
    """A mesh that is sent."""

    content: bytes
    """the GLB"""
    layer: str
    """its texture coordinates"""
    new: np.ndarray | None
    """texture coordinates (loops, 2) that it does not have yet"""


def of(
    target: bpy.types.Object, *, new_coordinates: bool = False, curves: Sequence[bpy.types.Object] = (),
    direction: str = "", control: str = "",
) -> Surface:  # fmt: skip
    """The triangles of a mesh where it stands, in metres, without its modifiers."""
    mesh = target.data
    if target.mode == "EDIT":
        raise TexloomError(f"{target.name}: is being edited; leave the edit mode")
    mesh.calc_loop_triangles()
    count = len(mesh.loop_triangles)
    if not count:
        raise TexloomError(f"{target.name}: has no faces")
    if curves and direction:
        raise TexloomError("direction: curves and an attribute are chosen; take one of them")
    loops = _got(mesh.loop_triangles, "loops", 3 * count, np.int32)
    vertices = _got(mesh.loops, "vertex_index", len(mesh.loops), np.int32)[loops]
    places = _got(mesh.vertices, "co", 3 * len(mesh.vertices), np.float32).reshape(-1, 3)
    matrix = np.array(target.matrix_world, np.float32)
    turn = matrix[:3, :3]
    if np.linalg.det(turn) < 0:  # mirrored: outside stays outside
        loops, vertices = (one.reshape(-1, 3)[:, ::-1].ravel() for one in (loops, vertices))
    normals = _got(mesh.loop_triangles, "normal", 3 * count, np.float32).reshape(-1, 3)
    around = np.linalg.inv(turn.astype(np.float64)).T.astype(np.float32)
    normals = _unit(normals @ around.T).repeat(3, 0)
    points = places @ turn.T + matrix[:3, 3]
    active = mesh.uv_layers.active
    made = None
    if active is None or new_coordinates:
        made = unwrapped(mesh)
        layer, texture = NEW_LAYER, made
    else:
        layer, texture = active.name, _got(active.uv, "vector", 2 * len(mesh.loops), np.float32).reshape(-1, 2)
    leads = None
    if curves:
        leads = _along(curves, points)[vertices]
    elif direction:
        leads = _vectors(mesh, direction, loops, vertices) @ turn.T
    paint = _grey(mesh, control, loops, vertices) if control else None
    return Surface(glb(points[vertices], texture[loops], normals, leads, paint), layer, made)


def unwrapped(mesh: bpy.types.Mesh) -> np.ndarray:
    """Texture coordinates (loops, 2) of a copy by Blender's Smart UV Project; the mesh stays as it is."""
    copy = mesh.copy()
    holder = bpy.data.objects.new("texloom charts", copy)
    scene = bpy.data.scenes.new("texloom charts")
    scene.collection.objects.link(holder)
    try:
        while copy.uv_layers:
            copy.uv_layers.remove(copy.uv_layers[0])
        copy.uv_layers.new(name=NEW_LAYER)
        view = scene.view_layers[0]
        view.objects.active = holder
        holder.select_set(True, view_layer=view)
        here = {"scene": scene, "view_layer": view, "active_object": holder, "object": holder}
        with bpy.context.temp_override(**here):
            bpy.ops.object.mode_set(mode="EDIT")
        with bpy.context.temp_override(**here, edit_object=holder):
            bpy.ops.mesh.select_all(action="SELECT")
            bpy.ops.uv.smart_project(angle_limit=_ANGLE, island_margin=_MARGIN, scale_to_bounds=False)
        with bpy.context.temp_override(**here):
            bpy.ops.object.mode_set(mode="OBJECT")
        return _got(copy.uv_layers[0].uv, "vector", 2 * len(copy.loops), np.float32).reshape(-1, 2)
    finally:
        bpy.data.scenes.remove(scene)
        bpy.data.objects.remove(holder)
        bpy.data.meshes.remove(copy)


def add_layer(mesh: bpy.types.Mesh, coordinates: np.ndarray) -> None:
    """Give a mesh the texture coordinates that `of` has made, as its active ones."""
    if len(mesh.loops) != len(coordinates):
        raise TexloomError(f"{mesh.name}: was changed while the texture was made; run it again")
    layer = mesh.uv_layers.get(NEW_LAYER) or mesh.uv_layers.new(name=NEW_LAYER)
    if layer is None:
        raise TexloomError(f"{mesh.name}: has eight UV maps, which is all that it can have; remove one")
    layer.uv.foreach_set("vector", np.ascontiguousarray(coordinates, np.float32).ravel())
    layer.active = layer.active_render = True


def _got(items: object, name: str, count: int, dtype: type) -> np.ndarray:
    values = np.empty(count, dtype)
    items.foreach_get(name, values)
    return values


def _unit(vectors: np.ndarray) -> np.ndarray:
    length = np.linalg.norm(vectors, axis=-1, keepdims=True)
    return np.where(length > 0, vectors / np.where(length > 0, length, 1), 0).astype(np.float32)


def _along(curves: Sequence[bpy.types.Object], points: np.ndarray) -> np.ndarray:
    """At each vertex the direction of the curves that pass it, from their start to their end; else 0."""
    tree = KDTree(len(points))
    for number, point in enumerate(points):
        tree.insert(Vector(point), number)
    tree.balance()
    reach = _REACH * float(np.linalg.norm(np.ptp(points, axis=0)))
    sums = np.zeros((len(points), 3), np.float32)
    for curve in curves:
        starts, ends = _pieces(curve)
        met = False
        for start, end in zip(starts, ends):
            count = max(2, int(np.ceil(np.linalg.norm(end - start) / (0.2 * reach))))
            for share in np.linspace(0, 1, count):
                _, number, distance = tree.find(Vector(start + share * (end - start)))
                if distance <= reach:
                    sums[number] += end - start
                    met = True
        if not met:
            raise TexloomError(f"{curve.name}: does not lie on the mesh; draw it there, as with surface as depth")
    return _unit(sums)


def _pieces(curve: bpy.types.Object) -> tuple[np.ndarray, np.ndarray]:
    """Starts and ends of the pieces of a curve in the world, (n, 3) each."""
    drawn = curve.evaluated_get(bpy.context.evaluated_depsgraph_get())
    mesh = drawn.to_mesh()
    try:
        if mesh is None or not mesh.edges or mesh.polygons:
            raise TexloomError(f"{curve.name}: is no line; take its bevel and its extrusion away")
        matrix = np.array(curve.matrix_world, np.float32)
        places = _got(mesh.vertices, "co", 3 * len(mesh.vertices), np.float32).reshape(-1, 3)
        places = places @ matrix[:3, :3].T + matrix[:3, 3]
        edges = _got(mesh.edges, "vertices", 2 * len(mesh.edges), np.int32).reshape(-1, 2)
        return places[edges[:, 0]], places[edges[:, 1]]
    finally:
        drawn.to_mesh_clear()


def _attribute(mesh: bpy.types.Mesh, name: str, loops: np.ndarray, vertices: np.ndarray) -> tuple[np.ndarray, bool]:
    """Values of an attribute at the corners, (corners, 3), and whether they are colours, as they are seen."""
    attribute = mesh.attributes.get(name)
    if attribute is None:
        raise TexloomError(f"{name}: the mesh has no such attribute")
    fields = {"FLOAT_COLOR": ("color_srgb", 4), "BYTE_COLOR": ("color_srgb", 4), "FLOAT_VECTOR": ("vector", 3)}
    places = {"POINT": vertices, "CORNER": loops}
    if attribute.data_type not in fields or attribute.domain not in places:
        raise TexloomError(f"{name}: neither colours nor vectors of vertices or corners")
    field, channels = fields[attribute.data_type]
    values = _got(attribute.data, field, channels * len(attribute.data), np.float32).reshape(-1, channels)
    return values[places[attribute.domain]][:, :3], channels == 4


def _vectors(mesh: bpy.types.Mesh, name: str, loops: np.ndarray, vertices: np.ndarray) -> np.ndarray:
    """Directions, 0 where nothing leads: vectors as they are, of colours 0 is a half."""
    values, is_color = _attribute(mesh, name, loops, vertices)
    if not is_color:
        return values
    values = 2 * values - 1
    return np.where(np.abs(values).max(axis=1, keepdims=True) < 0.02, 0, values).astype(np.float32)


def _grey(mesh: bpy.types.Mesh, name: str, loops: np.ndarray, vertices: np.ndarray) -> np.ndarray:
    """The mean of red, green and blue, 0..1."""
    values, is_color = _attribute(mesh, name, loops, vertices)
    if not is_color:
        raise TexloomError(f"{name}: vectors cannot control; choose colours")
    return np.clip(values.mean(axis=1), 0, 1)
