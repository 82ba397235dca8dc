"""The weight of the guidance channel relative to colour."""

import dataclasses
from typing import Annotated

import numpy as np
from jaxtyping import Float32
from pydantic import Field

from texloom.stages.common.grids.working_size import reduction
from texloom.stages.numerics.filters import filtered
from texloom.stages.vocabulary.arrays import Image, Layers, ScalarMap
from texloom.stages.vocabulary.color import lab_from_linear
from texloom.stages.vocabulary.declare import Params, stage
from texloom.stages.vocabulary.masks import valid_pixels

STRONG_WEIGHT, WEAK_WEIGHT = 3.0, 1.0

_BINS = 100
_RANGES = ((0.0, 100.0), (-80.0, 80.0), (-80.0, 80.0))  # L, a, b
_PAIRS = ((0, 1), (0, 2), (1, 2))


class GuidanceWeightParams(Params):
    """Limits of the colour test; values that the paper omits are from its authors' code."""

    vicinity: float = Field(0.01, gt=0, lt=0.5)
    """maximum distance from a feature of the compared colours, as a share of the exemplar's width"""
    blur: float = Field(3.0, gt=0, le=20)
    """standard deviation of the density estimate, bins of a hundredth of a channel's range"""
    max_fill: float = Field(0.5, gt=0, le=1)
    """share of non-empty bins from which colours are too varied for a strong weight"""
    min_peak: float = Field(1 / 3, gt=0, lt=1)
    """minimum height of a peak, as a share of the highest"""
    min_separation: float = Field(15.0, gt=0)
    """minimum distance between two separate peaks, bins"""


@dataclasses.dataclass(frozen=True)
class GuidanceWeight:
    """The weight and the measurements behind it."""

    weight: float
    """factor on the guidance channel's values: 3 where colours form a single group, else 1"""
    densities: Annotated[Float32[np.ndarray, "3 bins bins"], Layers(("La", "Lb", "ab"))]
    """densities of the colours near features, each scaled to a maximum of 1"""
    fill: float
    """largest share of non-empty bins among the three"""
    peaks: int
    """largest number of separate peaks among the three"""


def _density(
    first: np.ndarray, second: np.ndarray, ranges: tuple[tuple[float, float], ...], blur: float
) -> np.ndarray:
    """Kernel density estimate over two channels, scaled to a maximum of 1."""
    import cv2

    counts, _, _ = np.histogram2d(
        np.clip(first, *ranges[0]), np.clip(second, *ranges[1]), bins=_BINS, range=[list(pair) for pair in ranges]
    )
    reach = int(np.ceil(2 * blur))
    kernel = cv2.getGaussianKernel(2 * reach + 1, blur)
    density = filtered(counts, kernel.ravel(), kernel.ravel(), "zero")
    density[density < 1e-9 * max(density.max(), 1e-30)] = 0
    return np.asarray(density / max(density.max(), 1e-30), np.float32)


def _count_peaks(density: np.ndarray, min_height: float, min_separation: float) -> int:
    """Number of local maxima above ``min_height``; those nearer than ``min_separation`` count once."""
    import cv2

    maximum = cv2.dilate(density, np.ones((3, 3), np.uint8))
    rows, columns = np.nonzero((density >= maximum) & (density > min_height))
    order = np.argsort(-density[rows, columns], kind="stable")
    kept: list[tuple[int, int]] = []
    for row, column in zip(rows[order], columns[order], strict=True):
        if all(np.hypot(row - r, column - c) >= min_separation for r, c in kept):
            kept.append((row, column))
    return len(kept)


@stage(version=1)
def guidance_weight(image: Image, distance: ScalarMap, params: GuidanceWeightParams) -> GuidanceWeight:
    """Choose the weight of the guidance channel from the colours near features.

    If these colours form several groups or fill half of a colour plane, a strong guidance channel would blend
    different materials. Excluded pixels do not count. Of more than 1.5 million pixels, those on a grid are taken.

    Parameters
    ----------
    image : the exemplar.
    distance : signed distance to features, px, positive outside; see `signed_distance`.

    Raises
    ------
    InputError
        all pixels are excluded.

    References
    ----------
    [Kaspar2015]_ section 3.1, Figure 3.
    """
    every = reduction(image.height, image.width)
    colors, distance, valid = image.color[::every, ::every], distance[::every, ::every], valid_pixels(image)
    near = (distance > 0) & (distance <= max(1.0, params.vicinity * image.width))
    if valid is not None:
        near &= valid[::every, ::every]
    densities = np.zeros((3, _BINS, _BINS), np.float32)
    if not near.any():
        return GuidanceWeight(WEAK_WEIGHT, densities, 0.0, 0)
    lab = lab_from_linear(colors[near][:, None])[:, 0]
    fill, peaks = 0.0, 0
    for index, (first, second) in enumerate(_PAIRS):
        density = _density(lab[:, first], lab[:, second], (_RANGES[first], _RANGES[second]), params.blur)
        densities[index] = density
        fill = max(fill, float((density > 0).mean()))
        peaks = max(peaks, _count_peaks(density, params.min_peak, params.min_separation))
    single_material = fill < params.max_fill and peaks <= 1
    return GuidanceWeight(STRONG_WEIGHT if single_material else WEAK_WEIGHT, densities, fill, peaks)
