"""A textured mesh seen from several sides."""

import dataclasses
from typing import Literal

import numpy as np
from jaxtyping import Float32, Float64
from pydantic import Field

from texloom.stages.common.surface.mesh import along_texture, shares_at, unit_tangents
from texloom.stages.evaluation.lit_preview import LitPreviewParams, light_directions, lit
from texloom.stages.vocabulary.arrays import Image, Mesh
from texloom.stages.vocabulary.declare import stage
from texloom.stages.vocabulary.normals import NORMAL

_BACKGROUND = 0.02
_MARGIN = 0.04  # of a view around the mesh, as a share of its side


class SurfaceViewsParams(LitPreviewParams):
    """Cameras and lights."""

    lights: int = Field(1, ge=1, le=16)
    """directions that light comes from, from the upper left on clockwise; a view shows the first"""
    side: int = Field(512, ge=16, le=4096)
    """of a view, px"""
    views: int = Field(4, ge=1, le=16)
    """cameras around the mesh, at equal angles, the first in front"""
    tilt: float = Field(25.0, ge=-90, le=90)
    """of the cameras above the horizon, degrees"""
    up: Literal["x", "y", "z"] = "y"
    """the axis that points up; y in glTF"""
    samples: int = Field(2, ge=1, le=4)
    """of a pixel, in each direction"""


@dataclasses.dataclass(frozen=True)
class SurfaceViews:
    """All views in one picture."""

    image: Image
    """R G B, linear light; at most four views in a row"""


@stage(version=1)
def surface_views(mesh: Mesh, image: Image, params: SurfaceViewsParams) -> SurfaceViews:
    """Draw a mesh with its material from several sides, without a GPU.

    Parallel projection; each pixel is lit as in `lit_preview`, by a lamp that turns with the camera. Triangles are
    seen from both sides.

    Parameters
    ----------
    mesh : with normals and texture coordinates.
    image : the material in texture coordinates; for the channels that count see `lit_preview`.

    References
    ----------
    As of `lit_preview`.
    """
    light = light_directions(params.lights, params.elevation)[0]
    shown = [_view(mesh, image, 2 * np.pi * number / params.views, params, light) for number in range(params.views)]
    across = min(4, len(shown))
    shown += [np.full_like(shown[0], _BACKGROUND)] * (-len(shown) % across)
    rows = [np.concatenate(shown[first : first + across], axis=1) for first in range(0, len(shown), across)]
    return SurfaceViews(Image(np.concatenate(rows), ("R", "G", "B")))


def _axes(turn: float, tilt: float, up: int) -> Float64[np.ndarray, "3 3"]:
    """Right, up and towards the camera."""
    front, side = np.cos(turn), np.sin(turn)
    high, flat = np.sin(tilt), np.cos(tilt)
    axes = np.array([[front, 0, -side], [-high * side, flat, -high * front], [flat * side, high, flat * front]])
    return np.roll(axes, up - 1, axis=1)


def _view(
    mesh: Mesh, image: Image, turn: float, params: SurfaceViewsParams, light: Float32[np.ndarray, "3"]
) -> Float32[np.ndarray, "side side 3"]:
    from texloom.stages.kernels.core.resample import sampled
    from texloom.stages.kernels.surface.raster import draw

    axes = _axes(turn, np.deg2rad(params.tilt), "xyz".index(params.up))
    points = mesh[:, :3].astype(np.float64)
    middle = (points.min(axis=0) + points.max(axis=0)) / 2
    reach = max(float(np.linalg.norm(points - middle, axis=1).max()), 1e-300)
    side = params.side * params.samples
    seen = (points - middle) @ axes.T / reach * (0.5 - _MARGIN) * side
    corners = np.stack([side / 2 - 0.5 - seen[:, 1], side / 2 - 0.5 + seen[:, 0], -seen[:, 2]], axis=1)
    corners = corners.reshape(-1, 3, 3)
    owner, depth = np.full((side, side), -1, np.int32), np.full((side, side), np.inf, np.float32)
    draw(corners, np.arange(len(corners)), 0, 0, owner, depth)
    canvas = np.full((side, side, 3), _BACKGROUND, np.float32)
    rows, columns = np.nonzero(owner >= 0)
    if not rows.size:
        return canvas[: params.side, : params.side]
    face = owner[rows, columns]
    values = _interpolated(mesh, corners[..., :2], face, rows, columns)
    places = np.stack(
        [(1 - values[:, 4]) * image.height - 0.5, values[:, 3] * image.width - 0.5], axis=1
    )  # fmt: skip
    pixels = sampled(image.pixels, places)
    normal = _normals(mesh, face, values[:, :3], pixels, image.channels) @ axes.T
    normal *= np.where(normal[:, 2:] < 0, -1, 1)
    kept = [index for index, name in enumerate(image.channels) if name not in NORMAL]
    channels = (*(image.channels[index] for index in kept), *NORMAL)
    surface = np.concatenate([pixels[:, kept], normal.astype(np.float32)], axis=1)[None]
    canvas[rows, columns] = lit(Image(np.ascontiguousarray(surface), channels), light, params)[0]
    return canvas.reshape(params.side, params.samples, params.side, params.samples, 3).mean(axis=(1, 3))


def _interpolated(
    mesh: Mesh, corners: np.ndarray, face: np.ndarray, rows: np.ndarray, columns: np.ndarray
) -> Float64[np.ndarray, "n 5"]:
    """Normals, u and v at pixels of faces."""
    shares = shares_at(corners, face, np.stack([rows, columns], axis=1))
    return np.einsum("nk,nki->ni", shares, mesh[:, 3:8].reshape(-1, 3, 5)[face].astype(np.float64))


def _normals(
    mesh: Mesh,
    face: np.ndarray,
    normal: Float64[np.ndarray, "n 3"],
    pixels: Float32[np.ndarray, "n c"],
    channels: tuple[str, ...],
) -> Float64[np.ndarray, "n 3"]:
    """Unit normals in the world, with the material's."""
    normal = normal / np.maximum(np.linalg.norm(normal, axis=1, keepdims=True), 1e-300)
    if not set(NORMAL) <= set(channels):
        return normal
    along, mirrored = along_texture(mesh)
    right = unit_tangents(along[face, :, 0], normal)
    above = np.cross(normal, right) * mirrored[face, None]
    x, y, z = (pixels[:, channels.index(name), None].astype(np.float64) for name in NORMAL)
    bent = x * right + y * above + z * normal
    return np.asarray(bent / np.maximum(np.linalg.norm(bent, axis=1, keepdims=True), 1e-300))
