"""Otsu's threshold: features from contour strength."""

import dataclasses

import numpy as np
from pydantic import Field

from texloom.stages.vocabulary.arrays import Image, Mask, ScalarMap
from texloom.stages.vocabulary.declare import Params, stage
from texloom.stages.vocabulary.masks import valid_pixels

_BINS = 256


class OtsuParams(Params):
    """How features are cleaned."""

    min_extent: float = Field(0.015, ge=0, lt=1)
    """minimum diagonal of a feature's bounding box, as a share of the image's diagonal; smaller ones are removed"""


@dataclasses.dataclass(frozen=True)
class Otsu:
    """The features."""

    structure: Mask
    """true on a feature; all false where the strength is constant"""
    threshold: float
    """strength above which a pixel belongs to a feature"""


def otsu_threshold(values: np.ndarray) -> float:
    """The threshold that maximises the variance between the classes below and above it [Otsu1979]_."""
    low, high = float(values.min()), float(values.max())
    if high <= low:
        return high
    counts, edges = np.histogram(values, bins=_BINS, range=(low, high))
    middles = (edges[:-1] + edges[1:]) / 2
    below = np.cumsum(counts)[:-1]
    above = counts.sum() - below
    sums = np.cumsum(counts * middles)
    mean_below = sums[:-1] / np.maximum(below, 1)
    mean_above = (sums[-1] - sums[:-1]) / np.maximum(above, 1)
    return float(middles[:-1][np.argmax(below * above * (mean_below - mean_above) ** 2)])


@stage(version=1)
def otsu(strength: ScalarMap, params: OtsuParams, image: Image | None = None) -> Otsu:
    """Threshold contour strength by Otsu's method, close gaps of a pixel and remove small components.

    Parameters
    ----------
    strength : contour strength, see `edges`.
    image : the exemplar; its excluded pixels neither count for the threshold nor become features.

    Raises
    ------
    InputError
        all pixels of ``image`` are excluded.

    References
    ----------
    [Kaspar2015]_ section 3.1; [Otsu1979]_. The cleaning is ours: the paper's detector needs none.
    """
    import cv2

    valid = None if image is None else valid_pixels(image)
    threshold = otsu_threshold(strength if valid is None else strength[valid])
    structure = (strength > threshold).astype(np.uint8)
    if valid is not None:
        structure[~valid] = 0
    structure = cv2.morphologyEx(structure, cv2.MORPH_CLOSE, np.ones((3, 3), np.uint8))
    min_extent = params.min_extent * float(np.hypot(*structure.shape))
    _, labels, boxes, _ = cv2.connectedComponentsWithStats(structure, connectivity=8)
    keep = np.hypot(boxes[:, cv2.CC_STAT_WIDTH], boxes[:, cv2.CC_STAT_HEIGHT]) >= min_extent
    keep[0] = False  # the background
    return Otsu(keep[labels], threshold)
