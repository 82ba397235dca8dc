"""A surface at reduced size, with means of what is usable alone."""

import numpy as np
from jaxtyping import Bool, Float32

from texloom.stages.common.grids.pyramid import reduced
from texloom.stages.vocabulary.arrays import Image, Mask
from texloom.stages.vocabulary.color import lab_from_linear


def reduced_surface(
    image: Image, usable: Mask, side: int
) -> tuple[Float32[np.ndarray, "p q 3"], Bool[np.ndarray, "p q"]]:
    """CIELAB at a longer side of at most ``side`` px, and where most of a pixel is usable."""
    counted = usable[..., None].astype(np.float32)
    both = reduced(np.concatenate([image.color * counted, counted], axis=2), side)
    mean = both[..., :3] / np.maximum(both[..., 3:], np.float32(1e-6))
    return lab_from_linear(mean), both[..., 3] > 0.5


def without_rim(shown: Mask, reach: int) -> Mask:
    """What is shown, without ``reach`` px beside what is not, where gradients are none of the surface's."""
    import cv2

    sides = np.ones((2 * reach + 1, 2 * reach + 1), np.uint8)
    return np.asarray(cv2.erode(shown.astype(np.uint8), sides, borderValue=1) > 0)
