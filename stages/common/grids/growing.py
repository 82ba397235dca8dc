"""Masks that grow: by a distance, also across the borders of a picture that wraps, or to their convex hull."""

import numpy as np

from texloom.stages.vocabulary.arrays import Mask
from texloom.stages.vocabulary.facts import NOWHERE, Wraps


def grown(region: Mask, reach: int, wrap: Wraps = NOWHERE) -> Mask:
    """True within ``reach`` px of ``region``, along both axes.

    Examples
    --------
    >>> import numpy as np
    >>> from texloom.stages.vocabulary.facts import Wraps
    >>> grown(np.array([[True, False, False, False]]), 1, Wraps(False, True))
    array([[ True,  True, False,  True]])
    """
    import cv2

    beyond = wrap.where_closed(reach)
    wide = np.pad(region, [(one, one) for one in beyond], mode="wrap")
    large = cv2.dilate(wide.astype(np.uint8), np.ones((2 * reach + 1, 2 * reach + 1), np.uint8)).view(bool)
    return large[tuple(slice(one, one + length) for one, length in zip(beyond, region.shape, strict=True))]


def convex_hull(region: Mask) -> Mask:
    """True in the convex hull of ``region``, which is not empty."""
    import cv2

    filled = np.zeros(region.shape, np.uint8)
    points = np.argwhere(region)[:, ::-1].astype(np.int32)
    cv2.fillConvexPoly(filled, cv2.convexHull(points), 1)
    return filled.view(bool)
