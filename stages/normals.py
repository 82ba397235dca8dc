"""Surface normals among an image's channels: x to the right, y up, z towards the viewer."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float32

NORMAL = ("normal.X", "normal.Y", "normal.Z")
"""the channels that hold a normal, as MaterialX and OpenGL have it: a surface that rises to the right has X < 0,
one that rises downwards has Y > 0"""


def unit(vectors: Float32[np.ndarray, "h w 3"], tolerance: float = 0.0) -> Float32[np.ndarray, "h w 3"]:
    """``vectors`` with length 1; those whose length is off by no more than ``tolerance`` stay to the bit.

    A vector without a direction becomes the normal of a flat surface.
    """
    lengths = np.sqrt(np.einsum("ijk,ijk->ij", vectors, vectors))
    wrong = np.abs(lengths - 1) > tolerance
    found = vectors.copy()
    flat = lengths < np.float32(1e-6)
    found[wrong] /= np.where(flat, np.float32(1), lengths)[wrong, None]
    found[flat] = (0, 0, 1)
    return found


def rounding(bits: int) -> float:
    """By how much the length of a unit vector may be off once its parts are stored in so many bits, -1..1."""
    return float(np.sqrt(3) / (2**bits - 1))


def with_unit_normals(
    pixels: Float32[np.ndarray, "h w c"], channels: tuple[str, ...]
) -> Float32[np.ndarray, "h w c"]:
    """``pixels``, with normals that were blended brought back to unit length.

    Copies of normals that were stored in 8 bits stay to the bit.
    """
    if not set(NORMAL) <= set(channels):
        return pixels
    found = pixels.copy()
    planes = [channels.index(name) for name in NORMAL]
    found[..., planes] = unit(found[..., planes], rounding(8))
    return found
