"""Visibility of the seams of a result: high where the blocks differ and both are smooth."""

import numpy as np
from jaxtyping import Bool, Float32, Int64

from texloom.stages.kernels.core.loading import loaded
from texloom.stages.vocabulary.arrays import Correspondence
from texloom.stages.vocabulary.facts import Wraps
from texloom.stages.vocabulary.scratch import bands

_SQUARE = 8  # px of the squares over which seams are summed


def slopes(features: Float32[np.ndarray, "h w c"]) -> Float32[np.ndarray, "h w"]:
    """Gradient magnitude at every pixel, relative to its mean."""
    magnitude = np.concatenate([_magnitude(features, band) for band in bands(len(features))])
    return np.asarray(magnitude / max(float(magnitude.mean(dtype=np.float64)), 1e-6), np.float32)


def _magnitude(features: np.ndarray, band: slice) -> np.ndarray:
    """Gradient magnitude at a band of rows."""
    first, last = max(0, band.start - 1), band.stop + 1
    steps = [
        np.gradient(features[first:last], axis=axis)[band.start - first :][: band.stop - band.start]
        for axis in (0, 1)
    ]
    return np.asarray(np.sqrt(sum((step**2).sum(axis=2) for step in steps)))


def seam_errors(
    difference: Float32[np.ndarray, "m n c"], slope: Float32[np.ndarray, "m n"], filled: Bool[np.ndarray, "m n"]
) -> Float32[np.ndarray, "m n"]:
    """Cost of a seam at each pixel of the already synthesised region, ``filled``; 0 elsewhere.

    The cube of the difference, so that many small differences cost less than a large one, divided by 1 plus the
    ``slope`` of both sides, since seams are hidden at outlines and visible in smooth places.

    References
    ----------
    [Kwatra2003]_ section 3.4, where the cost is the difference, not its cube, over the gradients alone.
    """
    squares = np.einsum("mnc,mnc->mn", difference, difference)
    return np.where(filled, squares * np.sqrt(squares) / (1 + slope), np.float32(0))


class SeamMap:
    """Seam costs of a result, summed over small squares.

    Parameters
    ----------
    features : of the exemplar, (h, w, c).
    slope : from `slopes`.
    match : source of every pixel of the result; may be modified later, see `changed`.
    wrap : where the result wraps.
    """

    def __init__(
        self,
        features: Float32[np.ndarray, "h w c"],
        slope: Float32[np.ndarray, "h w"],
        match: Correspondence,
        wrap: Wraps,
    ):
        self.features, self.slope, self.match, self.wrap = features, slope, match, wrap
        self.size = np.array(match.shape[:2])
        self.costs = np.zeros(-(-self.size // _SQUARE))
        self._visits = np.zeros(self.costs.shape)
        self._measure(0, len(self.costs))

    def worst(self, side: int) -> Int64[np.ndarray, "2"]:
        """Top-left pixel of the window of ``side`` px with the costliest seams, divided by 1 + its visits."""
        ndimage = loaded("scipy.ndimage")
        around = max(1, side // 3 // _SQUARE)
        sums = ndimage.uniform_filter(self.costs / (1 + self._visits), around, mode=self.wrap.modes("constant"))
        middle = np.array(np.unravel_index(int(sums.argmax()), sums.shape)) * _SQUARE + _SQUARE // 2
        top = middle - side // 2
        top = np.where(self.wrap, top % self.size, np.clip(top, 0, self.size - side))
        self._visits[self._squares(top, side)] += 1
        return top

    def total(self, top: Int64[np.ndarray, "2"], side: int) -> float:
        """Cost of the seams in all squares that a window touches."""
        return float(self.costs[self._squares(top, side)].sum())

    def cost_increase(
        self, top: Int64[np.ndarray, "2"], new: Bool[np.ndarray, "m n"], source: Int64[np.ndarray, "2"]
    ) -> float:
        """Change of the total cost if the pixels ``new`` of a window were taken from the exemplar at ``source``."""
        from texloom.stages.kernels.seams.visibility import added_cost

        known = (self.features, self.slope, self.match, self.wrap)
        return float(added_cost(*known, int(top[0]), int(top[1]), new, int(source[0]), int(source[1])))

    def changed(self, top: Int64[np.ndarray, "2"], side: int) -> None:
        """Update the costs of a window in which ``match`` has changed."""
        rows = int(top[0]) - 1 + np.arange(side + 1)
        rows = rows % self.size[0] if self.wrap.down else rows[rows >= 0]
        for square in np.unique(rows // _SQUARE):
            self._measure(int(square), int(square) + 1)

    def _measure(self, first: int, last: int) -> None:
        from texloom.stages.kernels.seams.visibility import seam_costs

        known = (self.features, self.slope, self.match, self.wrap)
        seam_costs(*known, _SQUARE, first, last, self.costs)

    def _squares(self, top: Int64[np.ndarray, "2"], side: int) -> tuple[np.ndarray, ...]:
        lines = [(first + np.arange(side)) % length for first, length in zip(top, self.size, strict=True)]
        return np.ix_(*(np.unique(line // _SQUARE) for line in lines))
