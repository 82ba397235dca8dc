"""A control map of a surface, from its geometry."""

import dataclasses
from collections.abc import Mapping
from typing import Any, Literal

import numpy as np
from jaxtyping import Float64
from pydantic import Field

from texloom.stages.common.features.control import from_painted
from texloom.stages.common.surface.faces import pixels_of
from texloom.stages.common.surface.gutters import nearest_known
from texloom.stages.common.surface.mesh import shares_at
from texloom.stages.common.surface.vertex_graph import VertexGraph
from texloom.stages.kernels.core.elementary_functions import arctan2, cos, sin
from texloom.stages.numerics.matrices import length_of, matrix_product
from texloom.stages.vocabulary.arrays import Image, Mesh
from texloom.stages.vocabulary.declare import InputError, Params, stage
from texloom.stages.vocabulary.sizes import format_size

_SIDE = 512  # px; of the pictures in which it is seen what hides a vertex
_BIAS = 2.0  # px of these pictures by which a vertex may lie behind what is seen


class SurfaceControlParams(Params):
    """What is measured."""

    geometry: Literal["up", "slope", "height", "curvature", "ao", "vertices"] | None = None
    """up: how far the surface faces up; slope: 0 where it faces up to 1 on walls; height: from the lowest to the
    highest place; curvature: creases 0, flat 0.5, ridges 1; ao: share of the light from all sides that the mesh
    does not hide itself, 0 in creases; vertices: the mesh's own values. null: the picture"""
    up: Literal["x", "y", "z"] = "y"
    """the axis that points up; y in glTF"""
    reach: float = Field(0.1, gt=0, le=10)
    """radius of a ridge whose curvature is 1, as a share of the mesh's"""
    directions: int = Field(64, ge=4, le=4096)
    """from which light comes for ao"""


@dataclasses.dataclass(frozen=True)
class SurfaceControl:
    """The control map."""

    image: Image | None
    """grey, in texture coordinates; pixels outside the charts have the nearest value. None without geometry and
    picture"""


def check_given(params: SurfaceControlParams, known: Mapping[str, Any]) -> None:
    """The exemplar's control map goes with one of the surface."""
    has_target = params.geometry is not None or "picture" in known
    if "control" in known and not has_target:
        raise InputError("control: goes with a target, a picture in texture coordinates or --set geometry=up")
    if has_target and "control" not in known:
        raise InputError("control: a target, or geometry, goes with the exemplar's control map, which is missing")


@stage(version=1, check=check_given)
def surface_control(
    mesh: Mesh,
    height: int,
    width: int,
    params: SurfaceControlParams,
    control: Image | None = None,  # noqa: ARG001, checked alone
    picture: Image | None = None,
) -> SurfaceControl:
    """Measure the geometry of a surface as a control map, or pass one on.

    Curvature is the mean, over the edges at a vertex, of the change of the normal along them. What light reaches a
    vertex is seen in pictures of the mesh from all directions.

    Parameters
    ----------
    mesh : with unit normals and texture coordinates.
    height, width : of the texture, px.
    control : the exemplar's control map; needed if a map is made.
    picture : a control map in texture coordinates, used where no geometry is named.

    Raises
    ------
    InputError : of the exemplar's and the surface's control map only one is given.

    References
    ----------
    [Wei2008]_ future work: textures that depend on geometry. The measures are ours.
    """
    if params.geometry is None:
        return SurfaceControl(picture)
    up = "xyz".index(params.up)
    if params.geometry == "up":
        values = 0.5 + 0.5 * mesh[:, 3 + up].astype(np.float64)
    elif params.geometry == "slope":
        high = np.clip(mesh[:, 3 + up].astype(np.float64), 0, 1)
        values = arctan2(np.sqrt(1 - high**2), high) / (np.pi / 2)
    elif params.geometry == "vertices":
        values = _own(mesh)
    elif params.geometry == "height":
        values = mesh[:, up].astype(np.float64)
        values = (values - values.min()) / max(float(np.ptp(values)), 1e-300)
    elif params.geometry == "curvature":
        graph = VertexGraph(mesh)
        values = graph.at_corners(np.clip(0.5 + 0.5 * params.reach * graph.radius * graph.mean_curvature(), 0, 1))
    else:
        values = _openness(mesh, params.directions)
    return SurfaceControl(_drawn(mesh, values, (height, width)))


def _own(mesh: Mesh) -> Float64[np.ndarray, "*corners"]:
    """The mesh's control; where it has none the mean."""
    values = mesh[:, 11].astype(np.float64)
    known = np.isfinite(values)
    if not known.any():
        raise InputError(
            "mesh: has no control of its own; name it _CONTROL in glTF, control in PLY, primvars:control in USD"
        )
    return np.where(known, values, values[known].mean())


def _openness(mesh: Mesh, directions: int) -> Float64[np.ndarray, "*corners"]:
    """Share of the light from all sides above the surface that reaches each corner."""
    from texloom.stages.kernels.core.threads import run_all

    graph, points = VertexGraph(mesh), mesh[:, :3].astype(np.float64)
    _, first = np.unique(graph.vertex, return_index=True)
    places = points - (points.min(axis=0) + points.max(axis=0)) / 2
    places *= (_SIDE / 2 - 2) / max(float(np.linalg.norm(places, axis=1).max()), 1e-300)
    number = np.arange(directions)
    high, turn = 1 - (2 * number + 1) / directions, number * np.pi * (3 - 5**0.5)
    towards = np.stack([np.sqrt(1 - high**2) * cos(turn), high, np.sqrt(1 - high**2) * sin(turn)], axis=1)
    lit = run_all(_lit, [(places, first, graph.normal, one) for one in towards])
    return graph.at_corners(sum(part for part, _ in lit) / np.maximum(sum(whole for _, whole in lit), 1e-9))


def _lit(places: np.ndarray, first: np.ndarray, normal: np.ndarray, towards: np.ndarray) -> tuple[Any, Any]:
    """Light from one direction at each vertex, and what it would be if nothing hid it."""
    from texloom.stages.kernels.surface.raster import draw

    right = np.cross(towards, np.eye(3)[np.abs(towards).argmin()])
    right /= length_of(right)
    axes = np.stack([np.cross(right, towards), right, -towards])
    seen = matrix_product(places, axes.T)
    seen[:, :2] += _SIDE / 2
    owner, depth = np.full((_SIDE, _SIDE), -1, np.int32), np.full((_SIDE, _SIDE), np.inf, np.float32)
    draw(seen.reshape(-1, 3, 3), np.arange(len(seen) // 3), 0, 0, owner, depth)
    cosine = np.maximum(matrix_product(normal, towards), 0)
    rows, columns = np.rint(seen[first, :2]).astype(np.int64).T
    # a slope may be hidden by itself within a pixel
    slack = _BIAS * (1 + np.sqrt(np.maximum(1 - cosine**2, 0)) / np.maximum(cosine, 0.1))
    is_seen = seen[first, 2] <= depth[rows, columns] + slack
    return cosine * is_seen, cosine


def _drawn(mesh: Mesh, values: Float64[np.ndarray, "*corners"], size: tuple[int, int]) -> Image:
    """Values of corners between them, as a picture whose painted numbers they are."""
    from texloom.stages.kernels.surface.raster import draw

    pixels = pixels_of(mesh, size)
    corners = np.concatenate([pixels, np.zeros((*pixels.shape[:2], 1))], axis=2)
    owner, depth = np.full(size, -1, np.int32), np.full(size, np.inf, np.float32)
    draw(corners, np.arange(len(pixels)), 0, 0, owner, depth)
    rows, columns = np.nonzero(owner >= 0)
    if not rows.size:
        raise InputError(f"size: no pixel of {format_size(size)} is on the surface; take a larger size")
    shares = shares_at(pixels, owner[rows, columns], np.stack([rows, columns], axis=1))
    picture = np.zeros(size)
    picture[rows, columns] = np.einsum("nk,nk->n", shares, values.reshape(-1, 3)[owner[rows, columns]])
    painted = np.clip(picture.ravel()[nearest_known(owner >= 0)], 0, 1)
    return from_painted(painted[..., None].astype(np.float32), ("Y",))
