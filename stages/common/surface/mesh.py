"""Vertices, normals and repairs of meshes, whose triangles each have corners of their own."""

import numpy as np
from jaxtyping import Bool, Float, Float32, Float64, Int, Int64

from texloom.stages.common.surface.weld import weld
from texloom.stages.vocabulary.arrays import Mesh

_SMOOTH = 0.8  # cosine between a vertex's and a face's normal from which the face is smooth there
_MIN_TANGENT = 1e-6  # of a vector's part in the surface, as a share of its length
_MIN_AREA = 1e-12  # of a face, as a share of its longest edge squared


def areas(mesh: Mesh) -> Float64[np.ndarray, "*faces"]:
    """Of the faces, world units squared."""
    return np.asarray(np.linalg.norm(_crossed(mesh), axis=1) / 2)


def width_of(mesh: Mesh) -> float:
    """Side of a square texture on the surface, world units, by the areas of the faces there and in the texture."""
    one, two = np.moveaxis(np.diff(mesh[:, 6:8].astype(np.float64).reshape(-1, 3, 2), axis=1), 1, 0)
    in_texture = np.abs(one[:, 0] * two[:, 1] - one[:, 1] * two[:, 0]).sum() / 2
    return float(np.sqrt(areas(mesh).sum() / max(in_texture, 1e-300)))


def indexed(mesh: Mesh) -> tuple[Int64[np.ndarray, "*corners"], Int64[np.ndarray, "*vertices"]]:
    """The vertex of each corner, by position, normal and texture; and the first corner of each vertex."""
    vertex = weld(mesh[:, :8])
    return vertex, np.unique(vertex, return_index=True)[1]


def _crossed(mesh: Mesh) -> Float64[np.ndarray, "faces 3"]:
    points = mesh[:, :3].astype(np.float64).reshape(-1, 3, 3)
    return np.cross(points[:, 1] - points[:, 0], points[:, 2] - points[:, 0])


def sound(mesh: Mesh) -> Bool[np.ndarray, "*faces"]:
    """Whether faces have finite corners and an area."""
    points = mesh[:, :3].astype(np.float64).reshape(-1, 3, 3)
    finite = np.isfinite(points).all(axis=(1, 2))
    with np.errstate(invalid="ignore", over="ignore"):
        edges = ((points - np.roll(points, 1, axis=1)) ** 2).sum(axis=2).max(axis=1)
        return np.asarray(finite & (areas(mesh) > _MIN_AREA * edges))


def of_faces(mesh: Mesh, kept: Bool[np.ndarray, "*faces"]) -> Float32[np.ndarray, "rows 12"]:
    """The mesh of some faces."""
    return mesh.reshape(kept.size, -1)[kept].reshape(-1, mesh.shape[1])


def vertices(mesh: Mesh) -> Int64[np.ndarray, "*corners"]:
    """The vertex of each corner: corners at the same place are of the same."""
    return weld(mesh[:, :3])


def at_vertices(
    vertex: Int64[np.ndarray, "*corners"], values: Float[np.ndarray, "corners c"]
) -> Float64[np.ndarray, "vertices c"]:
    """Sums over the corners of each vertex."""
    return np.stack([np.bincount(vertex, plane) for plane in values.T], axis=1)


def vertex_normals(mesh: Mesh, vertex: Int64[np.ndarray, "*corners"]) -> Float64[np.ndarray, "vertices 3"]:
    """Unit means of the corners' normals, weighted by area."""
    return _unit(at_vertices(vertex, mesh[:, 3:6] * np.repeat(areas(mesh), 3)[:, None]))


def shares_at(
    corners: Float64[np.ndarray, "faces 3 2"], face: Int[np.ndarray, "*n"], places: Int[np.ndarray, "n 2"]
) -> Float64[np.ndarray, "n 3"]:
    """Barycentric coordinates of places on faces, in the coordinates of the corners."""
    first, second, third = np.moveaxis(corners[face], 1, 0)
    (a, b), (c, d), (r, s) = (second - first).T, (third - first).T, (places - first).T
    area = a * d - b * c
    one, two = (r * d - s * c) / area, (a * s - b * r) / area
    return np.stack([1 - one - two, one, two], axis=1)


def has_texture(mesh: Mesh) -> bool:
    """Whether all corners have texture coordinates."""
    return bool(np.isfinite(mesh[:, 6:8]).all())


def with_normals(mesh: Mesh) -> Mesh:
    """The mesh with unit normals: those it has, else smooth ones, but for edges between faces that differ much."""
    face = np.repeat(_crossed(mesh), 3, axis=0)
    vertex = vertices(mesh)
    flat, smooth = _unit(face), _unit(at_vertices(vertex, face)[vertex])
    made = np.where((flat * smooth).sum(axis=1, keepdims=True) >= _SMOOTH, smooth, flat)
    own = mesh[:, 3:6].astype(np.float64)
    given = np.isfinite(own).all(axis=1, keepdims=True) & (
        (flat * np.nan_to_num(own)).sum(axis=1, keepdims=True) > 0
    )
    whole = mesh.copy()
    whole[:, 3:6] = np.where(given, _unit(np.nan_to_num(own)), made)
    return whole


def _unit(vectors: Float64[np.ndarray, "n 3"]) -> Float64[np.ndarray, "n 3"]:
    return vectors / np.maximum(np.linalg.norm(vectors, axis=1, keepdims=True), 1e-300)


def along_texture(mesh: Mesh) -> tuple[Float64[np.ndarray, "faces 3 2"], Float64[np.ndarray, "*faces"]]:
    """Displacements on the faces along u and v, in proportion; and -1 for faces mirrored in the texture, else 1."""
    faces = mesh[:, :8].astype(np.float64).reshape(-1, 3, 8)
    one, two = np.moveaxis(faces[:, 1:, :3] - faces[:, :1, :3], 1, 0)
    (a, b), (c, d) = np.moveaxis(faces[:, 1:, 6:] - faces[:, :1, 6:], 0, 2)
    side = np.where(a * d < b * c, -1.0, 1.0)
    along = np.stack([one * d[:, None] - two * b[:, None], two * a[:, None] - one * c[:, None]], axis=2)
    return along * side[:, None, None], side


def unit_tangents(
    vectors: Float64[np.ndarray, "n 3"], normals: Float[np.ndarray, "n 3"]
) -> Float64[np.ndarray, "n 3"]:
    """Vectors projected to the surface, with length 1; any tangent where nothing is left of them."""
    along = tangential(vectors, normals)
    least = _MIN_TANGENT * np.linalg.norm(vectors, axis=1, keepdims=True)
    length = np.linalg.norm(along, axis=1, keepdims=True)
    axis = np.eye(3)[np.abs(normals).argmin(axis=1)]
    return np.where(length > least, along / np.maximum(length, 1e-300), _unit(tangential(axis, normals)))


def tangential(
    vectors: Float64[np.ndarray, "n 3"], normals: Float[np.ndarray, "n 3"]
) -> Float64[np.ndarray, "n 3"]:
    """Vectors without their parts along unit normals."""
    return vectors - normals * np.einsum("ni,ni->n", vectors, normals)[:, None]
