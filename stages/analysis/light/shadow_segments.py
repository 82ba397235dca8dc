"""Which part of a textured surface lies in shadow: the same texture, under weaker and bluer light."""

from __future__ import annotations

import dataclasses
from typing import TypeAlias

import numpy as np
from jaxtyping import Float32, Float64

from texloom.stages.kernels.core.elementary_functions import log
from texloom.stages.numerics.filters import gaussian_blur
from texloom.stages.numerics.matrices import matrix_product, solve
from texloom.stages.numerics.threshold import otsu_threshold
from texloom.stages.vocabulary.arrays import Mask, ScalarMap

LogColor: TypeAlias = Float32[np.ndarray, "h w 3"]
"""logarithms of linear light"""

_DARKEST = np.float32(0.003)  # added to linear light, about the noise of 8 bits
_BLURS = (1 / 24, 1 / 8)  # deviations of blurs of which first guesses are thresholds, as shares of the shorter side
_PASSES = 5
_SETTLED = 0.002  # share of pixels that change in the last pass
_LEAST = 0.02  # share of the picture in shadow, and in light
_NOISE = 0.02  # deviation of logarithms that every picture has
_BINS = 256  # of distributions
_SMOOTH = 0.15  # of distributions, as a share of their deviation
_UNLIKELY = 3e-4  # least density, relative to an even one times `_BINS`
_MOST_TOLD = 4.0  # logarithm of likelihoods that a single pixel tells
_BLOCK = 16  # blocks a side, whose means tell over how many pixels a texture repeats itself
_PENUMBRA = 0.03  # of the border that does not count in the shift, as a share of the shorter side
_CORE = 0.25  # share of each part that counts at least
_STEPS = 150  # of the primal-dual iteration


@dataclasses.dataclass(frozen=True)
class Shadow:
    """A part of the picture that would be like the rest if its logarithms were raised by ``shift``."""

    mask: Mask
    """true in shadow"""
    shift: Float64[np.ndarray, "3"]
    """logarithm of light over shadow, by channel"""
    even: LogColor
    """the picture without slow drift, and without the shadow"""
    projection: Float64[np.ndarray, "3"]
    """weights of the channels in the sum that tells shadow from light best"""
    distance: float
    """of shadow from light along that, standard deviations of the texture"""
    grain: float
    """side of a square in which the texture is about the same, px"""


def log_color(color: Float32[np.ndarray, "h w 3"]) -> LogColor:
    """Logarithms of linear light, which shadows shift."""
    return np.asarray(log(np.maximum(color, 0) + _DARKEST), np.float32)


def first_guesses(colors: LogColor, valid: Mask) -> list[Mask]:
    """Parts that are darker or bluer than the rest."""
    side = min(valid.shape)
    planes = [gaussian_blur(colors.mean(axis=2), blur * side) for blur in _BLURS]
    planes.append(gaussian_blur(colors[..., 0] - colors[..., 2], _BLURS[0] * side))
    return [plane <= otsu_threshold(plane[valid]) for plane in planes if np.ptp(plane[valid]) > _NOISE]


def find_shadow(colors: LogColor, valid: Mask, guess: Mask, refine: bool = False) -> Shadow | None:
    """The most likely division of a texture into light and shadow; None where none remains.

    Both parts are taken to have one distribution of colours, in shadow shifted by the same logarithms, which are
    found in turns with the parts: a drift of second degree and the shift by least squares; the direction in which
    the shift is largest against the texture's covariance; the distribution along it; and the parts, as those of
    least total variation and greatest likelihood.

    Parameters
    ----------
    colors : as of `log_color`.
    valid : pixels that count.
    guess : what may be in shadow.
    refine : ``guess`` is right but for its border, as it was found at a lower resolution.

    References
    ----------
    Ours. [Finlayson2009]_ for shadows as shifts along one direction of logarithms, [ChanEsedogluNikolova2006]_ for
    parts by convex total variation, [ChambollePock2011]_ for its solution.
    """
    passes, steps = (1, _STEPS // 3) if refine else (_PASSES, _STEPS)
    part = guess.astype(np.float32)
    for _ in range(passes):
        found = _explained(colors, part, valid)
        if found is None:
            return None
        likelihood = _log_likelihood(part, valid, found)
        before = part
        grain = np.float32(found.grain)
        part = least_total_variation(likelihood / np.square(grain), 1 / grain, part, steps)
        if float(np.abs(part - before)[valid].mean(dtype=np.float64)) < _SETTLED:
            break
    dark = part > 0.5
    return _explained(colors, dark.astype(np.float32), valid, _outside_penumbra(dark, valid))


def _outside_penumbra(dark: Mask, valid: Mask) -> Mask:
    """Pixels far from the border; fewer are left out where parts are small."""
    import cv2

    for reach in (_PENUMBRA, _PENUMBRA / 2):
        kernel = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, [2 * max(1, round(reach * min(dark.shape))) + 1] * 2)
        shrunk = [cv2.erode(part.astype(np.uint8), kernel) > 0 for part in (dark, ~dark)]
        parts = [
            float((inner & valid).sum()) / max(int((whole & valid).sum()), 1)
            for inner, whole in zip(shrunk, (dark, ~dark), strict=True)
        ]
        if min(parts) > _CORE:
            return valid & (shrunk[0] | shrunk[1])
    return valid


def _explained(colors: LogColor, part: ScalarMap, valid: Mask, fitted: Mask | None = None) -> Shadow | None:
    """Drift and shift by least squares of the pixels ``fitted``, and what follows from them."""
    if not _LEAST < float(part[valid].mean(dtype=np.float64)) < 1 - _LEAST:
        return None
    basis = np.concatenate([_polynomials(valid.shape), part[..., None].astype(np.float64)], axis=2)
    thin = (valid if fitted is None else fitted)[::3, ::3]
    chosen = basis[::3, ::3][thin]
    values = colors[::3, ::3][thin].astype(np.float64)
    normal = np.einsum("ni,nj->ij", chosen, chosen) + 1e-6 * np.eye(chosen.shape[1])
    factors = solve(normal, np.einsum("ni,nj->ij", chosen, values))
    shift = -factors[-1]
    drift = matrix_product(basis[..., 1:-1], factors[1:-1])
    even = (colors - drift + part[..., None] * shift).astype(np.float32)
    counted = even[valid].astype(np.float64)
    centred = counted - counted.mean(axis=0)
    covariance = np.einsum("ni,nj->ij", centred, centred) / len(centred) + _NOISE**2 * np.eye(3)
    projection = solve(covariance, shift)
    squared = float((projection * shift).sum())
    if squared < 1e-6:
        return None
    grain = _grain(matrix_product(even, projection), valid)
    return Shadow(part > 0.5, shift, even, projection, float(np.sqrt(squared)), grain)


def _polynomials(shape: tuple[int, ...]) -> Float64[np.ndarray, "h w 6"]:
    down, across = np.meshgrid(*((2 * np.arange(side) + 1) / side - 1 for side in shape), indexing="ij")
    return np.stack([np.ones(down.shape), down, across, down**2, down * across, across**2], axis=2)


def _grain(plane: Float64[np.ndarray, "h w"], valid: Mask) -> float:
    """Means of n independent values vary by 1 / n of the values' variance: so n tells how many there are."""
    side = max(8, min(plane.shape) // _BLOCK)
    height, width = (length // side * side for length in plane.shape)
    blocks = (height // side, side, width // side, side)
    counts = valid[:height, :width].reshape(blocks).sum(axis=(1, 3))
    sums = np.where(valid, plane, 0)[:height, :width].reshape(blocks).sum(axis=(1, 3))
    means = sums[counts > side * side // 2] / counts[counts > side * side // 2]
    variance = float(plane[valid].var())
    if len(means) < 2 or variance <= 0:
        return 1.0
    return float(np.sqrt(np.clip(side * side * float(means.var()) / variance, 1, side * side)))


def _log_likelihood(part: ScalarMap, valid: Mask, found: Shadow) -> ScalarMap:
    """Logarithm of how much likelier each pixel is in light than in shadow; 0 where nothing is known."""
    step = found.distance**2
    even = matrix_product(found.even, found.projection)
    shown = even - step * part
    counted = even[valid]
    low, high = float(counted.min()) - 1.05 * step, float(counted.max()) + 1.05 * step
    width = (high - low) / _BINS
    counts, _ = np.histogram(counted, _BINS, (low, high))
    smooth = max(1.0, _SMOOTH * float(counted.std()) / width)
    density = gaussian_blur(counts.astype(np.float64)[None], smooth, "edge")[0] / counts.sum() + _UNLIKELY / _BINS
    middles = low + (np.arange(_BINS) + 0.5) * width
    logarithm = np.asarray(log(density), np.float64)
    told = np.interp(shown, middles, logarithm) - np.interp(shown + step, middles, logarithm)
    return np.where(valid, np.clip(told, -_MOST_TOLD, _MOST_TOLD), 0).astype(np.float32)


def least_total_variation(cost: ScalarMap, smooth: np.float32, start: ScalarMap, steps: int) -> ScalarMap:
    """The plane of 0..1 with the least sum of its product with ``cost`` and of ``smooth`` times its variation."""
    plane, ahead = start.copy(), start.copy()
    down, across = np.zeros_like(plane), np.zeros_like(plane)
    step = np.float32(1 / np.sqrt(8))
    for _ in range(steps):
        down[:-1] += step * (ahead[1:] - ahead[:-1])
        across[:, :-1] += step * (ahead[:, 1:] - ahead[:, :-1])
        shrink = np.maximum(np.float32(1), np.sqrt(down * down + across * across) / smooth)
        down /= shrink
        across /= shrink
        divergence = down + across
        divergence[1:] -= down[:-1]
        divergence[:, 1:] -= across[:, :-1]
        after = np.clip(plane + step * (divergence - cost), 0, 1)
        ahead, plane = 2 * after - plane, after
    return plane
