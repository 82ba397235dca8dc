"""How much light a shadow leaves at each pixel, with its soft border."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float32, Float64

from texloom.stages.analysis.light.shadow_segments import Shadow
from texloom.stages.kernels.core.elementary_functions import exp, log
from texloom.stages.kernels.core.loading import loaded
from texloom.stages.numerics.filters import gaussian_blur
from texloom.stages.numerics.matrices import matrix_product
from texloom.stages.vocabulary.arrays import Mask, ScalarMap

_REACH = 0.06  # of the penumbra to both sides, as a share of the shorter side
_BINS = 25  # of distances from the border
_REDUCED = 8  # px of a block whose pixels count together
_ALONG = 0.06  # deviation of the windows in which the border is taken to be alike, as a share of the shorter side
_COMMON = 0.15  # weight of the whole border's profile, relative to that of a window full of border
_TABLE = 256


def light_left(shadow: Shadow, valid: Mask) -> ScalarMap:
    """Share of the direct light that reaches each pixel, 0 in the core of the shadow, 1 in light.

    Along the border the texture averages out, so that means at equal distances from it are the penumbra's profile:
    of the border nearby, or where little of it is nearby, of all.

    References
    ----------
    Ours.
    """
    ndimage = loaded("scipy.ndimage")
    dark, side = shadow.mask, min(shadow.mask.shape)
    inner, outer = (ndimage.distance_transform_edt(part) for part in (dark, ~dark))
    reach = max(4.0, _REACH * side)
    signed = np.clip(np.where(dark, 0.5 - inner, outer - 0.5) / reach, -1, 1)
    place = (np.sign(signed) * np.sqrt(np.abs(signed)) + 1) / 2 * (_BINS - 1)  # finer at the border
    shown = matrix_product(shadow.even - dark[..., None] * shadow.shift, shadow.projection)
    sums, counts = _by_distance(shown, place, valid)
    deviation = _ALONG * side / _REDUCED
    near_sums, near_counts = (
        np.stack([gaussian_blur(plane, deviation) for plane in part]) for part in (sums, counts)
    )
    whole = counts.sum(axis=(1, 2), keepdims=True)
    common = sums.sum(axis=(1, 2), keepdims=True) / np.maximum(whole, 1)
    filled = np.flatnonzero(whole > 0)  # no pixel of a narrow shadow is far from its border
    nearest = filled[np.abs(np.arange(_BINS)[:, None] - filled).argmin(axis=1)]
    common, near_sums, near_counts = common[nearest], near_sums[nearest], near_counts[nearest]
    weight = _COMMON * float(near_counts.max())
    profile = (near_sums + weight * common) / (near_counts + weight)
    level = _levels(profile, shadow)
    return _at(level, place)


def _by_distance(
    values: Float64[np.ndarray, "h w"], place: Float64[np.ndarray, "h w"], valid: Mask
) -> tuple[Float64[np.ndarray, "b p q"], Float64[np.ndarray, "b p q"]]:
    """Sums and numbers of pixels in blocks, by their distance from the border."""
    height, width = values.shape
    rows, columns = -(-height // _REDUCED), -(-width // _REDUCED)
    row, column = np.indices(values.shape) // _REDUCED
    index = ((np.rint(place).astype(np.int64) * rows + row) * columns + column)[valid]
    size = _BINS * rows * columns
    sums = np.bincount(index, values[valid], size).reshape(_BINS, rows, columns)
    return sums, np.bincount(index, minlength=size).reshape(_BINS, rows, columns).astype(np.float64)


def _levels(profile: Float64[np.ndarray, "b p q"], shadow: Shadow) -> Float32[np.ndarray, "b p q"]:
    """Shares of direct light of which the projected logarithms are those of a profile, rising with the distance."""
    step = shadow.distance**2
    quarter = max(1, _BINS // 8)
    bright = profile[-quarter:].mean(axis=0)
    below = np.clip((bright - profile) / step, 0, 1)  # 0 in light, 1 in shadow
    share = np.linspace(0, 1, _TABLE)
    drop = matrix_product(-_log_gain(share, shadow.shift), shadow.projection) / step
    level = np.interp(below, np.maximum.accumulate(drop[::-1]), share[::-1])
    level = (np.maximum.accumulate(level, axis=0) + np.minimum.accumulate(level[::-1], axis=0)[::-1]) / 2
    ends = np.linspace(-1, 1, _BINS)[:, None, None]
    return np.where(ends <= -0.9, 0, np.where(ends >= 0.9, 1, level)).astype(np.float32)


def _log_gain(share: np.ndarray, shift: Float64[np.ndarray, "3"]) -> Float64[np.ndarray, "*n 3"]:
    """Logarithm of the light where a share of the direct light remains, by channel; 0 in full light."""
    left = np.asarray(exp(-shift), np.float64)
    return np.asarray(log(left + share[..., None] * (1 - left)), np.float64)


def _at(level: Float32[np.ndarray, "b p q"], place: Float64[np.ndarray, "h w"]) -> ScalarMap:
    """Levels of the nearest blocks at the pixels' distances, interpolated."""
    height, width = place.shape
    row = np.clip((np.arange(height) + 0.5) / _REDUCED - 0.5, 0, level.shape[1] - 1)
    column = np.clip((np.arange(width) + 0.5) / _REDUCED - 0.5, 0, level.shape[2] - 1)
    ndimage = loaded("scipy.ndimage")
    rows, columns = np.meshgrid(row, column, indexing="ij")
    return np.asarray(ndimage.map_coordinates(level, [place, rows, columns], order=1, mode="nearest"), np.float32)


def shadow_gain(share: ScalarMap, shift: Float64[np.ndarray, "3"]) -> Float32[np.ndarray, "h w 3"]:
    """What the light of each pixel is multiplied by in a shadow that leaves a share of direct light."""
    left = np.asarray(exp(-shift), np.float32)
    return left + share[..., None] * (1 - left)
