"""Slow changes of a plain surface's tone: all of them are seen in a texture, where nothing else is."""

import numpy as np
from jaxtyping import Float32

from texloom.stages.numerics.filters import gaussian_blur
from texloom.stages.vocabulary.arrays import Mask

_WAVES = 12  # along the longer side: what is slower is drift
_PLAIN, _DETAILS = 1.5, 2.5  # CIELAB: deviation of the rest by its median, and with all details
_VISIBLE = 0.5  # deviation of the drift, relative to that of the rest


def plain_drift(
    lab: Float32[np.ndarray, "h w 3"], planes: Float32[np.ndarray, "h w 3"], valid: Mask | None
) -> Float32[np.ndarray, "h w 3"] | None:
    """The slow changes of a plain surface; none where it has details, or hardly changes.

    Parameters
    ----------
    lab : CIELAB of the surface.
    planes : its `relative_tone`, in which the changes are.

    References
    ----------
    Ours.
    """
    counted = np.ones(lab.shape[:2], np.bool_) if valid is None else valid
    slow = _slow(lab[..., :1], counted)[..., 0]
    rest = (lab[..., 0] - slow)[counted].astype(np.float64)
    usual = 1.4826 * float(np.median(np.abs(rest)))
    deviation = float(rest.std())
    if usual > _PLAIN or deviation > _DETAILS or float(slow[counted].std()) < _VISIBLE * usual:
        return None
    drift = _slow(planes, counted)
    return np.asarray(drift - drift[counted].mean(axis=0), np.float32)


def _slow(planes: Float32[np.ndarray, "h w k"], counted: Mask) -> Float32[np.ndarray, "h w k"]:
    """Means around each pixel, of what counts."""
    deviation = max(counted.shape) / _WAVES
    weight = counted.astype(np.float32)
    total = np.maximum(gaussian_blur(weight, deviation), np.float32(1e-6))
    return np.stack(
        [gaussian_blur(plane * weight, deviation) / total for plane in np.moveaxis(planes, 2, 0)], axis=2
    )
