"""How often the pixels of an exemplar are used by a result."""

import numpy as np
from jaxtyping import Float32, Int32

from texloom.stages.vocabulary.arrays import Correspondence, Mask
from texloom.stages.vocabulary.scratch import bands

_BOX = 9  # px over which use is averaged, about a patch


def source_counts(match: Correspondence, shape: tuple[int, int]) -> Int32[np.ndarray, "h w"]:
    """How often each pixel of an exemplar of ``shape`` is a source."""
    from texloom.stages.kernels.patchmatch.search import count_matches

    counts = np.zeros(shape, np.int32)
    for band in bands(len(match), match):
        count_matches(match[band, :, 0], match[band, :, 1], counts)
    return counts


def use_of_exemplar(
    match: Correspondence, shape: tuple[int, int], valid: Mask | None = None
) -> Float32[np.ndarray, "h w"]:
    """How often each exemplar pixel occurs in the result, averaged over 9x9 pixels; the mean use is 1.

    Only valid pixels count.
    """
    import cv2

    counts = source_counts(match, shape).astype(np.float32)
    side = min(_BOX, *shape)
    averaged = cv2.boxFilter(counts, cv2.CV_32F, (side, side), borderType=cv2.BORDER_REFLECT_101)
    if valid is not None:
        cover = cv2.boxFilter(valid.astype(np.float32), cv2.CV_32F, (side, side), borderType=cv2.BORDER_REFLECT_101)
        averaged = np.where(valid, averaged / np.maximum(cover, np.float32(1e-6)), 0)
    mean = averaged.mean() if valid is None else averaged[valid].mean()
    return np.asarray(averaged / max(float(mean), 1e-12), np.float32)
