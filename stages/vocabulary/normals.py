"""Surface normals among an image's channels: x to the right, y up, z towards the viewer."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float32

from texloom.stages.vocabulary.arrays import Jacobian

NORMAL = ("normal.X", "normal.Y", "normal.Z")
"""the channels of a normal in the convention of MaterialX and OpenGL: a surface that rises to the right has X < 0,
one that rises downwards has Y > 0"""

_CONSTANT = 2 / 255
_OFF = 0.1


def unit(vectors: Float32[np.ndarray, "h w 3"], tolerance: float = 0.0) -> Float32[np.ndarray, "h w 3"]:
    """``vectors`` normalised to length 1; those whose length is within ``tolerance`` of it are unchanged.

    Vectors of length 0 become the normal of a flat surface.
    """
    lengths = np.sqrt(np.einsum("ijk,ijk->ij", vectors, vectors))
    wrong = np.abs(lengths - 1) > tolerance
    normals = vectors.copy()
    flat = lengths < np.float32(1e-6)
    normals[wrong] /= np.where(flat, np.float32(1), lengths)[wrong, None]
    normals[flat] = (0, 0, 1)
    return normals


def rebuilt(vectors: Float32[np.ndarray, "h w 3"]) -> tuple[Float32[np.ndarray, "h w 3"], bool]:
    """Vectors with z from x and y where the file has none, as with two channels (BC5), and whether that is so.

    Blue is constant then, and far from what x and y leave of unit length.
    """
    z = vectors[..., 2]
    if float(np.ptp(z)) > _CONSTANT:
        return vectors, False
    left = np.sqrt(np.maximum(0, 1 - vectors[..., 0] ** 2 - vectors[..., 1] ** 2))
    if float(np.abs(left - z).max()) <= _OFF:
        return vectors, False
    whole = vectors.copy()
    whole[..., 2] = left
    return whole, True


def rounding(bits: int) -> float:
    """Largest error of a unit vector's length after its components are quantised to ``bits``, -1..1."""
    return float(np.sqrt(3) / (2**bits - 1))


def with_unit_normals(
    pixels: Float32[np.ndarray, "h w c"], channels: tuple[str, ...]
) -> Float32[np.ndarray, "h w c"]:
    """``pixels`` with blended normals normalised; copied 8-bit normals are unchanged."""
    if not set(NORMAL) <= set(channels):
        return pixels
    normalised = pixels.copy()
    planes = [channels.index(name) for name in NORMAL]
    normalised[..., planes] = unit(normalised[..., planes], rounding(8))
    return normalised


def stretched(
    pixels: Float32[np.ndarray, "h w c"], channels: tuple[str, ...], down: float, across: float
) -> Float32[np.ndarray, "h w c"]:
    """``pixels`` with the normals of a surface that is stretched by these factors, while its heights stay."""
    if not set(NORMAL) <= set(channels):
        return pixels
    pixels = pixels.copy()
    planes = [channels.index(name) for name in NORMAL]
    pixels[..., planes] = unit(pixels[..., planes] / np.array([across, down, 1], np.float32))
    return pixels


def turned(
    pixels: Float32[np.ndarray, "H W c"], channels: tuple[str, ...], jacobian: Jacobian
) -> Float32[np.ndarray, "H W c"]:
    """``pixels`` with normals turned from the texture's tangent space to that of the picture in which it lies.

    Parameters
    ----------
    jacobian : from the texture to the picture, at each pixel; where it mirrors, so do normals.
    """
    if not set(NORMAL) <= set(channels):
        return pixels
    a, b, c, d = np.moveaxis(jacobian, 2, 0)
    side = np.sign(a * d - b * c)
    length = np.hypot(a, b)
    cosine, sine = side * a / length, -side * b / length
    first, second = (channels.index(name) for name in NORMAL[:2])
    x, y = pixels[..., first], pixels[..., second]
    pixels = pixels.copy()
    pixels[..., first] = cosine * x - sine * y
    pixels[..., second] = side * (sine * x + cosine * y)
    return pixels
