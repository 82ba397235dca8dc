"""Where the seams of a result show: the more the pieces differ there, and the smoother both are."""

import numpy as np
from jaxtyping import Bool, Float32, Int64

from texloom.stages.arrays import Correspondence

_SQUARE = 8  # px of the squares over which seams are summed


def slopes(features: Float32[np.ndarray, "h w c"]) -> Float32[np.ndarray, "h w"]:
    """Length of the gradient at every pixel, by its mean."""
    steps = [np.gradient(features, axis=axis) for axis in (0, 1)]
    found = np.sqrt(sum((step**2).sum(axis=2) for step in steps))
    return np.asarray(found / max(float(found.mean(dtype=np.float64)), 1e-6), np.float32)


def seam_errors(
    difference: Float32[np.ndarray, "m n c"], slope: Float32[np.ndarray, "m n"], stands: Bool[np.ndarray, "m n"]
) -> Float32[np.ndarray, "m n"]:
    """What a seam beside each pixel costs where something ``stands``; 0 elsewhere.

    That is the cube of the difference, so that a cut rather passes many small ones than one that is larger, over 1
    and the sum of both ``slope``: at an outline a seam is hidden, in a smooth place it makes one.

    References
    ----------
    [Kwatra2003]_ section 3.4, where the cost is the difference, not its cube, over the gradients alone.
    """
    squares = np.einsum("mnc,mnc->mn", difference, difference)
    return np.where(stands, squares * np.sqrt(squares) / (1 + slope), np.float32(0))


class SeamMap:
    """What the seams of a result cost, in small squares.

    Parameters
    ----------
    features : what the exemplar is compared by, (h, w, c).
    slope : from `slopes`.
    match : for every pixel of the result where it comes from, which may change later.
    wrap : the result is a torus.
    """

    def __init__(
        self,
        features: Float32[np.ndarray, "h w c"],
        slope: Float32[np.ndarray, "h w"],
        match: Correspondence,
        wrap: bool,
    ):
        self.features, self.slope, self.match, self.wrap = features, slope, match, wrap
        self.size = np.array(match.shape[:2])
        self.prices = np.zeros(-(-self.size // _SQUARE))
        self._looked_at = np.zeros(self.prices.shape)
        self._weigh(0, len(self.prices))

    def worst(self, side: int) -> Int64[np.ndarray, "2"]:
        """Top-left pixel of a window of ``side`` px over the dearest seams; those named before count less."""
        from scipy.ndimage import uniform_filter

        around = max(1, side // 3 // _SQUARE)
        mode = "wrap" if self.wrap else "constant"
        sums = uniform_filter(self.prices / (1 + self._looked_at), around, mode=mode)
        middle = np.array(np.unravel_index(int(sums.argmax()), sums.shape)) * _SQUARE + _SQUARE // 2
        top = middle - side // 2
        top = top % self.size if self.wrap else np.clip(top, 0, self.size - side)
        self._looked_at[self._squares(top, side)] += 1
        return top

    def total(self, top: Int64[np.ndarray, "2"], side: int) -> float:
        """What the seams in a window cost, and those beside it in the same squares."""
        return float(self.prices[self._squares(top, side)].sum())

    def dearer_by(
        self, top: Int64[np.ndarray, "2"], new: Bool[np.ndarray, "m n"], source: Int64[np.ndarray, "2"]
    ) -> float:
        """What all seams would cost more with the pixels ``new`` of a window from ``source`` on in the exemplar."""
        from texloom.stages.kernels.seams.visibility import dearer_by

        known = (self.features, self.slope, self.match, self.wrap)
        return float(dearer_by(*known, int(top[0]), int(top[1]), new, int(source[0]), int(source[1])))

    def changed(self, top: Int64[np.ndarray, "2"], side: int) -> None:
        """Weigh the seams of a window again, of which ``match`` has changed."""
        rows = int(top[0]) - 1 + np.arange(side + 1)
        rows = rows % self.size[0] if self.wrap else rows[rows >= 0]
        for square in np.unique(rows // _SQUARE):
            self._weigh(int(square), int(square) + 1)

    def _weigh(self, first: int, last: int) -> None:
        from texloom.stages.kernels.seams.visibility import seam_prices

        known = (self.features, self.slope, self.match, self.wrap)
        seam_prices(*known, _SQUARE, first, last, self.prices)

    def _squares(self, top: Int64[np.ndarray, "2"], side: int) -> tuple[np.ndarray, ...]:
        lines = [(first + np.arange(side)) % length for first, length in zip(top, self.size, strict=True)]
        return np.ix_(*(np.unique(line // _SQUARE) for line in lines))
