"""Pixels of a texture outside its charts."""

import numpy as np
from jaxtyping import Bool, Int64


def nearest_known(known: Bool[np.ndarray, "H W"]) -> Int64[np.ndarray, "H W"]:
    """For every pixel the index, row * W + column, of the nearest one that is ``known``; at least one must be."""
    import cv2

    _, label = cv2.distanceTransformWithLabels(
        (~known).view(np.uint8), cv2.DIST_L2, cv2.DIST_MASK_5, labelType=cv2.DIST_LABEL_PIXEL
    )
    index = np.zeros(int(label.max()) + 1, np.int64)
    index[label[known]] = np.flatnonzero(known)
    return index[label]
