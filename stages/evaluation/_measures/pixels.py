"""Measures of single pixels and their nearest neighbours: colour, sharpness, smoothness, seams."""

import numpy as np
from jaxtyping import Bool, Float32

from texloom.stages.arrays import Mask
from texloom.stages.evaluation._measures.pictures import Picture

_QUANTILES = 1024
_MOST = 1 << 18  # pixels of which quantiles are taken


def quantiles(values: Float32[np.ndarray, "n k"], count: int = _QUANTILES) -> Float32[np.ndarray, "count k"]:
    """``count`` evenly spaced quantiles of each column."""
    ordered = np.sort(values, axis=0)
    ranks = (np.arange(count) + 0.5) / count * (len(values) - 1)
    low = ranks.astype(np.intp)
    share = (ranks - low)[:, None].astype(np.float32)
    return np.asarray(ordered[low] * (1 - share) + ordered[np.minimum(low + 1, len(values) - 1)] * share)


def _colors(picture: Picture) -> np.ndarray:
    values = picture.colors
    if len(values) > _MOST:
        values = values[np.random.default_rng(0).integers(0, len(values), _MOST)]
    return np.asarray(quantiles(values))


def color_distance(one: Picture, other: Picture) -> Float32[np.ndarray, "3"]:
    """Wasserstein distance between the distributions of L, a and b, CIELAB units."""
    return np.asarray(np.abs(_colors(one) - _colors(other)).mean(axis=0))


def color_spread(picture: Picture) -> float:
    """Mean distance from the mean colour, CIELAB units, mean of the channels: what a plain picture scores."""
    values = picture.colors
    return float(np.abs(values - values.mean(axis=0, dtype=np.float64)).mean())


def laplacians(tone: Float32[np.ndarray, "h w"], levels: int = 3, counted: Mask | None = None) -> list[float]:
    """Mean absolute Laplacian at full, half, quarter ... size, away from the border and from what is not counted.

    Sizes at which nothing is left are left out.
    """
    import cv2

    means = []
    for _ in range(levels):
        if min(tone.shape) < 3:
            break
        response = np.abs(cv2.Laplacian(tone, cv2.CV_32F)[1:-1, 1:-1])
        if counted is not None:
            response = response[cv2.erode(counted.astype(np.uint8), np.ones((3, 3), np.uint8))[1:-1, 1:-1] > 0]
            counted = halved(counted)
        if not response.size:
            break
        means.append(float(response.mean(dtype=np.float64)))
        tone = cv2.pyrDown(tone)
    return means


def halved(mask: Bool[np.ndarray, "h w"]) -> Bool[np.ndarray, "H W"]:
    """True at the pixels of a picture of half the size that are made of true ones alone."""
    import cv2

    return np.asarray(cv2.erode(mask.astype(np.uint8), np.ones((5, 5), np.uint8))[::2, ::2] > 0)


def blurred(tone: Float32[np.ndarray, "h w *c"], deviation: float) -> Float32[np.ndarray, "h w *c"]:
    """Gaussian blur; ``deviation`` in px."""
    import cv2

    return np.asarray(cv2.GaussianBlur(tone, (0, 0), deviation))


def local_contrast(tone: Float32[np.ndarray, "h w"], side: int) -> Float32[np.ndarray, "p q"]:
    """Standard deviation in every window of ``side`` px that lies inside the picture."""
    import cv2

    mean = cv2.boxFilter(tone, cv2.CV_64F, (side, side))
    square = cv2.sqrBoxFilter(tone, cv2.CV_64F, (side, side))
    before, after = side // 2, side - side // 2 - 1
    inside = np.s_[before : tone.shape[0] - after, before : tone.shape[1] - after]
    return np.sqrt(np.maximum(square - mean * mean, 0)[inside]).astype(np.float32)


def seam(lab: Float32[np.ndarray, "h w 3"]) -> tuple[float, float]:
    """How much the picture jumps where it wraps around; all of it counts.

    Returns
    -------
    ratio : mean jump across the seam by the mean jump between neighbours inside; the worse of the two axes.
    rank : share of inner lines with a smaller jump than the seam; 0.5 is ideal.
    """
    ratios, ranks = [], []
    for axis in (0, 1):
        inner = np.abs(np.diff(lab, axis=axis)).mean(axis=(1 - axis, 2))
        wrap = float(np.abs(np.take(lab, 0, axis) - np.take(lab, -1, axis)).mean())
        mean = float(inner.mean())
        ratios.append(wrap / mean if mean > 0 else 1.0)
        ranks.append(float((inner < wrap).mean()))
    return max(ratios), max(ranks)
