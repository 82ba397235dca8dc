"""A structured forest as OpenCV's ``StructuredEdgeDetection`` defines it, which takes more time."""

import dataclasses

import numpy as np
from jaxtyping import Float32, Int32, Integer, UInt8

from texloom.stages.analysis.structure.contour_channels import CHANNELS, channels_of, triangle

_PATCH, _LABEL = 32, 16  # sides, px
_CELL = _PATCH // 2  # side of a patch on the channels
_GRID = np.array([1, 4, 8, 11, 14])  # rows and columns on the channels between which features are differences
_PAIRS = np.array(np.triu_indices(len(_GRID) ** 2, 1))
_DIRECT = CHANNELS * _CELL**2  # features that are values; those after them are differences within a channel
FEATURES = _DIRECT + CHANNELS * _PAIRS.shape[1]
"""number of what a node may compare"""
TREES = 4
"""trees that see each patch"""


@dataclasses.dataclass(frozen=True)
class Forest:
    """Trees that see patches of 32 x 32 pixels, and leaves that vote for the 16 x 16 at their centres."""

    children: Integer[np.ndarray, "trees nodes"]
    """number of the right child, 0 for a leaf; the left child comes directly before"""
    features: Integer[np.ndarray, "trees nodes"]
    """what is compared: values of the smoothed channels, then differences of more smoothed ones"""
    thresholds: Float32[np.ndarray, "trees nodes"]
    """values below go left"""
    votes: Integer[np.ndarray, "trees nodes"]
    """how many each leaf has"""
    bins: UInt8[np.ndarray, "all_votes"]
    """the pixels that they are for, column by column"""

    def detect(self, color: Float32[np.ndarray, "h w 3"]) -> Float32[np.ndarray, "h w"]:
        """Contour strength of an sRGB picture, 0..1, of at least 16 x 16 px; without responses at its border.

        References
        ----------
        [Dollar2013]_ sections 3.2 and 3.4; which trees see a patch, and their features, as in OpenCV.
        """
        import cv2

        from texloom.stages.kernels.contours.forest import add_votes

        votes = np.zeros(color.shape[:2], np.uint16)
        margin = (_PATCH - _LABEL) // 2
        odd = (side % 2 for side in color.shape[:2])
        below, right = (margin + more for more in odd)
        channels = channels_of(cv2.copyMakeBorder(color, margin, below, margin, right, cv2.BORDER_REFLECT))
        height, width = channels.shape[:2]
        smooth = np.stack([triangle(channels, radius) for radius in (1, 4)])
        row_step, patches = width * CHANNELS, (height - _CELL, width - _CELL)
        bounds = np.zeros(self.votes.size + 1, np.int32)
        np.cumsum(self.votes, out=bounds[1:])
        nodes, trees = self._nodes(row_step, channels.size), len(self.votes)
        add_votes(smooth.ravel(), row_step, CHANNELS, patches, nodes, trees, bounds, self.bins, votes)
        return triangle((votes * np.float32(2 * 2**2 / _LABEL**2 / TREES))[..., None], 1)[..., 0]

    def _nodes(self, row_step: int, size: int) -> np.ndarray:
        """The nodes as the kernel takes them, for channels of ``size`` values, ``row_step`` a row."""
        from texloom.stages.kernels.contours.forest import NODE

        def place(row: np.ndarray, column: np.ndarray, channel: np.ndarray) -> Int32[np.ndarray, "trees nodes"]:
            return (row * row_step + column * CHANNELS + channel).astype(np.int32)

        features = self.features.astype(np.int32)
        channel, spot = np.divmod(features, _CELL**2)
        direct = place(spot % _CELL, spot // _CELL, channel)
        channel, pair = np.divmod(np.maximum(features - _DIRECT, 0), _PAIRS.shape[1])
        ends = [size + place(_GRID[end[pair] % 5], _GRID[end[pair] // 5], channel) for end in _PAIRS]
        own = np.arange(features.size).reshape(features.shape)
        is_direct, is_leaf = features < _DIRECT, self.children == 0
        nodes = np.empty(features.shape, NODE)
        nodes["first"], nodes["second"] = (np.where(is_direct, direct, end) for end in ends)
        nodes["right"] = np.where(is_leaf, own + 1, own[:, :1] + self.children)
        nodes["threshold"] = np.where(is_leaf, np.float32(np.inf), self.thresholds)
        return nodes.ravel()
