"""Signed distance to features: the guidance channel."""

import dataclasses

import numpy as np

from texloom.stages.vocabulary.arrays import Mask, ScalarMap
from texloom.stages.vocabulary.declare import stage
from texloom.stages.vocabulary.progress import Progress, report
from texloom.stages.vocabulary.scratch import bands


@dataclasses.dataclass(frozen=True)
class SignedDistance:
    """Signed distance of every pixel to the features' borders."""

    field: ScalarMap
    """``pixels`` scaled to 0..100, the range of L; all 0 where all pixels or none belong to features"""
    pixels: ScalarMap
    """Euclidean distance, px: positive outside features, negative inside; 0 only without features"""


@stage(version=1, seconds=(0.5, 0))
def signed_distance(structure: Mask) -> SignedDistance:
    """Distance to the nearest feature pixel outside, minus the distance to the nearest other pixel inside.

    Parameters
    ----------
    structure : true on features.

    References
    ----------
    [Kaspar2015]_ section 3.1, Figure 2.
    """
    import cv2

    pixels = np.zeros(structure.shape, np.float32)
    if structure.any() and not structure.all():
        for sign in (1, -1):
            zeros = (structure if sign < 0 else ~structure).view(np.uint8)
            distance = cv2.distanceTransform(zeros, cv2.DIST_L2, cv2.DIST_MASK_PRECISE)
            # OpenCV's last bit depends on the array's alignment; squared distances are integers.
            for band in bands(len(distance)):
                exact = np.sqrt(np.rint(np.square(distance[band], dtype=np.float64)))
                pixels[band] += sign * exact.astype(np.float32)
            del distance
            report(Progress(0.45 if sign > 0 else 0.9))
    span = float(np.ptp(pixels))
    field = pixels - pixels.min()
    if span:
        field *= np.float32(100 / span)
    return SignedDistance(np.clip(field, 0, 100, out=field), pixels)
