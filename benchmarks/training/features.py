"""Features of a structured forest: the channels of OpenCV's detector and what it reads from them.

The geometry is that of OpenCV's ``StructuredEdgeDetection``: a patch of 32 x 32 pixels around a label of 16 x 16,
every second pixel, on channels of half the resolution.
"""

from __future__ import annotations

import numpy as np
from jaxtyping import Float32, Int64, UInt8

from texloom.stages.analysis.structure.contour_channels import CHANNELS, channels_of, triangle

PATCH = 32
"""side of a patch, px"""
LABEL = 16
"""side of the predicted label at the centre of the patch, px"""
SHRINK = 2
"""pixels of the picture a side of a channel's pixel"""
CELL = PATCH // SHRINK
"""side of the patch on the channels"""
GRID = (1, 4, 8, 11, 14)
"""rows and columns of the patch on the channels where self-similarity is measured"""
DIRECT = CHANNELS * CELL * CELL
"""number of features that are values of a channel; the others are differences within a channel"""

_SPOTS = len(GRID) ** 2
_FIRST, _SECOND = np.triu_indices(_SPOTS, 1)
FEATURES = DIRECT + CHANNELS * len(_FIRST)
"""number of features"""

SMOOTHING = {"regular": 1, "similarity": 4}
"""radius of the triangle that smooths channels before features are read, px of a channel"""


class Reader:
    """Reads chosen features of any patch of one picture."""

    def __init__(self, color: UInt8[np.ndarray, "h w 3"]) -> None:
        channels = channels_of(color.astype(np.float32) / 255)
        self.width = channels.shape[1]
        self.regular = triangle(channels, SMOOTHING["regular"])
        self.similarity = triangle(channels, SMOOTHING["similarity"])

    def read(self, corners: Int64[np.ndarray, "n 2"], features: np.ndarray) -> Float32[np.ndarray, "n f"]:
        """Values of ``features`` (ascending) in the patches whose top left pixels are ``corners``, even numbers."""
        start = (corners[:, 0] // SHRINK * self.width + corners[:, 1] // SHRINK) * CHANNELS
        direct = features[features < DIRECT]
        difference = features[features >= DIRECT] - DIRECT
        plane, spot = direct // CELL**2, direct % CELL**2
        values = self.regular.ravel()[start[:, None] + self._offset(spot % CELL, spot // CELL, plane)]
        plane, pair = difference // len(_FIRST), difference % len(_FIRST)
        grid = np.array(GRID)
        both = [
            self.similarity.ravel()[
                start[:, None] + self._offset(grid[end[pair] % len(GRID)], grid[end[pair] // len(GRID)], plane)
            ]
            for end in (_FIRST, _SECOND)
        ]
        return np.concatenate([values, both[0] - both[1]], axis=1)

    def _offset(self, row: np.ndarray, column: np.ndarray, plane: np.ndarray) -> np.ndarray:
        return np.asarray((row * self.width + column) * CHANNELS + plane)
