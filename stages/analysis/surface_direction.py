"""Direction of the texture on a surface."""

import dataclasses
from typing import Literal

import numpy as np
from jaxtyping import Float32, Float64, Int64
from pydantic import Field

from texloom.stages.arrays import Mesh
from texloom.stages.common.surface.mesh import along_texture, areas, tangential, unit_tangents, vertices
from texloom.stages.declare import Params, stage

_MIN_STEEP = 0.6  # mean length of "down" in the surface; below it the surface mostly faces up, as terrain
_SHARE = 0.2  # weight of a vertex's own direction against its neighbours', where it lies in the surface

Up = Literal["x", "y", "z"]
"""the axis that points up; y in glTF"""


class SurfaceDirectionParams(Params):
    """Where texture points."""

    field: Literal["smooth", "texture"] = "smooth"
    """smooth: down, or on surfaces that mostly face up along an axis, and smooth where that is undefined; texture:
    down in the texture coordinates"""
    turn: float = Field(0.0, ge=-360, le=360)
    """degrees by which the texture is turned, counter-clockwise seen from outside"""
    up: Up = "y"
    """the axis that points up; y in glTF"""
    passes: int = Field(64, ge=0, le=10_000)
    """passes of smoothing, each over the distance of an edge"""


@dataclasses.dataclass(frozen=True)
class SurfaceDirection:
    """The direction field."""

    direction: Float32[np.ndarray, "corners 3"]
    """down in the texture at each corner of the mesh, of length 1 and in the surface"""


@stage(version=1)
def surface_direction(mesh: Mesh, params: SurfaceDirectionParams) -> SurfaceDirection:
    """Choose a smooth direction for the texture at every corner of a mesh.

    Parameters
    ----------
    mesh : with unit normals; with texture coordinates for ``field: texture``.

    References
    ----------
    [LefebvreHoppe2006]_ section 5 takes a field as given. Smoothing by means over neighbours, projected to the
    surface, is ours.
    """
    normals = mesh[:, 3:6].astype(np.float64)
    if params.field == "texture":
        down = np.repeat(-along_texture(mesh)[0][..., 1], 3, axis=0)
    else:
        down = _smooth(mesh, normals, "xyz".index(params.up), params.passes)
    down = unit_tangents(down, normals)
    turn = np.deg2rad(params.turn)
    down = np.cos(turn) * down + np.sin(turn) * np.cross(normals, down)
    return SurfaceDirection(down.astype(np.float32))


def _smooth(
    mesh: Mesh, normals: Float64[np.ndarray, "corners 3"], up: int, passes: int
) -> Float64[np.ndarray, "corners 3"]:
    from scipy.sparse import coo_array

    vertex = vertices(mesh)
    count = int(vertex.max()) + 1
    own = _at_vertices(vertex, normals * np.repeat(areas(mesh), 3)[:, None])
    own /= np.maximum(np.linalg.norm(own, axis=1, keepdims=True), 1e-300)
    weight = np.bincount(vertex, np.repeat(areas(mesh), 3))
    down = tangential(np.tile(-np.eye(3)[up], (count, 1)), own)
    if np.average(np.linalg.norm(down, axis=1), weights=weight) < _MIN_STEEP:
        down = tangential(np.tile(np.eye(3)[(up + 1) % 3], (count, 1)), own)
    corner = vertex.reshape(-1, 3)
    begin, end = corner.ravel(), np.roll(corner, -1, axis=1).ravel()
    graph = coo_array(
        (np.ones(2 * begin.size), (np.concatenate([begin, end]), np.concatenate([end, begin]))),
        shape=(count, count),
    ).tocsr()
    degree = np.maximum(graph.sum(axis=1), 1)[:, None]
    given = _SHARE * down * np.linalg.norm(down, axis=1, keepdims=True)
    for _ in range(passes):
        down = tangential(given + graph @ down / degree, own)
        down /= np.maximum(np.linalg.norm(down, axis=1, keepdims=True), 1e-9)
    return down[vertex]


def _at_vertices(
    vertex: Int64[np.ndarray, "*corners"], values: Float64[np.ndarray, "corners 3"]
) -> Float64[np.ndarray, "vertices 3"]:
    """Sums over the corners of each vertex."""
    return np.stack([np.bincount(vertex, values[:, axis]) for axis in range(3)], axis=1)
