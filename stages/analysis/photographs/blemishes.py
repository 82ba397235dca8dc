"""What stands out on a plain surface: vents, hooks, the rims of windows, shadows of sills."""

import numpy as np
from jaxtyping import Float32, Float64

from texloom.stages.numerics.filters import gaussian_blur
from texloom.stages.vocabulary.arrays import Mask

_WAVES = 12  # along the longer side: what is slower is the surface's own tone
_FINE = 0.7  # px: standard deviation by which noise is removed
_PASSES = 3  # in which what stands out is left out of the tone
_PLAIN = 1.5  # CIELAB: deviation of the lightness of a plain surface, by its median
_LEAST = 0.4  # CIELAB: of any channel
_OUT, _NEAR = 6.0, 3.5  # deviations from which pixels stand out, and to which they reach
_NOTICED = 3.0  # CIELAB
_SMALL = 6  # px
_MOST, _MOST_ALONE = 0.15, 4  # share of the surface, and number of those not beside a foreign part; more is its own
_BESIDE = 0.03  # of the longer side


def blemishes(lab: Float32[np.ndarray, "h w 3"], valid: Mask, found: Mask) -> Mask:
    """The pixels that stand out on a plain surface, where they are few; none where it is not plain.

    They stand out from its slow tone by many times its usual deviation, and their surroundings that still do are
    theirs. A texture with details would show them beside their like; on plain plaster each copy is seen.

    Parameters
    ----------
    valid : where the surface is.
    found : foreign parts, which are left out; what stands out beside them belongs to them.

    References
    ----------
    Ours; deviations by medians [HollandWelsch1977]_.
    """
    import cv2

    counted = valid & ~found
    nothing = np.zeros(valid.shape, np.bool_)
    if np.count_nonzero(counted) < 1000:
        return nothing
    usual = counted
    for _ in range(_PASSES):
        rest = _without_tone(lab, counted, usual)
        deviation = 1.4826 * np.median(np.abs(rest[counted]), axis=0)
        away = np.sqrt(np.square(rest / np.maximum(deviation, _LEAST)).sum(axis=2))
        usual = counted & (away < _NEAR)
        if deviation[0] > _PLAIN or not usual.any():
            return nothing
    near = counted & (away >= _NEAR)
    out = near & (away >= _OUT) & (np.sqrt(np.square(rest).sum(axis=2)) >= _NOTICED)
    count, labels = cv2.connectedComponents(near.astype(np.uint8), connectivity=8)
    reach = np.bincount(labels[out], minlength=count)
    whole = (reach >= _SMALL) & (np.arange(count) > 0)
    side = 2 * max(1, round(_BESIDE * max(valid.shape))) + 1
    around = cv2.dilate(found.astype(np.uint8), np.ones((side, side), np.uint8)) > 0
    beside = np.bincount(labels[around], minlength=count) > 0
    if np.count_nonzero(whole & ~beside) > _MOST_ALONE:
        whole &= beside
    chosen = np.asarray(whole[labels])
    return chosen if np.count_nonzero(chosen) <= _MOST * np.count_nonzero(counted) else nothing


def _without_tone(lab: Float32[np.ndarray, "h w 3"], counted: Mask, usual: Mask) -> Float64[np.ndarray, "h w 3"]:
    """Fine differences from the slow tone of the usual pixels."""
    slow, fine = (
        _mean_around(lab, where, deviation)
        for where, deviation in ((usual, max(lab.shape[:2]) / _WAVES), (counted, _FINE))
    )
    return np.where(counted[..., None], fine - slow, 0).astype(np.float64)


def _mean_around(lab: Float32[np.ndarray, "h w 3"], where: Mask, deviation: float) -> Float32[np.ndarray, "h w 3"]:
    weight = where.astype(np.float32)
    total = np.maximum(gaussian_blur(weight, deviation), np.float32(1e-6))
    return np.stack([gaussian_blur(plane * weight, deviation) / total for plane in np.moveaxis(lab, 2, 0)], axis=2)
