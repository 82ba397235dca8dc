"""Slow features: what of a texture's local statistics changes only over long distances."""

import dataclasses
import itertools

import numpy as np
from jaxtyping import Float32

from texloom.stages.common.grids.pyramid import resize, resized_mask
from texloom.stages.kernels.core.elementary_functions import arctan2, cos, sin
from texloom.stages.numerics.filters import gaussian_blur, gradients
from texloom.stages.numerics.matrices import eigenvectors, matrix_product, square_sums
from texloom.stages.vocabulary.arrays import Image, Mask, ScalarMap
from texloom.stages.vocabulary.color import lab_from_linear, linear_from_lab
from texloom.stages.vocabulary.masks import fill_excluded, valid_pixels

_SIDE = 256  # px of the shorter side at which statistics are measured
_WINDOW = 1 / 16  # of the shorter side, deviation of the window of local statistics
_SLOW = 1 / 5  # of the shorter side, deviation beyond which a change is slow
_DETAIL = (1.0, 2.0, 4.0)  # px, deviations between which detail is measured
_FLOOR = 0.02  # of a statistic's variance between pixels, which a slow change has to outweigh
_HUES = np.deg2rad((285.0, 75.0))  # of 0 and 1 in a picture, from blue to yellow
_CHROMA = 45.0  # CIELAB units
_LEAN = 1e-3  # radians from upright, within which a direction counts as down or up
_MIN_COVER = 1e-3  # of a window, below which nothing is known there


@dataclasses.dataclass(frozen=True)
class SlowFeature:
    """The weighted sum of statistics that changes most slowly, on the grid where it was measured."""

    weights: Float32[np.ndarray, "6"]
    """of each of the planes of `statistics`"""
    local: Float32[np.ndarray, "p q"]
    """the sum in Gaussian windows, a sixteenth of the shorter side in deviation"""
    slow: Float32[np.ndarray, "p q"]
    """its slow part"""
    share: float
    """of the variance between pixels that the slow part has, 0..1"""

    @property
    def angle(self) -> float:
        """Direction in which the slow part grows on the whole, radians from along a row towards growing rows."""
        return mean_direction(self.slow)


def measured_factor(height: int, width: int) -> float:
    """Factor on the sides of an exemplar at which its statistics are measured."""
    return min(1.0, _SIDE / min(height, width))


def statistics(image: Image, factor: float) -> tuple[Float32[np.ndarray, "p q 6"], Mask | None]:
    """Colour and the amount of detail at three sizes, CIELAB units, and the pixels that count.

    Parameters
    ----------
    factor : on both sides, at which they are measured.
    """
    size = max(1, round(image.height * factor)), max(1, round(image.width * factor))
    lab = lab_from_linear(resize(np.ascontiguousarray(fill_excluded(image).color), *size, bilinear=True))
    valid = valid_pixels(image)
    if valid is not None:
        valid = resized_mask(valid, *size)
    lightness = np.ascontiguousarray(lab[..., 0])
    levels = [lightness, *(gaussian_blur(lightness, deviation) for deviation in _DETAIL)]
    detail = [np.abs(fine - coarse) for fine, coarse in itertools.pairwise(levels)]
    return np.concatenate([lab, np.stack(detail, axis=2)], axis=2).astype(np.float32), valid


def window_means(planes: np.ndarray, valid: Mask | None, deviation: float) -> np.ndarray:
    """Means over Gaussian windows of the pixels that count, of (h, w) or (h, w, k)."""
    if valid is None:
        return gaussian_blur(planes, deviation, "repeat")
    counted = valid.astype(np.float32)
    cover = np.maximum(gaussian_blur(counted, deviation, "repeat"), np.float32(_MIN_COVER))
    if planes.ndim == 2:
        return np.asarray(gaussian_blur(planes * counted, deviation, "repeat") / cover)
    return np.asarray(gaussian_blur(planes * counted[..., None], deviation, "repeat") / cover[..., None])


def slow_feature(image: Image) -> SlowFeature:
    """The weighted sum of local statistics of which the largest share is slow; it grows to the right or down.

    With C the covariance of statistics in windows, S that of their slow parts and D the variances between pixels,
    the weights w maximise w'Sw / w'(C + 0.02 D)w: those of slow feature analysis, but that a change that hardly
    shows among the pixels counts little.

    Parameters
    ----------
    image : its colour is measured; what is excluded in it does not count.

    References
    ----------
    [WiskottSejnowski2002]_, with slowness in space instead of time. Statistics and the regularisation are ours.
    """
    planes, valid = statistics(image, measured_factor(image.height, image.width))
    shorter = min(planes.shape[:2])
    local = window_means(planes, valid, _WINDOW * shorter)
    slow = window_means(local, valid, _SLOW * shorter)
    counted = np.ones(planes.shape[:2], bool) if valid is None else valid
    scale = np.maximum(planes[counted].std(axis=0, dtype=np.float64), 1e-6)
    of_pixels, of_windows, of_slow = (_covariance(one[counted] / scale) for one in (planes, local, slow))
    values, vectors = eigenvectors(of_windows + _FLOOR * np.eye(len(scale)))
    white = vectors / np.sqrt(values)
    _, found = eigenvectors(matrix_product(matrix_product(white.T, of_slow), white))
    direction = matrix_product(white, found[:, -1])
    total = float(matrix_product(matrix_product(direction, of_pixels), direction))
    share = float(matrix_product(matrix_product(direction, of_slow), direction)) / max(total, 1e-12)
    weights = (direction / scale).astype(np.float32)
    angle = mean_direction(weighted_sum(slow, weights))
    if not -np.pi / 2 + _LEAN < angle <= np.pi / 2 + _LEAN:  # to the left, or upwards
        weights = -weights
    return SlowFeature(weights, weighted_sum(local, weights), weighted_sum(slow, weights), share)


def mean_direction(values: ScalarMap) -> float:
    """Direction in which values grow on the whole, radians from along a row towards growing rows."""
    down, across = (float(one.mean(dtype=np.float64)) for one in gradients(values))
    return float(arctan2(down, across))


def progression_in(made: Image, exemplar: Image) -> ScalarMap:
    """Progression of each place of a result: the rank, 0..1, that its slow feature would have in the exemplar.

    Of the grid where it was measured, in windows of as many px as those of the exemplar.
    """
    feature = slow_feature(exemplar)
    factor = measured_factor(exemplar.height, exemplar.width)
    planes, valid = statistics(made, factor)
    window = _WINDOW * factor * min(exemplar.height, exemplar.width)
    value = weighted_sum(window_means(planes, valid, window), feature.weights)
    ordered = np.sort(feature.local.ravel())
    return (np.searchsorted(ordered, value.ravel()) / len(ordered)).reshape(value.shape).astype(np.float32)


def weighted_sum(planes: Float32[np.ndarray, "p q k"], weights: np.ndarray) -> ScalarMap:
    """Sum of the planes, each times its weight."""
    return np.ascontiguousarray(sum(planes[..., place] * weight for place, weight in enumerate(weights)))


def ranks(values: ScalarMap, counted: Mask | None) -> ScalarMap:
    """Share of the counted pixels whose value is smaller, half of those that have the same among them, 0..1."""
    ordered = np.sort(values[np.ones(values.shape, bool) if counted is None else counted])
    below, upto = (np.searchsorted(ordered, values.ravel(), side) for side in ("left", "right"))
    return ((below + upto) / (2 * max(1, len(ordered)))).reshape(values.shape).astype(np.float32)


def pictured(progression: ScalarMap, lightness: ScalarMap | None = None) -> Image:
    """A progression, 0..1, in hues from blue through green to yellow; NaN is grey.

    Parameters
    ----------
    lightness : CIELAB units, that shines through; none gets lighter with the progression.
    """
    asked = ~np.isnan(progression)
    value = np.where(asked, progression, np.float32(0.5))
    hue = _HUES[0] + (_HUES[1] - _HUES[0]) * value
    chroma = np.where(asked, _CHROMA, 0)
    shown = 35 + 50 * value if lightness is None else 30 + 0.5 * lightness
    lab = np.stack([shown, chroma * cos(hue), chroma * sin(hue)], axis=2).astype(np.float32)
    return Image(np.clip(linear_from_lab(lab), 0, 1), ("R", "G", "B"))


def _covariance(values: np.ndarray) -> np.ndarray:
    centred = np.asarray(values, np.float64) - values.mean(axis=0, dtype=np.float64)
    return np.asarray(square_sums(centred) / len(centred))
