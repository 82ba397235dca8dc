"""Offset statistics: the displacements between matching features of an exemplar."""

import dataclasses

import numpy as np
from pydantic import Field

from texloom.stages.analysis.regularity.density import smoothed
from texloom.stages.common.features.sift import features
from texloom.stages.common.grids.working_size import working_image
from texloom.stages.numerics.matrices import row_product
from texloom.stages.vocabulary.arrays import Image, ScalarMap, Vectors
from texloom.stages.vocabulary.color import lab_from_linear
from texloom.stages.vocabulary.declare import Params, stage
from texloom.stages.vocabulary.masks import fill_excluded, valid_pixels
from texloom.stages.vocabulary.progress import Progress, report

_MIN_OFFSET = 5.0  # px; shorter offsets match a feature with its own surroundings
_BIN_SIZE = 5  # px; side of the bins in which isolated offsets are counted
_MAX_ISOLATED = 5  # offsets in a bin up to which they are noise
_MARGIN = 8  # px between an excluded pixel and a feature, since descriptors cover the surroundings


class OffsetStatisticsParams(Params):
    """How features are matched."""

    ratio: float = Field(0.5, gt=0, le=1)
    """maximum distance between matched descriptors, as a share of the mean distance of all pairs"""
    features: int = Field(3000, ge=16, le=10000)
    """maximum number of features, strongest first; time and memory grow with its square"""


@dataclasses.dataclass(frozen=True)
class OffsetStatistics:
    """Density of the offsets between matching features."""

    density: ScalarMap
    """smoothed number of matches at each offset, scaled to a maximum of 1; offset (0, 0) is the centre and offsets
    extend to half the exemplar's sides, in px of its `working_image`; all 0 where nothing repeats"""
    offsets: Vectors
    """the offsets from which the density is estimated, px of the exemplar; every offset and its opposite"""


def _descriptors(image: Image, count: int) -> tuple[np.ndarray, np.ndarray]:
    """Positions (n, 2), row before column, and SIFT descriptors (n, 128) of the strongest features in lightness."""
    import cv2

    lightness = np.clip(lab_from_linear(fill_excluded(image).color)[..., 0], 0, 100)
    span = float(np.ptp(lightness))
    none = np.zeros((0, 2), np.float32), np.zeros((0, 128), np.float32)
    if span < 1e-3:
        return none
    # Stretched contrast gives a dark exemplar as many features as a bright one.
    stretched = np.rint((lightness - lightness.min()) * (255 / span)).astype(np.uint8)
    valid = valid_pixels(image)
    allowed = None
    if valid is not None:
        side = 2 * _MARGIN + 1
        allowed = cv2.erode(valid.astype(np.uint8), np.ones((side, side), np.uint8))
    positions, strength, descriptors = features(stretched)
    if allowed is not None:
        rows, columns = np.clip(np.rint(positions), 0, np.array(allowed.shape) - 1).astype(np.int64).T
        keep = allowed[rows, columns] > 0
        positions, strength, descriptors = positions[keep], strength[keep], descriptors[keep]
    strongest = np.sort(np.argsort(-strength, kind="stable")[:count])
    return positions[strongest], descriptors[strongest]


def _offsets(image: Image, params: OffsetStatisticsParams) -> Vectors:
    positions, descriptors = _descriptors(image, params.features)
    report(Progress(0.7))
    if len(positions) < 2:
        return np.zeros((0, 2), np.float32)
    lengths = (descriptors**2).sum(axis=1)
    squared = lengths[:, None] + lengths[None, :] - 2 * row_product(descriptors, descriptors.T)
    mean = np.sqrt(np.maximum(squared, 0)).mean(dtype=np.float64) * len(positions) / (len(positions) - 1)
    first, second = np.nonzero(squared < (params.ratio * mean) ** 2)
    offsets = positions[second] - positions[first]
    reach = np.array([image.height, image.width]) / 2
    keep = (np.hypot(*offsets.T) > _MIN_OFFSET) & (np.abs(offsets) < reach).all(axis=1)
    offsets = offsets[keep]
    bins = np.rint(offsets / _BIN_SIZE).astype(np.int64)
    _, number, count = np.unique(bins, axis=0, return_inverse=True, return_counts=True)
    return np.asarray(offsets[count[number.ravel()] > _MAX_ISOLATED], np.float32)


@stage(version=1, exemplar_bytes=300, seconds=(0.5, 0))
def offset_statistics(image: Image, params: OffsetStatisticsParams) -> OffsetStatistics:
    """Match the features of an exemplar with each other and estimate the density of their offsets.

    The paper matches each feature with its nearest neighbour. As in its authors' code, all pairs of similar
    features match, so that distant lattice points count as much as near ones. Features on or near excluded pixels
    are ignored. Of an exemplar of more than 1.5 million pixels, its `working_image` is measured.

    Parameters
    ----------
    image : the exemplar.

    Raises
    ------
    InputError
        all pixels are excluded.

    References
    ----------
    [Kaspar2015]_ section 3.3, Figure 5; [Lowe2004]_ for the features.
    """
    image, step = working_image(image)
    offsets = _offsets(image, params)
    density = _density(image, offsets)
    report(Progress(1.0))
    return OffsetStatistics(density, offsets * np.float32(step))


def offset_density(image: Image) -> ScalarMap:
    """The density of `offset_statistics` with its usual params, at the image's own size."""
    return _density(image, _offsets(image, OffsetStatisticsParams()))


def _density(image: Image, offsets: Vectors) -> ScalarMap:
    reach = np.array([image.height, image.width]) // 2
    density = np.zeros(2 * reach + 1, np.float32)
    if len(offsets):
        index = np.rint(offsets).astype(np.int64) + reach
        np.add.at(density, (index[:, 0], index[:, 1]), 1)
        density = smoothed(density, min(image.height, image.width))
    return density
