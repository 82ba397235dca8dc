"""A guide for blocks: how far what lies at each place of an exemplar is from what is wanted."""

import numpy as np
from jaxtyping import Float32, Int32

from texloom.stages.kernels.core.threads import run_spans
from texloom.stages.numerics.filters import padded
from texloom.stages.synthesis.stitching.overlap import Errors
from texloom.stages.vocabulary.facts import Wraps

_PIECES = 4  # of work that threads share
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
        *means, self.squares = (_block_means(plane, block) for plane in planes)
        self.means = np.stack(means)
        beyond = [padded(plane, block, wrap.modes("edge")) for plane in np.moveaxis(wanted, 2, 0)]
        inside = [plane[block:, block:] for plane in beyond]
        planes = [*inside, np.sum([plane**2 for plane in inside], axis=0)]
        *wanted_means, self.wanted_squares = (_block_means(plane, block) for plane in planes)
        self.wanted = np.stack(wanted_means)

    def add_to(self, errors: Errors, corner: Int32[np.ndarray, "2"]) -> None:
        """Add the squared difference at every place, in the units of `OverlapSearch`, of means over a block."""
        from texloom.stages.kernels.seams.guide_difference import add_guide_difference

        row, column = corner
        wanted, square = np.ascontiguousarray(self.wanted[:, row, column]), self.wanted_squares[row, column]
        given = (self.means, self.squares, wanted, square, _UNITS, errors)
        run_spans(add_guide_difference, given, len(errors), _PIECES)


def _block_means(plane: np.ndarray, block: int) -> np.ndarray:
    """Means over the block at every place where a whole one fits."""
    import cv2

    sums = cv2.integral(np.ascontiguousarray(plane), sdepth=cv2.CV_64F)
    whole = sums[block:, block:] - sums[:-block, block:] - sums[block:, :-block] + sums[:-block, :-block]
    return np.asarray(whole / block**2)
