"""Materials at the corners of tiles, as guides for the textures between them."""

import dataclasses

import numpy as np
from jaxtyping import Float32, Int64

from texloom.stages.analysis.control.guide import LABEL_STRENGTH, contrast
from texloom.stages.common.similarity.neighbourhoods import Rectangles, numbers_in
from texloom.stages.vocabulary.arrays import Image

_STRENGTH = 1.0  # of that of labels, which would cut elements in two


@dataclasses.dataclass(frozen=True)
class TileMaterials:
    """Which of several exemplars in one picture is wanted where."""

    exemplar: Float32[np.ndarray, "h w k"]
    """a plane for each exemplar, CIELAB units"""
    strength: np.float32
    """of a plane where its exemplar is"""

    @classmethod
    def of(cls, image: Image, rectangles: Rectangles) -> "TileMaterials":
        """Of the exemplars in ``rectangles`` of a picture."""
        strength = np.float32(_STRENGTH * LABEL_STRENGTH * contrast(image) / np.sqrt(2))
        numbers = numbers_in(rectangles, image.height, image.width)
        return cls(np.eye(len(rectangles) + 1, dtype=np.float32)[numbers][..., 1:] * strength, strength)

    def between(self, corners: Int64[np.ndarray, "m n"], tile: int) -> Float32[np.ndarray, "H W k"]:
        """The same of a torus of tiles of ``tile`` px, from the material of the upper left corner of each."""
        at = np.eye(self.exemplar.shape[2], dtype=np.float32)[corners]
        near = (np.arange(tile, dtype=np.float32) + 0.5) / tile
        for axis in (0, 1):
            following = np.roll(at, -1, axis=axis)
            along = np.moveaxis(np.stack([at, following]), axis + 1, 1)[:, :, None]
            part = near.reshape(tile, 1, 1)
            mixed = along[0] * (1 - part) + along[1] * part
            at = np.moveaxis(mixed.reshape(-1, *mixed.shape[2:]), 0, axis)
        shares = np.square(np.square(at))  # so that little lies between two materials
        return np.asarray(self.strength * shares / shares.sum(axis=2, keepdims=True), np.float32)
