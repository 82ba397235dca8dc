"""How strongly the guidance channel may count against colour."""

import dataclasses
from typing import Annotated

import numpy as np
from jaxtyping import Float32
from pydantic import Field

from texloom.stages.arrays import Image, Layers, ScalarMap
from texloom.stages.color import lab_from_linear
from texloom.stages.declare import Params, stage
from texloom.stages.masks import usable_pixels

STRONG, CAUTIOUS = 3.0, 1.0

_BINS = 100
_RANGES = ((0.0, 100.0), (-80.0, 80.0), (-80.0, 80.0))  # L, a, b
_PAIRS = ((0, 1), (0, 2), (1, 2))


class GuidanceWeightParams(Params):
    """Limits of the colour test; the numbers the paper leaves open are its authors' code's."""

    vicinity: float = Field(0.01, gt=0, lt=0.5)
    """how far from a feature colours are compared, as a share of the exemplar's width"""
    blur: float = Field(3.0, gt=0, le=20)
    """standard deviation of the density estimate, bins of a hundredth of a channel's range"""
    filled: float = Field(0.5, gt=0, le=1)
    """share of non-empty bins from which colours count as too varied"""
    peak: float = Field(1 / 3, gt=0, lt=1)
    """least height of a peak, as a share of the highest"""
    separation: float = Field(15.0, gt=0)
    """least distance between two peaks that are told apart, bins"""


@dataclasses.dataclass(frozen=True)
class GuidanceWeight:
    """The weight and what it was decided by."""

    weight: float
    """factor on the guidance channel's values: 3 where that is safe, else 1"""
    densities: Annotated[Float32[np.ndarray, "3 bins bins"], Layers(("La", "Lb", "ab"))]
    """densities of the colours beside features, each scaled to a highest value of 1"""
    filled: float
    """largest share of non-empty bins of the three"""
    peaks: int
    """largest number of separate peaks of the three"""


def _density(
    first: np.ndarray, second: np.ndarray, ranges: tuple[tuple[float, float], ...], blur: float
) -> np.ndarray:
    import cv2

    counts, _, _ = np.histogram2d(
        np.clip(first, *ranges[0]), np.clip(second, *ranges[1]), bins=_BINS, range=[list(pair) for pair in ranges]
    )
    reach = int(np.ceil(2 * blur))
    kernel = cv2.getGaussianKernel(2 * reach + 1, blur)
    density = cv2.sepFilter2D(counts, cv2.CV_64F, kernel, kernel, borderType=cv2.BORDER_CONSTANT)
    density[density < 1e-9 * max(density.max(), 1e-30)] = 0
    return np.asarray(density / max(density.max(), 1e-30), np.float32)


def _separate_peaks(density: np.ndarray, least: float, separation: float) -> int:
    """Number of local maxima of at least ``least``, counting those nearer than ``separation`` once."""
    import cv2

    highest = cv2.dilate(density, np.ones((3, 3), np.uint8))
    rows, columns = np.nonzero((density >= highest) & (density > least))
    order = np.argsort(-density[rows, columns], kind="stable")
    kept: list[tuple[int, int]] = []
    for row, column in zip(rows[order], columns[order], strict=True):
        if all(np.hypot(row - r, column - c) >= separation for r, c in kept):
            kept.append((row, column))
    return len(kept)


@stage(version=1)
def guidance_weight(image: Image, distance: ScalarMap, params: GuidanceWeightParams) -> GuidanceWeight:
    """Decide how strongly structure may lead, from the colours on both sides of it.

    If the colours near features, but not on them, form several groups or fill half of the colour plane, a strong
    guidance channel would blend different materials. Masked pixels do not count.

    Parameters
    ----------
    distance : signed distance to features, px; see `signed_distance`.

    References
    ----------
    [Kaspar2015]_ section 3.1, Figure 3.
    """
    near = (distance > 0) & (distance <= max(1.0, params.vicinity * image.width))
    usable = usable_pixels(image)
    if usable is not None:
        near &= usable
    densities = np.zeros((3, _BINS, _BINS), np.float32)
    if not near.any():
        return GuidanceWeight(CAUTIOUS, densities, 0.0, 0)
    lab = lab_from_linear(image.color)[near]
    filled, peaks = 0.0, 0
    for index, (one, other) in enumerate(_PAIRS):
        density = _density(lab[:, one], lab[:, other], (_RANGES[one], _RANGES[other]), params.blur)
        densities[index] = density
        filled = max(filled, float((density > 0).mean()))
        peaks = max(peaks, _separate_peaks(density, params.peak, params.separation))
    safe = filled < params.filled and peaks <= 1
    return GuidanceWeight(STRONG if safe else CAUTIOUS, densities, filled, peaks)
