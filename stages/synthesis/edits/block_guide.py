"""A guide for blocks: how far what lies at each place of an exemplar is from what is wanted."""

import numpy as np
from jaxtyping import Float32, Int32

from texloom.stages.numerics.filters import padded
from texloom.stages.synthesis.stitching.overlap import Errors
from texloom.stages.vocabulary.facts import Wraps

_UNITS = 100.0**2  # CIELAB units squared, of what counts as much as black against white


class BlockGuide:
    """Differences of guides between a block of the target and every place of the exemplar.

    Parameters
    ----------
    own, wanted : guides of exemplar and target, CIELAB units.
    block : side of a block, px.
    wrap : where the target wraps.
    """

    def __init__(
        self, own: Float32[np.ndarray, "h w k"], wanted: Float32[np.ndarray, "H W k"], block: int, wrap: Wraps
    ):
        planes = [*np.moveaxis(own, 2, 0), (own**2).sum(axis=2)]
        *self.means, self.squares = (_block_means(plane, block) for plane in planes)
        beyond = [padded(plane, block, wrap.modes("edge")) for plane in np.moveaxis(wanted, 2, 0)]
        inside = [plane[block:, block:] for plane in beyond]
        planes = [*inside, np.sum([plane**2 for plane in inside], axis=0)]
        *self.wanted, self.wanted_squares = (_block_means(plane, block) for plane in planes)

    def errors(self, corner: Int32[np.ndarray, "2"]) -> Errors:
        """Mean squared difference at every place, in the units of `OverlapSearch`, of means over a block."""
        row, column = corner
        errors = self.squares + self.wanted_squares[row, column]
        for own, wanted in zip(self.means, self.wanted, strict=True):
            errors = errors - 2 * own * wanted[row, column]
        return np.asarray(np.maximum(errors, 0) / _UNITS, np.float32)


def _block_means(plane: np.ndarray, block: int) -> np.ndarray:
    """Means over the block at every place where a whole one fits."""
    import cv2

    sums = cv2.integral(np.ascontiguousarray(plane), sdepth=cv2.CV_64F)
    whole = sums[block:, block:] - sums[:-block, block:] - sums[block:, :-block] + sums[:-block, :-block]
    return np.asarray(whole / block**2)
