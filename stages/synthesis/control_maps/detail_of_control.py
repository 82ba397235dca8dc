"""Detail of an exemplar's control that the target's control does not have."""

import numpy as np
from jaxtyping import Float32

from texloom.stages.kernels.core.loading import loaded

_DEVIATIONS = (2, 4, 8)  # px, of the blur of control, one after the other
_MOST = 0.99  # share of the target's pixels with no more detail than is compared: the rest may be a line
_SHARE = 1 / 8  # of the exemplar's shorter side, which a deviation does not exceed


def as_smooth_as(
    own: Float32[np.ndarray, "h w k"], wanted: Float32[np.ndarray, "H W k"], toroidal: bool
) -> Float32[np.ndarray, "h w k"]:
    """The exemplar's control, blurred while the target's control has less detail.

    Measured control varies from pixel to pixel with the texture, painted control does not. Under an even value only
    pixels of this value are found, the same few again and again, and between two materials those of their borders:
    rust under a soft gradient becomes an even brown. Blurred control says how much of each there is around a pixel.

    Detail is what a blur removes from the exemplar, and a median filter from the target, where borders between
    regions are none. Nearly all of the target must have less of it than half of the exemplar, where it is
    everywhere and no mere joint of a compaction; so a line in the target keeps the exemplar's control as it is.

    Parameters
    ----------
    own, wanted : control of the exemplar and of the target, in the same units and of the same scale.
    toroidal : the exemplar wraps around.
    """
    smoothest = own
    for deviation in _DEVIATIONS:
        if not own.shape[2] or deviation > _SHARE * min(own.shape[:2]):
            break
        blurred = _blurred(own, deviation, toroidal)
        detail = _lengths(own - blurred), _lengths(wanted - _without_lines(wanted, 2 * deviation))
        if np.quantile(detail[1], _MOST) >= np.median(detail[0]):
            break
        smoothest = blurred
    return smoothest


def _blurred(planes: Float32[np.ndarray, "h w k"], deviation: int, toroidal: bool) -> Float32[np.ndarray, "h w k"]:
    ndimage = loaded("scipy.ndimage")
    mode = "wrap" if toroidal else "reflect"
    blurred = ndimage.gaussian_filter(planes, (deviation, deviation, 0), mode=mode, truncate=3)
    return np.asarray(blurred, np.float32)


def _without_lines(planes: Float32[np.ndarray, "h w k"], radius: int) -> Float32[np.ndarray, "h w k"]:
    """Planes without what is narrower than ``radius`` px, in 256 steps of their range."""
    import cv2

    low, high = planes.min(axis=(0, 1)), planes.max(axis=(0, 1))
    step = np.maximum(high - low, 1e-6) / np.float32(255)
    levels = np.rint((planes - low) / step).astype(np.uint8)
    filtered = [cv2.medianBlur(np.ascontiguousarray(plane), 2 * radius + 1) for plane in np.moveaxis(levels, 2, 0)]
    return np.asarray(np.stack(filtered, axis=2) * step + low, np.float32)


def _lengths(planes: Float32[np.ndarray, "h w k"]) -> Float32[np.ndarray, "h w"]:
    """Of the vector of each pixel."""
    return np.sqrt(np.einsum("hwk,hwk->hw", planes, planes))
