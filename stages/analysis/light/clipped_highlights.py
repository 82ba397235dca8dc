"""Highlights so bright that the camera saw no more than white."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float32

from texloom.stages.kernels.core.elementary_functions import log
from texloom.stages.kernels.core.loading import loaded
from texloom.stages.numerics.filters import gaussian_blur
from texloom.stages.vocabulary.arrays import Mask

_WHITE = 0.97  # linear light of the darkest channel; 252 of 255 in sRGB
_LEAST = 1 / 96  # side of a square as large as a highlight's white part, as a share of the picture's shorter side
_MOST = 0.3  # share of the picture that is white; of more, white is its own colour
_DARK = 0.6  # linear light of the usual pixel, at most, as white else is the picture's own colour
_RING = (
    1 / 64
)  # width of the rings around a highlight in which its fall is measured, as a share of the shorter side
_RINGS = 10
_LEFT = 0.06  # logarithm by which the outermost ring of a highlight is brighter than what lies beyond all of them
_DARKER = 0.1  # quantile of the dark details that light is added to as well
_ALIKE = 0.5  # of what is added to the usual pixel, that dark details get too
_FADES = 3  # rings, at least


def clipped_highlights(color: Float32[np.ndarray, "h w 3"], valid: Mask) -> Mask:
    """True in highlights that are clipped to white, with the glow around them that hides the surface too.

    A white part of the surface ends at an edge, a highlight fades: rings around it become darker one after the
    other, and beside it even dark details are bright, as its light is added to theirs. None are found where the
    picture itself is nearly white.

    Parameters
    ----------
    color : linear light.
    valid : pixels that count.

    References
    ----------
    Ours.
    """
    ndimage = loaded("scipy.ndimage")
    none = np.zeros(valid.shape, np.bool_)
    darkest, mean = color.min(axis=2), color.mean(axis=2)
    white = (darkest >= _WHITE * max(1.0, float(color[valid].max()))) & valid  # floats may exceed 1 unclipped
    if not white.any() or white.sum() > _MOST * valid.sum() or np.median(mean[valid]) > _DARK:
        return none
    side = min(valid.shape)
    labels, count = ndimage.label(ndimage.binary_opening(white, iterations=max(1, round(side / 512))))
    sizes = np.bincount(labels.ravel(), minlength=count + 1)
    sizes[0] = 0
    large = sizes >= (_LEAST * side) ** 2
    if not large.any():
        return none
    ring = max(1.0, _RING * side)
    apart, nearest = ndimage.distance_transform_edt(~large[labels], return_indices=True)
    owner = labels[nearest[0], nearest[1]]
    brightness = log(gaussian_blur(mean, max(1.0, ring / 3)) + np.float32(0.003))
    number = np.ceil(apart / ring).astype(np.int64)
    found = none.copy()
    for highlight in np.flatnonzero(large):
        own = (owner == highlight) & valid
        beyond = own & (number > _RINGS) & (number <= 2 * _RINGS)
        beyond = beyond if beyond.any() else valid & (number > _RINGS)
        if not beyond.any():
            continue
        base, dark = np.median(brightness[beyond]), np.quantile(mean[beyond], (_DARKER, 0.5))
        last, before = 0, np.inf
        for one in range(1, _RINGS + 1):
            there = own & (number == one)
            excess = float(np.median(brightness[there]) - base) if there.any() else 0.0
            lift = (np.quantile(mean[there], (_DARKER, 0.5)) - dark) if there.any() else np.zeros(2)
            if excess < _LEFT or lift[0] < _ALIKE * lift[1] or excess > before:
                break
            last, before = one, excess
        if last >= _FADES:
            found |= (owner == highlight) & (number <= last + 1)
    return found
