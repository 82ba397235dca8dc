"""Whether a part of a picture is in shadow, or of another material."""

from __future__ import annotations

import dataclasses

import numpy as np
from jaxtyping import Float64

from texloom.stages.analysis.light.penumbra import shadow_gain
from texloom.stages.analysis.light.shadow_segments import Shadow
from texloom.stages.kernels.core.elementary_functions import exp, log
from texloom.stages.kernels.core.loading import loaded
from texloom.stages.numerics.filters import gaussian_blur
from texloom.stages.vocabulary.arrays import Mask, ScalarMap

_BANDS = ((0.0, 1.2), (1.2, 3.0), (3.0, 8.0))  # deviations of blurs, px, between which detail is compared
_QUANTILES = (0.05, 0.25, 0.5, 0.75, 0.95)
_BESIDE = 0.008  # distance from the border at which both sides are compared, as a share of the shorter side
_CORE = 0.015  # the same, within which the texture is not compared as there may be penumbra
_WIDE = 0.04  # the same, beyond which penumbra ends
_FEW = 60  # pixels that tell nothing
_SCALE = 6.0  # sum of squares at which confidence is 1 / e


@dataclasses.dataclass(frozen=True)
class Evidence:
    """How far a part is from being in shadow, in each regard: squares, 0 if it is just like shadow."""

    texture: float
    """logarithm of the contrasts of detail, which no shadow changes"""
    distribution: float
    """dark and bright quantiles are shifted differently"""
    across: float
    """the texture does not continue across the border"""
    contrast: float
    """the shift is small against the texture: what it tells in a grain, by the grains of area for one of border"""
    size: float
    """the parts are as small as the texture's own"""
    color: float
    """the shift is weak, or redder than light of the sky in place of the sun"""
    border: float
    """there is no step at the border but a drift"""

    @property
    def confidence(self) -> float:
        """0..1."""
        return float(exp(np.array(-sum(dataclasses.astuple(self)) / _SCALE)))


def evidence(shadow: Shadow, share: ScalarMap, valid: Mask) -> Evidence | None:
    """Compare the texture in shadow with that in light; None if too little of either is seen.

    Parameters
    ----------
    shadow : the part.
    share : of direct light at each pixel, see `light_left`.
    valid : pixels that count.

    References
    ----------
    Ours.
    """
    dark = shadow.mask
    side = min(dark.shape)
    left = log(shadow_gain(share, shadow.shift)) + dark[..., None] * shadow.shift  # 0 but in penumbra
    plane = (shadow.even - left).mean(axis=2).astype(np.float32)
    signed, foot = _distance(dark)
    core = (np.abs(signed) > max(3.0, _CORE * side)) & valid
    in_shadow, in_light = core & dark, core & ~dark
    if min(in_shadow.sum(), in_light.sum()) < _FEW:
        return None
    size, extent = float(shadow.shift.mean()), _extent(dark, valid) / shadow.grain
    ranges = [
        [_range(_detail(plane, part & valid, *band)[core & part]) for part in (dark, ~dark)] for band in _BANDS
    ]
    texture = max(abs(float(log(np.array(one / other)))) for one, other in ranges)
    moved = np.quantile(plane[in_light], _QUANTILES) - np.quantile(plane[in_shadow], _QUANTILES)
    return Evidence(
        texture=(texture / 0.2) ** 2,
        distribution=(float(np.ptp(moved)) / max(size, 1e-3) / 0.35) ** 2,
        across=_across(plane, signed, foot, valid, max(2.0, _BESIDE * side)),
        contrast=(max(0.0, 10.0 - shadow.distance**2 * extent) / 2.5) ** 2,
        size=(max(0.0, 2.0 - extent) / 0.5) ** 2,
        color=_tint(shadow.shift),
        border=_step(shadow.even.mean(axis=2), signed, valid, size, _WIDE * side),
    )


def _distance(dark: Mask) -> tuple[Float64[np.ndarray, "h w"], np.ndarray]:
    """Distance from the border, px, less than 0 in shadow, and the nearest pixel of the other part."""
    ndimage = loaded("scipy.ndimage")
    inner, inside = ndimage.distance_transform_edt(dark, return_indices=True)
    outer, outside = ndimage.distance_transform_edt(~dark, return_indices=True)
    return np.where(dark, 0.5 - inner, outer - 0.5), np.where(dark, inside, outside)


def _detail(plane: ScalarMap, part: Mask, fine: float, coarse: float) -> ScalarMap:
    """What is in a band of scales, of a part of the plane alone."""
    share = part.astype(np.float32)

    def blurred(deviation: float) -> ScalarMap:
        if deviation == 0:
            return plane
        return gaussian_blur(plane * share, deviation) / np.maximum(gaussian_blur(share, deviation), 1e-3)

    return blurred(fine) - blurred(coarse)


def _range(values: np.ndarray) -> float:
    low, high = np.quantile(values, (0.1, 0.9))
    return float(high - low) + 0.004


def _extent(dark: Mask, valid: Mask) -> float:
    """Area over border of the smaller part, px."""
    down = (dark[1:] != dark[:-1]) & valid[1:] & valid[:-1]
    across = (dark[:, 1:] != dark[:, :-1]) & valid[:, 1:] & valid[:, :-1]
    border = np.pi / 4 * (int(down.sum()) + int(across.sum()))
    return min(int((dark & valid).sum()), int((~dark & valid).sum())) / max(border, 1.0)


def _tint(shift: Float64[np.ndarray, "3"]) -> float:
    """Squares of how far a shift is from those between sun and sky."""
    red, green, blue = (float(value) for value in shift)
    least, most = min(red, green, blue), max(red, green, blue)
    squares = (max(0.0, 0.45 - (red + green + blue) / 3) / 0.1) ** 2 + (max(0.0, blue - red) / 0.1) ** 2
    return squares + (max(0.0, green - red) / 0.15) ** 2 + (4.0 if least < most / 3 else 0.0)


def _across(plane: ScalarMap, signed: np.ndarray, foot: np.ndarray, valid: Mask, beside: float) -> float:
    """Squares of how much less alike both sides of the border are than both sides of lines beside it."""
    fine = gaussian_blur(plane, 0.8)
    rows = [_compared(fine, signed, foot, valid, at, beside) for at in (0.0, 3 * beside, -3 * beside)]
    here, others = rows[0], [row for row in rows[1:] if row is not None]
    if here is None or not others:
        return 0.0
    difference = here[0] / max(float(np.mean([row[0] for row in others])), 1e-6)
    alike = float(np.mean([row[1] for row in others])) - here[1]
    return (max(0.0, difference - 1) / 0.2) ** 2 + (max(0.0, alike) / 0.2) ** 2


def _compared(
    plane: ScalarMap, signed: np.ndarray, foot: np.ndarray, valid: Mask, at: float, beside: float
) -> tuple[float, float] | None:
    """Mean difference and correlation of pixels on both sides of the line at a distance from the border."""
    row, column = np.nonzero((np.abs(signed - (at + beside)) < 0.7) & valid)
    ahead = np.stack([row, column]) - foot[:, row, column]
    sign = np.where(signed[row, column] < 0, -1, 1)
    ahead = ahead / np.maximum(np.hypot(*ahead), 1e-6) * sign
    other = np.rint(np.stack([row, column]) - 2 * beside * ahead).astype(np.int64)
    inside = ((other >= 0) & (other < np.array(plane.shape)[:, None])).all(axis=0)
    row, column, other = row[inside], column[inside], other[:, inside]
    right = (np.abs(signed[other[0], other[1]] - (at - beside)) < 1.5) & valid[other[0], other[1]]
    if right.sum() < _FEW:
        return None
    one = plane[row[right], column[right]].astype(np.float64)
    two = plane[other[0][right], other[1][right]].astype(np.float64)
    difference = one - two
    spread = np.sqrt(float(one.var() * two.var())) + 1e-9
    together = float(((one - one.mean()) * (two - two.mean())).mean()) / spread
    return float(np.abs(difference - np.median(difference)).mean()), together


def _step(plane: ScalarMap, signed: np.ndarray, valid: Mask, size: float, wide: float) -> float:
    """Squares of what lacks of the step at the border, seen from bands at its sides."""
    bands = [
        plane[(sign * signed > wide / 2) & (sign * signed < 1.5 * wide) & valid] - (size if sign < 0 else 0)
        for sign in (1, -1)
    ]
    if min(len(band) for band in bands) < _FEW:
        return 0.0
    step = (float(np.median(bands[0])) - float(np.median(bands[1]))) / max(size, 1e-3)
    return (max(0.0, 0.8 - step) / 0.15) ** 2 + (max(0.0, step - 1.4) / 0.3) ** 2
