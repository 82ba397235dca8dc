"""Otsu's threshold: contour strength becomes a mask of features."""

import dataclasses

import numpy as np
from pydantic import Field

from texloom.stages.arrays import Image, Mask, ScalarMap
from texloom.stages.declare import Params, stage
from texloom.stages.masks import usable_pixels

_BINS = 256


class OtsuParams(Params):
    """How the mask is cleaned."""

    shortest: float = Field(0.015, ge=0, lt=1)
    """features with a shorter bounding box diagonal are dropped, as a share of the picture's diagonal"""


@dataclasses.dataclass(frozen=True)
class Otsu:
    """Where the features are."""

    mask: Mask
    """true on a feature; all false where the strength is constant"""
    threshold: float
    """least strength of a feature"""


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
    """Separate features from the rest by Otsu's threshold, close gaps of a pixel and drop crumbs.

    Parameters
    ----------
    image : the exemplar, whose masked pixels neither count for the threshold nor are features; none masks nothing.

    References
    ----------
    [Kaspar2015]_ section 3.1; [Otsu1979]_. The cleaning is ours: the paper's detector leaves no crumbs.
    """
    import cv2

    usable = None if image is None else usable_pixels(image)
    threshold = otsu_threshold(strength if usable is None else strength[usable])
    mask = (strength > threshold).astype(np.uint8)
    if usable is not None:
        mask[~usable] = 0
    mask = cv2.morphologyEx(mask, cv2.MORPH_CLOSE, np.ones((3, 3), np.uint8))
    shortest = params.shortest * float(np.hypot(*mask.shape))
    _, labels, boxes, _ = cv2.connectedComponentsWithStats(mask, connectivity=8)
    keep = np.hypot(boxes[:, cv2.CC_STAT_WIDTH], boxes[:, cv2.CC_STAT_HEIGHT]) >= shortest
    keep[0] = False  # the background
    return Otsu(keep[labels], threshold)
