"""Tiles of a lattice: their pixels, and which of them an exemplar shows whole."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float32, Float64, Int64

from texloom.stages.numerics.matrices import inverse_of, matrix_product
from texloom.stages.synthesis.near_regular.cell_outline import CellOutline

_END = 0.2  # of a tile's length, on either side of its ends along a course: joints lie that far from them


@dataclass(frozen=True)
class Window:
    """The pixels of a tile, with a band on both sides of its outline in which it may be cut."""

    offsets: Int64[np.ndarray, "p 2"]
    """of the pixels from the tile's point of the lattice"""
    depth: Float32[np.ndarray, " p"]
    """distance of each from the outline, px; negative outside"""
    band: float
    """px on either side of the outline"""

    @classmethod
    def of(cls, outline: CellOutline, band: float) -> "Window":
        """The window of a tile."""
        import cv2

        box = _box(outline, band, 0.0)
        inside = (outline.cell_of(box.astype(np.float64)) == 0).all(axis=-1)
        signed = [
            cv2.distanceTransform(plane.astype(np.uint8), cv2.DIST_L2, cv2.DIST_MASK_PRECISE) - 0.5
            for plane in (inside, ~inside)
        ]
        depth = np.where(inside, signed[0], -signed[1]).astype(np.float32)
        kept = depth >= -band
        return cls(box[kept], depth[kept], band)

    @classmethod
    def of_course(cls, outline: CellOutline, band: float) -> "Window":
        """The window of a rectangle along courses, whose ends may be cut within `_END` of its length.

        There depths are measured in the same units, as shares of the band.
        """
        box = _box(outline, band, _END)
        position = matrix_product(box.astype(np.float64), inverse_of(outline.generators)) - np.array(outline.phase)
        across, along = np.moveaxis(np.minimum(position, 1 - position), -1, 0)
        across *= np.hypot(*outline.generators[0])
        depth = np.minimum(across, along * (band / _END)).astype(np.float32)
        kept = depth >= -band
        return cls(box[kept], depth[kept], band)


def _box(outline: CellOutline, band: float, end: float) -> Int64[np.ndarray, "h w 2"]:
    """Pixels around an outline, with a band and a share of the base on each side."""
    low, high = outline.box
    around = np.ceil(band + end * np.abs(outline.base)).astype(int) + 2
    first, last = np.floor(low).astype(int) - around, np.ceil(high).astype(int) + around
    return np.moveaxis(np.indices(last - first + 1), 0, -1) + first


def whole(
    window: Window,
    corners: Float64[np.ndarray, "n 2"],
    to_exemplar: np.ndarray,
    valid: Bool[np.ndarray, "h w"],
    spare: int,
) -> np.ndarray:
    """Which tiles lie inside the valid pixels of an exemplar, with ``spare`` px around.

    Parameters
    ----------
    corners : the tiles' points of the lattice, px.
    to_exemplar : linear map from the window's plane to the exemplar's, for row vectors.
    """
    import cv2

    offsets = matrix_product(window.offsets, to_exemplar)
    low = np.rint(corners + offsets.min(axis=0)) - spare
    high = np.rint(corners + offsets.max(axis=0)) + spare
    inside = ((low >= 0) & (high <= np.array(valid.shape) - 1)).all(axis=1)
    if valid.all():
        return np.asarray(inside)
    eroded = cv2.erode(valid.astype(np.uint8), np.ones((2 * spare + 1, 2 * spare + 1), np.uint8)) > 0
    pixels = np.rint(corners[inside][:, None] + offsets).astype(np.int64)
    inside[inside] = eroded[pixels[..., 0], pixels[..., 1]].all(axis=1)
    return np.asarray(inside)
