"""Direction of the texture on a surface."""

import dataclasses
from typing import Literal

import numpy as np
from jaxtyping import Float32, Float64
from pydantic import Field

from texloom.stages.common.features.control import painted_values
from texloom.stages.common.geometry.orientation import angle_of, painted
from texloom.stages.common.surface.mesh import along_texture, areas, tangential, unit_tangents
from texloom.stages.common.surface.vertex_graph import VertexGraph
from texloom.stages.kernels.core.elementary_functions import cos, sin
from texloom.stages.numerics.matrices import eigenvectors
from texloom.stages.vocabulary.arrays import Image, Mesh
from texloom.stages.vocabulary.declare import Params, stage

_MIN_STEEP = 0.6  # mean length of "down" in the surface; below it the surface mostly faces up, as terrain
_MIN_ARROW = 0.05  # length of a painted vector that means something
_LEAD = 20.0  # weight of what is painted against the neighbours
_KEEP = 0.02  # weight of the field where nothing is painted
_BENT = 0.25  # curvature times the mesh's radius that leads as much as any more does
_SHARE = 0.2  # weight of a vertex's own direction against its neighbours'
_LEVEL = (
    0.05  # 1 - cosine of a surface's angle with its direction below which that leads no more than it does there
)

Up = Literal["x", "y", "z"]
"""the axis that points up; y in glTF"""


class SurfaceDirectionParams(Params):
    """Where texture points."""

    field: Literal["smooth", "curvature", "texture"] = "smooth"
    """smooth: down, or on surfaces that mostly face up along an axis, and smooth where that is undefined;
    curvature: the texture's columns run along limbs and creases, where the surface bends least, else as smooth;
    texture: down in the texture coordinates"""
    turn: float = Field(0.0, ge=-360, le=360)
    """degrees by which the texture is turned, counter-clockwise seen from outside"""
    up: Up = "y"
    """the axis that points up; y in glTF"""
    stroke_radius: float = Field(24.0, gt=0, le=4096)
    """px of the strokes' picture around a stroke within which it leads"""
    passes: int = Field(64, ge=0, le=10_000)
    """passes of smoothing, each over the distance of an edge"""


@dataclasses.dataclass(frozen=True)
class SurfaceDirection:
    """The direction field."""

    direction: Float32[np.ndarray, "corners 3"]
    """down in the texture at each corner of the mesh, of length 1 and in the surface"""


@stage(version=1)
def surface_direction(
    mesh: Mesh, params: SurfaceDirectionParams, arrows: Image | None = None, strokes: Image | None = None
) -> SurfaceDirection:
    """Choose a smooth direction for the texture at every corner of a mesh.

    The mesh's own vectors lead where it has them. What is painted leads where it is, as finely as the mesh has
    vertices. Either goes on smoothly from there.

    Parameters
    ----------
    mesh : with unit normals, and texture coordinates if anything is painted or ``field`` is ``texture``.
    arrows : painted in texture coordinates, the direction in which the texture's top lies: red right, green up, a
        half is 0; grey leads nowhere.
    strokes : lines painted in texture coordinates, on a transparent layer or on black, along which the texture's
        columns run.

    Raises
    ------
    InputError : strokes in which nothing is painted.

    References
    ----------
    [LefebvreHoppe2006]_ section 5 takes a field as given. Smoothing by means over neighbours, projected to the
    surface, is ours; the tensor of curvature is that of [Taubin1995]_.
    """
    normals, graph = mesh[:, 3:6].astype(np.float64), VertexGraph(mesh)
    if params.field == "texture":
        down = np.repeat(-along_texture(mesh)[0][..., 1], 3, axis=0)
    else:
        down = _smooth(mesh, normals, graph, params)
    down = unit_tangents(down, normals)
    if params.field == "curvature":
        along = graph.oriented(_least_bent(graph), graph.means(down))
        down = _led(graph, down, graph.at_corners(along), params.passes)
    if np.isfinite(mesh[:, 8:11]).any():
        down = _led(
            graph, down, -tangential(np.nan_to_num(mesh[:, 8:11]).astype(np.float64), normals), params.passes
        )
    if arrows is not None:
        down = _led(graph, down, -_on_surface(mesh, _arrows(arrows)), params.passes)
    if strokes is not None:
        doubled, near = painted(strokes, params.stroke_radius)
        angle = angle_of(doubled)
        along = _on_surface(mesh, np.stack([cos(angle), -sin(angle), near], axis=2))
        along *= np.where(np.einsum("ni,ni->n", along, down) < 0, -1, 1)[:, None]
        along = graph.oriented(graph.means(along), graph.means(down))
        down = _led(graph, down, graph.at_corners(along), params.passes)
    turn = np.deg2rad(params.turn)
    down = cos(turn) * down + sin(turn) * np.cross(normals, down)
    return SurfaceDirection(down.astype(np.float32))


def _smooth(
    mesh: Mesh, normals: Float64[np.ndarray, "corners 3"], graph: VertexGraph, params: SurfaceDirectionParams
) -> Float64[np.ndarray, "corners 3"]:
    """Down, or on surfaces that mostly face up along an axis; means of the neighbours where that is short."""
    weight, up = np.repeat(areas(mesh), 3), "xyz".index(params.up)
    down = tangential(np.tile(-np.eye(3)[up], (len(mesh), 1)), normals)
    if np.average(np.linalg.norm(down, axis=1), weights=weight) < _MIN_STEEP:
        down = tangential(np.tile(np.eye(3)[(up + 1) % 3], (len(mesh), 1)), normals)
    length = np.linalg.norm(down, axis=1, keepdims=True)
    given = _SHARE * down * length / np.maximum(1 - length, _LEVEL)
    return _diffused(graph, down, given, params.passes)


def _least_bent(graph: VertexGraph) -> Float64[np.ndarray, "vertices 3"]:
    """Lines along which the surface bends least, as long as it bends more across them, at most 1."""
    values, vectors = eigenvectors(graph.curvature_tensors())
    most = np.abs(values).argmax(axis=1)[:, None]
    across = np.take_along_axis(vectors, most[:, None], axis=2)[..., 0]
    bend = np.take_along_axis(values, most, axis=1)[:, 0]
    anisotropy = np.abs(2 * bend - values.sum(axis=1))
    weight = np.minimum(anisotropy * graph.radius / _BENT, 1)
    return np.asarray(np.cross(graph.normal, across) * weight[:, None])


def _arrows(picture: Image) -> Float32[np.ndarray, "H W 3"]:
    """Right, up and weight at each pixel."""
    values = 2 * painted_values(picture)[..., :2] - 1
    length = np.linalg.norm(values, axis=2, keepdims=True)
    values[length[..., 0] < _MIN_ARROW] = 0
    return np.concatenate([values / np.maximum(length, 1e-9), np.minimum(length, 1)], axis=2).astype(np.float32)


def _on_surface(mesh: Mesh, painted: Float32[np.ndarray, "H W 3"]) -> Float64[np.ndarray, "corners 3"]:
    """What is painted in texture coordinates - right, up and weight - at the corners, its length the weight."""
    height, width = painted.shape[:2]
    rows = np.clip((1 - mesh[:, 7]) * height, 0, height - 1).astype(np.int64)
    columns = np.clip(mesh[:, 6] * width, 0, width - 1).astype(np.int64)
    right, above, weight = painted[rows, columns].astype(np.float64).T[..., None]
    along = np.repeat(along_texture(mesh)[0], 3, axis=0)
    made = right / width * along[..., 0] + above / height * along[..., 1]
    return np.asarray(weight * made / np.maximum(np.linalg.norm(made, axis=1, keepdims=True), 1e-300))


def _led(
    graph: VertexGraph,
    down: Float64[np.ndarray, "corners 3"],
    wanted: Float64[np.ndarray, "corners 3"],
    passes: int,
) -> Float64[np.ndarray, "corners 3"]:
    """The field with what is wanted, whose length is its weight; elsewhere what was, less near to that."""
    given = _LEAD * wanted + _KEEP * down * (1 - np.minimum(np.linalg.norm(wanted, axis=1, keepdims=True), 1))
    return _diffused(graph, down, given, passes)


def _diffused(
    graph: VertexGraph,
    down: Float64[np.ndarray, "corners 3"],
    given: Float64[np.ndarray, "corners 3"],
    passes: int,
) -> Float64[np.ndarray, "corners 3"]:
    """Unit vectors at the vertices, each again and again what is given plus the mean over its neighbours."""
    given, down = graph.means(given), graph.means(down)
    for _ in range(passes):
        down = tangential(given + graph.smoothed(down), graph.normal)
        down /= np.maximum(np.linalg.norm(down, axis=1, keepdims=True), 1e-9)
    return graph.at_corners(down)
