"""Offset statistics: by which displacements an exemplar repeats itself."""

import dataclasses

import numpy as np
from pydantic import Field

from texloom.stages.arrays import Image, ScalarMap, Vectors
from texloom.stages.color import lab_from_linear
from texloom.stages.declare import Params, stage
from texloom.stages.masks import filled, usable_pixels

_TRIVIAL = 5.0  # px; shorter offsets are a feature matched with its own surroundings
_CELL = 5  # px; side of the cells in which lonely offsets are counted
_LONELY = 5  # offsets in a cell up to which they are noise
_SPREAD = 3.0  # px of an exemplar of 512 px; standard deviation of an offset
_LEAST_SPREAD = 1.7  # px
_CLEAR = 8  # px between a masked pixel and a feature, whose descriptor sees what lies around it


class OffsetStatisticsParams(Params):
    """Which matches count."""

    ratio: float = Field(0.5, gt=0, le=1)
    """largest distance between matched descriptors, as a share of the mean distance of all pairs"""
    features: int = Field(3000, ge=16, le=10000)
    """features kept, strongest first; time and memory grow with the square"""


@dataclasses.dataclass(frozen=True)
class OffsetStatistics:
    """Where features find each other again."""

    density: ScalarMap
    """how many matches lie at each offset, the highest is 1; offset (0, 0) is the middle, offsets reach to half the
    exemplar's sides; all 0 where nothing repeats"""
    offsets: Vectors
    """the offsets that the density was made of, px; with every offset its opposite"""


def _descriptors(image: Image, count: int) -> tuple[np.ndarray, np.ndarray]:
    """Positions (n, 2), row before column, and SIFT descriptors (n, 128), of lightness' strongest features."""
    import cv2

    lightness = np.clip(lab_from_linear(filled(image).color)[..., 0], 0, 100)
    span = float(np.ptp(lightness))
    if span < 1e-3:
        return np.zeros((0, 2), np.float32), np.zeros((0, 128), np.float32)
    # A dark exemplar has as many features as a bright one.
    stretched = np.rint((lightness - lightness.min()) * (255 / span)).astype(np.uint8)
    usable = usable_pixels(image)
    clear = None
    if usable is not None:
        side = 2 * _CLEAR + 1
        clear = cv2.erode(usable.astype(np.uint8), np.ones((side, side), np.uint8))
    found, descriptors = cv2.SIFT.create().detectAndCompute(stretched, clear)
    if descriptors is None:
        return np.zeros((0, 2), np.float32), np.zeros((0, 128), np.float32)
    strength = np.array([point.response for point in found])
    strongest = np.sort(np.argsort(-strength, kind="stable")[:count])
    places = np.array([found[index].pt[::-1] for index in strongest], np.float32)
    return places, descriptors[strongest]


def _offsets(image: Image, params: OffsetStatisticsParams) -> Vectors:
    places, descriptors = _descriptors(image, params.features)
    if len(places) < 2:
        return np.zeros((0, 2), np.float32)
    # Descriptors hold whole numbers up to 255, so these sums are exact and the same on every machine.
    lengths = (descriptors**2).sum(axis=1)
    squared = lengths[:, None] + lengths[None, :] - 2 * (descriptors @ descriptors.T)
    mean = np.sqrt(np.maximum(squared, 0)).mean(dtype=np.float64) * len(places) / (len(places) - 1)
    first, second = np.nonzero(squared < (params.ratio * mean) ** 2)
    offsets = places[second] - places[first]
    reach = np.array([image.height, image.width]) / 2
    keep = (np.hypot(*offsets.T) > _TRIVIAL) & (np.abs(offsets) < reach).all(axis=1)
    offsets = offsets[keep]
    if not len(offsets):
        return np.zeros((0, 2), np.float32)
    cells = np.rint(offsets / _CELL).astype(np.int64)
    _, cell, count = np.unique(cells, axis=0, return_inverse=True, return_counts=True)
    return np.asarray(offsets[count[cell.ravel()] > _LONELY], np.float32)


@stage(version=1)
def offset_statistics(image: Image, params: OffsetStatisticsParams) -> OffsetStatistics:
    """Match the features of an exemplar with each other and collect how far apart equal ones are.

    The paper matches each feature with its nearest neighbour; as its authors' code we take all pairs that are
    alike, which finds the far members of a lattice as often as the near ones. Features on and beside masked pixels
    are left out.

    References
    ----------
    [Kaspar2015]_ section 4.1, Figure 5; [Lowe2004]_ for the features.
    """
    import cv2

    offsets = _offsets(image, params)
    reach = np.array([image.height, image.width]) // 2
    density = np.zeros(2 * reach + 1, np.float32)
    if len(offsets):
        index = np.rint(offsets).astype(np.int64) + reach
        np.add.at(density, (index[:, 0], index[:, 1]), 1)
        spread = max(_LEAST_SPREAD, _SPREAD * min(image.height, image.width) / 512)
        side = 2 * int(np.ceil(3 * spread)) + 1
        density = cv2.GaussianBlur(density, (side, side), spread, borderType=cv2.BORDER_CONSTANT)
        density /= density.max()
    return OffsetStatistics(density, offsets)
