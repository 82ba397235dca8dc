"""Charts: a mesh with texture coordinates in which every place belongs to one face."""

import colorsys
import dataclasses
import importlib.util
import logging
from collections.abc import Mapping
from typing import Any, Literal

import numpy as np
from jaxtyping import Int32
from pydantic import Field

from texloom.stages.common.surface.faces import pixels_of
from texloom.stages.common.surface.mesh import has_texture, of_faces, sound, with_normals
from texloom.stages.common.surface.unwrap import UnwrapError, unwrapped
from texloom.stages.common.surface.weld import weld
from texloom.stages.kernels.core.loading import loaded
from texloom.stages.vocabulary.arrays import Image, Mesh
from texloom.stages.vocabulary.declare import InputError, Params, stage
from texloom.stages.vocabulary.sizes import Size

_LOG = logging.getLogger(__name__)

_MAX_OVERLAP = 0.01  # share of the covered pixels that several faces may claim
_DRAWN_SIDE = 1024  # px, of the pictures of charts and of their overlaps
_MAX_UNWRAPPED = 500_000  # faces; with more xatlas takes many minutes, and may fail
_SLACK = 1e-4  # of texture coordinates beyond 0..1


class SurfaceChartsParams(Params):
    """Size of the texture, and whose texture coordinates it has."""

    size: Size = Field((1024, 1024), validate_default=True)
    """size of the texture, px"""
    charts: Literal["auto", "own", "new"] = "auto"
    """own: the mesh's texture coordinates; new: computed by xatlas; auto: its own where each place of the texture
    belongs to one face"""


@dataclasses.dataclass(frozen=True)
class SurfaceCharts:
    """The mesh in its texture."""

    mesh: Mesh
    """the faces that have an area, with texture coordinates in 0..1 and unit normals"""
    chart: Int32[np.ndarray, "*faces"]
    """number of each face's chart; the faces of a chart are connected in the texture"""
    height: int
    """of the texture, px"""
    width: int
    """of the texture, px"""
    layout: Image
    """the charts in the texture, each in a colour; of at most 1024 px a side"""


def check_mesh(params: SurfaceChartsParams, known: Mapping[str, Any]) -> None:
    """The mesh must have faces with an area, and texture coordinates if they cannot be computed."""
    mesh = known.get("mesh")
    if isinstance(mesh, np.ndarray):
        whole = of_faces(mesh, sound(mesh))
        if not len(whole):
            raise InputError("mesh: no face has an area")
        problem = _problem(whole, params)
        if problem and params.charts == "own":
            raise InputError(f"mesh: {problem}; --set charts=new computes others")
        if (problem or params.charts == "new") and importlib.util.find_spec("xatlas") is None:
            reason = f"{problem}, and to" if problem else "to"
            raise InputError(f"mesh: {reason} compute others xatlas is needed; pip install 'texloom[mesh]'")
        if (problem or params.charts == "new") and len(whole) > 3 * _MAX_UNWRAPPED:
            reason = f"{problem}, and" if problem else "its"
            raise InputError(
                f"mesh: {reason} {len(whole) // 3} faces are too many to compute others; at most {_MAX_UNWRAPPED}"
            )


@stage(version=1, check=check_mesh)
def surface_charts(mesh: Mesh, params: SurfaceChartsParams) -> SurfaceCharts:
    """Give every place of a surface a place of its own in a texture.

    Faces without area are left out. A mesh keeps its texture coordinates if they are within 0..1 and no more than
    1 % of the texture is claimed by several faces; others are computed by xatlas, which cuts the surface into
    charts and packs them.

    Parameters
    ----------
    mesh : as read from a file.

    Raises
    ------
    InputError
        no face has an area; texture coordinates are needed and xatlas is not installed, or fails, or the mesh has
        too many faces for it.

    References
    ----------
    [LefebvreHoppe2006]_ section 5, texture atlases. xatlas follows [Levy2002]_ for charts of little distortion.
    """
    kept = sound(mesh)
    if not kept.all():
        _LOG.warning("%d of %d faces have no area or no finite place and are left out", (~kept).sum(), kept.size)
    whole = with_normals(of_faces(mesh, kept))
    problem = _problem(whole, params)
    if problem or params.charts == "new":
        if problem and has_texture(whole):
            _LOG.warning("%s; others are computed", problem)
        whole = _with_new_charts(whole, params.size)
    else:
        whole[:, 6:8] = np.clip(whole[:, 6:8], 0, 1)
    chart = _charts(whole)
    height, width = params.size
    return SurfaceCharts(whole, chart, height, width, _layout(whole, chart, params.size))


def _problem(mesh: Mesh, params: SurfaceChartsParams) -> str:
    """Why the mesh's own texture coordinates cannot be used; empty if they can."""
    if not has_texture(mesh):
        return "it has no texture coordinates"
    texture = mesh[:, 6:8]
    if texture.min() < -_SLACK or texture.max() > 1 + _SLACK:
        return "its texture coordinates are not within 0..1"
    owner, again = _drawn(mesh, params.size)
    covered = int((owner >= 0).sum())
    if not covered:
        return "its texture coordinates cover no pixel"
    if again > _MAX_OVERLAP * covered:
        return f"its texture coordinates overlap in {min(1.0, again / covered):.0%} of the texture"
    return ""


def _drawn(mesh: Mesh, size: tuple[int, int]) -> tuple[Int32[np.ndarray, "h w"], int]:
    """The face at each pixel of a texture, reduced if it is large, or -1; and how many pixels are of several."""
    from texloom.stages.kernels.surface.raster import draw

    factor = min(1.0, _DRAWN_SIDE / max(size))
    size = (max(1, round(size[0] * factor)), max(1, round(size[1] * factor)))
    pixels = pixels_of(mesh, size)
    corners = np.concatenate([pixels, np.zeros((*pixels.shape[:2], 1))], axis=2)
    owner, depth = np.full(size, -1, np.int32), np.full(size, np.inf, np.float32)
    return owner, draw(corners, np.arange(len(pixels)), 0, 0, owner, depth)


def _with_new_charts(mesh: Mesh, size: tuple[int, int]) -> Mesh:
    vertex = weld(mesh[:, :6])
    _, first = np.unique(vertex, return_index=True)
    faces = vertex.reshape(-1, 3).astype(np.uint32)
    made = mesh.copy()
    try:
        made[:, 6:8] = unwrapped(mesh[first, :3], mesh[first, 3:6], faces, max(size))
    except UnwrapError as error:
        raise InputError(f"mesh: {error}; give a mesh with texture coordinates") from None
    return made


def _charts(mesh: Mesh) -> Int32[np.ndarray, "*faces"]:
    """The connected component of each face in the texture."""
    sparse = loaded("scipy.sparse")
    csgraph = loaded("scipy.sparse.csgraph")
    corner = weld(mesh[:, [0, 1, 2, 6, 7]]).reshape(-1, 3)
    count = int(corner.max()) + 1
    begin, end = corner[:, [0, 1]].ravel(), corner[:, [1, 2]].ravel()
    graph = sparse.coo_array((np.ones(begin.size, bool), (begin, end)), shape=(count, count))
    return csgraph.connected_components(graph, directed=False)[1][corner[:, 0]].astype(np.int32)


def _layout(mesh: Mesh, chart: Int32[np.ndarray, "*faces"], size: tuple[int, int]) -> Image:
    """Hues by the golden ratio, so that neighbours differ; lighter where the surface faces up."""
    owner, _ = _drawn(mesh, size)
    hues = [colorsys.hsv_to_rgb(number * 0.618 % 1, 0.55, 0.75) for number in range(int(chart.max()) + 1)]
    light = 0.7 + 0.3 * mesh[::3, 4]
    shades = np.concatenate([np.array(hues, np.float32)[chart] * light[:, None], np.full((1, 3), 0.02, np.float32)])
    return Image(np.ascontiguousarray(shades[owner], np.float32), ("R", "G", "B"))
