"""Otsu's threshold: features from contour strength."""

import dataclasses

import numpy as np
from pydantic import Field

from texloom.stages.numerics.threshold import otsu_threshold
from texloom.stages.vocabulary.arrays import Image, Mask, ScalarMap
from texloom.stages.vocabulary.declare import Params, stage
from texloom.stages.vocabulary.masks import valid_pixels


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
