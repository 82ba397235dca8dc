"""Triangles of a surface in the pixels of its texture: positions, frames and distortion anywhere on them."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from jaxtyping import Float32, Float64, Int64

from texloom.stages.kernels.core.threads import run_spans, thread_count
from texloom.stages.vocabulary.arrays import Mesh

_MIN_SINE = 1e-6  # of the angle between a triangle's images of rows and columns


def pixels_of(mesh: Mesh, size: tuple[int, int]) -> Float64[np.ndarray, "faces 3 2"]:
    """Row and column of every corner in a texture of ``size``, px; v points up."""
    height, width = size
    u, v = mesh[:, 6].astype(np.float64), mesh[:, 7].astype(np.float64)
    return np.stack([(1 - v) * height - 0.5, u * width - 0.5], axis=1).reshape(-1, 3, 2)


@dataclass(frozen=True)
class Points:
    """Places on faces."""

    position: Float64[np.ndarray, "n 3"]
    normal: Float64[np.ndarray, "n 3"]
    """of the face, of length 1"""
    texture: Float64[np.ndarray, "n 2 3"]
    """the directions down and across of the texture: orthogonal, in the face, of length 1 / scale"""
    per_pixel: Float64[np.ndarray, "n 3 2"]
    """displacement on the surface for a row and for a column of the result"""

    def __getitem__(self, which: np.ndarray | slice) -> "Points":
        return Points(self.position[which], self.normal[which], self.texture[which], self.per_pixel[which])

    @cached_property
    def to_pixels(self) -> Float64[np.ndarray, "n 3 3"]:
        """From displacements to px of the result: down, across, and along the normal in the longer side's."""
        down, across = np.moveaxis(self.per_pixel, 2, 0)
        one, two = np.cross(across, self.normal), np.cross(self.normal, down)
        area = np.einsum("ni,ni->n", one, down)[:, None]
        return np.stack([one / area, two / area, self.normal / self.lengths(1)[:, None]], axis=1)

    def lengths(self, step: int) -> Float64[np.ndarray, "*n"]:
        """World units along the longer side of a texel of ``step`` px."""
        return np.asarray(step * np.linalg.norm(self.per_pixel, axis=1).max(axis=1))


class Faces:
    """Geometry of all triangles.

    Parameters
    ----------
    mesh : with texture coordinates.
    direction : down in the texture, for each corner; projected to the surface.
    size : height and width of the result, px.
    scale : world units of a px of texture.
    """

    def __init__(
        self, mesh: Mesh, direction: Float32[np.ndarray, "corners 3"], size: tuple[int, int], scale: float
    ):
        self.size, self.scale = size, scale
        self.points = mesh[:, :3].astype(np.float64).reshape(-1, 3, 3)
        self.pixels = pixels_of(mesh, size)
        self.direction = direction.astype(np.float64).reshape(-1, 3, 3)

    @cached_property
    def per_pixel(self) -> Float64[np.ndarray, "faces 3 2"]:
        """See `Points`; not finite for a face without area in the result."""
        edges = self.points[:, 1:] - self.points[:, :1]
        (a, b), (c, d) = np.moveaxis(self.pixels[:, 1:] - self.pixels[:, :1], 0, 2)
        with np.errstate(divide="ignore", invalid="ignore"):
            determinant = a * d - b * c
            down = (edges[:, 0] * d[:, None] - edges[:, 1] * b[:, None]) / determinant[:, None]
            across = (edges[:, 1] * a[:, None] - edges[:, 0] * c[:, None]) / determinant[:, None]
        return np.stack([down, across], axis=2)

    @cached_property
    def normals(self) -> Float64[np.ndarray, "faces 3"]:
        """Of length 1; zeros where a face has no area."""
        edges = self.points[:, 1:] - self.points[:, :1]
        normal = np.cross(edges[:, 0], edges[:, 1])
        return normal / np.maximum(np.linalg.norm(normal, axis=1, keepdims=True), 1e-300)

    @cached_property
    def usable(self) -> np.ndarray:
        """Whether a face has an area, on the surface and in the result."""
        down, across = np.moveaxis(self.per_pixel, 2, 0)
        with np.errstate(invalid="ignore", over="ignore"):
            area = np.linalg.norm(np.cross(down, across), axis=1)
            most = np.linalg.norm(down, axis=1) * np.linalg.norm(across, axis=1)
            return np.asarray(np.isfinite(most) & (area > _MIN_SINE * most))

    def at(self, faces: Int64[np.ndarray, "*n"], pixels: Float64[np.ndarray, "n 2"]) -> Points:
        """What there is at rows and columns of the result, also beyond the edges of the faces that are given."""
        from texloom.stages.kernels.surface.frames import frames

        texture = np.empty((len(faces), 2, 3))
        run_spans(frames, (*self._at(faces, pixels), texture), len(faces), thread_count())
        per_pixel = self.per_pixel[faces]
        offset = np.einsum("nij,nj->ni", per_pixel, pixels - self.pixels[faces, 0])
        return Points(self.points[faces, 0] + offset, self.normals[faces], texture / self.scale, per_pixel)

    def jacobians(
        self, faces: Int64[np.ndarray, "*n"], pixels: Float64[np.ndarray, "n 2"]
    ) -> Float32[np.ndarray, "n 4"]:
        """From px of texture to px of the result, at rows and columns of the result."""
        from texloom.stages.kernels.surface.frames import jacobians

        out = np.empty((len(faces), 4), np.float32)
        run_spans(jacobians, (*self._at(faces, pixels), self.scale, out), len(faces), 4 * thread_count())
        return out

    def _at(self, faces: np.ndarray, pixels: np.ndarray) -> tuple[np.ndarray, ...]:
        """What kernels take."""
        return faces, pixels, self.pixels, self.direction, self.normals, self.per_pixel
