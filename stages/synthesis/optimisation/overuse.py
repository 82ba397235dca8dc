"""A price on regions of an exemplar that a result shows more often than others."""

import numpy as np
from jaxtyping import Float32, Float64, Int32, Int64, UInt8

from texloom.stages.synthesis.optimisation.allowed import Allowed

_CELLS = 60  # of a grid over the exemplar, along a side
_REGION = 5  # cells along a region: a twelfth of the side
_RISE = 0.05  # of the mean distance, for a region that is used once more than is fair than it may be
_FALL = 0.5  # of that, where use is less
_MOST = 0.5  # of the mean distance
_MOST_IN_LATTICE = 0.25  # the same, as regularity suffers
_LEAST_COPIES = 1.5  # which no region has to answer for: a small result shows what it shows
_SHARES = 1024  # steps of expected use, so that sums are exact


class Overuse:
    """Multipliers of an augmented Lagrangian: the price of a region rises while it is used too often, else falls.

    A fixed occurrence penalty is small beside the distances of coarse scales, at which a result decides how often
    it shows what. What is used little is not made cheaper: it fits badly, and costs more in joints than it gives.
    In a lattice only prices of patches of the same phase are compared, so that no other phase becomes cheaper.
    Not in the paper.

    Parameters
    ----------
    places : exemplar patches down and across.
    most_use : that a region may have, relative to its fair share.
    allowed : the permitted patches; none for all.
    expected : use of each patch that is wanted, relative to even use; none for even use of all.
    parts : numbers of the parts of lattice cells in which patches lie, below 255; none without a lattice.
    """

    def __init__(
        self,
        places: tuple[int, int],
        most_use: float,
        allowed: Allowed | None,
        expected: Float32[np.ndarray, "p q"] | None,
        parts: UInt8[np.ndarray, "p q"] | None = None,
    ):
        from texloom.stages.kernels.patchmatch.search import find_parts

        self.side = -(-places[0] // _CELLS), -(-places[1] // _CELLS)
        """height and width of a cell of the grid, px"""
        self.cells = -(-places[0] // self.side[0]), -(-places[1] // self.side[1])
        usable = np.ones(places, bool) if allowed is None else allowed.places
        own = usable.astype(np.int32)
        wanted = own if expected is None else np.rint(own * expected * _SHARES).astype(np.int32)
        fair = self._of_cells(wanted)
        self.whole = float(fair.sum())
        self.fair, self.area = _of_regions(fair), _of_regions(self._of_cells(own))
        self.most_use = most_use
        self.parts: UInt8[np.ndarray, "p q"] | None = None
        """with one more for patches that are not permitted"""
        if parts is not None:
            self.parts = np.where(usable, parts, parts.max() + np.uint8(1))
            self.found = np.zeros((*self.cells, int(self.parts.max()) + 1), bool)
            find_parts(self.parts, self.side, self.found)
        self.prices = np.zeros(self.fair.shape)
        """of each cell, relative to the mean distance"""
        self.distance = 0.0

    def adjust(self, counts: Int32[np.ndarray, "p q"], distance: float) -> None:
        """Adjust the prices to how often each patch is a match.

        ``distance`` is how much patches differ from their matches on average, CIELAB units squared.
        """
        used = self._of_cells(counts)
        fair = self.fair * (float(used.sum()) / self.whole)
        limit = np.maximum(np.maximum(self.most_use * fair, _LEAST_COPIES * self.area), 1e-9)
        excess = self.most_use * (_of_regions(used) / limit - 1)
        self.prices += _RISE * np.where(excess > 0, excess, _FALL * excess)
        np.clip(self.prices, 0, _MOST if self.parts is None else _MOST_IN_LATTICE, out=self.prices)
        self.distance = distance

    def charge(self, penalty: Float32[np.ndarray, "p q"], unit: int) -> None:
        """Add the price of each patch to ``penalty``: whole numbers, ``unit`` parts of CIELAB units squared."""
        from texloom.stages.kernels.patchmatch.search import add_prices

        prices = np.rint(self.prices * (self.distance * unit)).astype(np.float32)
        least = np.zeros(1, np.float32)
        if self.parts is not None:
            least = np.where(self.found, prices[..., None], np.float32(np.inf)).min(axis=(0, 1))
        add_prices(prices, self.side, self.parts, least, least.min(), penalty)

    def _of_cells(self, values: Int32[np.ndarray, "p q"]) -> Int64[np.ndarray, "rows columns"]:
        """Sums over each cell of the grid."""
        from texloom.stages.kernels.patchmatch.search import sums_of_cells

        sums = np.empty(self.cells, np.int64)
        sums_of_cells(values, self.side, sums)
        return sums


def _of_regions(cells: Int64[np.ndarray, "rows columns"]) -> Float64[np.ndarray, "rows columns"]:
    """Sums over the region around each cell of the grid, as far as it is inside; whole, so in any order."""
    import cv2

    border = cv2.BORDER_CONSTANT
    sums = cv2.boxFilter(cells.astype(np.float64), -1, (_REGION, _REGION), normalize=False, borderType=border)
    return np.asarray(sums)
