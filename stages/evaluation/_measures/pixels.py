"""Measures of pixels and their neighbours: colour, sharpness, smoothness, seams."""

import dataclasses
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float32, Float64

from texloom.stages.common.grids.working_size import reduction
from texloom.stages.common.similarity.patch_distance import blurred
from texloom.stages.evaluation._measures.pictures import (
    FLAT,
    MeasuredPicture,
    UnmeasurableError,
    any_true,
    between_halves,
    halves,
    require_side,
    require_variation,
)
from texloom.stages.evaluation._measures.table import Figures, share
from texloom.stages.evaluation._measures.task import Task, sampling
from texloom.stages.vocabulary.arrays import Mask
from texloom.stages.vocabulary.facts import TORUS, Wraps

_QUANTILES = 1024
_STRIP = 256  # rows of a large picture whose contrast is computed at once
_MAX_PIXELS = 1 << 18  # of which quantiles are taken


def quantiles(values: Float32[np.ndarray, "n k"], count: int = _QUANTILES) -> Float32[np.ndarray, "count k"]:
    """``count`` evenly spaced quantiles of each column."""
    ordered = values.T.copy()  # values that lie side by side are sorted in less time
    ordered.sort(axis=1)
    ranks = (np.arange(count) + 0.5) / count * (len(values) - 1)
    low = ranks.astype(np.intp)
    share = (ranks - low).astype(np.float32)
    between = ordered[:, low] * (1 - share) + ordered[:, np.minimum(low + 1, len(values) - 1)] * share
    return np.ascontiguousarray(between.T)


def _colors(picture: MeasuredPicture) -> np.ndarray:
    values = picture.colors
    if len(values) > _MAX_PIXELS:
        values = values[np.random.default_rng(0).integers(0, len(values), _MAX_PIXELS)]
    return np.asarray(quantiles(values))


def color_distance(one: MeasuredPicture, other: MeasuredPicture) -> Float32[np.ndarray, "3"]:
    """Wasserstein distance between the distributions of L, a and b, CIELAB units."""
    return np.asarray(np.abs(_colors(one) - _colors(other)).mean(axis=0))


def color_spread(picture: MeasuredPicture) -> float:
    """Mean distance from the mean colour, CIELAB units, mean of the channels; that of a plain picture."""
    values = picture.colors[:: reduction(*picture.tone.shape) ** 2]
    return float(np.abs(values - values.mean(axis=0, dtype=np.float64)).mean())


def laplacians(tone: Float32[np.ndarray, "h w"], levels: int = 3, counted: Mask | None = None) -> list[float]:
    """Mean absolute Laplacian at full, half, quarter ... size; without the border and pixels that are not counted.

    Sizes at which no pixel is left are omitted.
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
    """True at pixels of the picture of half size that derive from true pixels only."""
    import cv2

    return np.asarray(cv2.erode(mask.astype(np.uint8), np.ones((5, 5), np.uint8))[::2, ::2] > 0)


def local_contrast(tone: Float32[np.ndarray, "h w"], side: int) -> Float32[np.ndarray, "p q"]:
    """Standard deviation in every window of ``side`` px that lies inside the picture."""
    import cv2

    if len(tone) > _STRIP + side and reduction(*tone.shape) > 1:
        tops = range(0, len(tone) - side + 1, _STRIP)
        return np.concatenate([local_contrast(tone[top : top + _STRIP + side - 1], side) for top in tops])
    mean = cv2.boxFilter(tone, cv2.CV_64F, (side, side))
    square = cv2.sqrBoxFilter(tone, cv2.CV_64F, (side, side))
    before, after = side // 2, side - side // 2 - 1
    inside = np.s_[before : tone.shape[0] - after, before : tone.shape[1] - after]
    return np.sqrt(np.maximum(square - mean * mean, 0)[inside]).astype(np.float32)


class Seam(NamedTuple):
    """The line at which a picture wraps around, among its inner lines; the worse of the axes that do."""

    deviations: float
    """how far its excess jump is above the inner lines' median, in their deviations: the distance of the 0.84
    quantile to the median, or half that of the 0.98 quantile where this is more"""
    ratio: float
    """its excess jump over the mean of the inner lines"""
    rank: float
    """share of the inner lines with a smaller excess jump; 0.5 is ideal"""


def excess_jumps(lab: Float32[np.ndarray, "h w 3"], axis: int) -> Float64[np.ndarray, "*n"]:
    """Mean jump in excess of the jumps before and after it, of each line along an axis; the first is the border.

    A jump is the absolute difference of neighbours, where the picture wraps around. Contours are blurred over
    several pixels and have no jump in excess; where two pictures meet, the jump is one pixel wide.
    """
    jumps = np.abs(lab - np.roll(lab, 1, axis))
    excess = jumps - np.maximum(np.roll(jumps, 1, axis), np.roll(jumps, -1, axis))
    return np.asarray(np.maximum(excess, 0).mean(axis=(1 - axis, 2), dtype=np.float64))


def seam(lab: Float32[np.ndarray, "h w 3"], wraps: Wraps = TORUS) -> Seam:
    """How much the borders across which a picture of at least 8 px continues stand out."""
    axes = []
    for axis in np.flatnonzero(wraps):
        border, inner = np.split(excess_jumps(lab, int(axis)), [1])
        wrap, inner = float(border[0]), inner[1:-1]  # those beside the border depend on it
        median, high, highest = (float(quantile) for quantile in np.quantile(inner, (0.5, 0.84, 0.98)))
        # few lines along straight contours, as of mortar, are far above the others
        spread = max(high - median, (highest - median) / 2, 0.05 * median, FLAT)
        mean = float(inner.mean())
        axes.append(Seam((wrap - median) / spread, wrap / mean if mean > 0 else 1.0, float((inner < wrap).mean())))
    return max(axes)


def colors(task: Task) -> Figures:
    """Distance between the distributions of colours."""
    task.require_all_made()
    require_side(2, task.exemplar)
    channels = color_distance(task.exemplar, task.result)
    visible = 2.3 / 3  # a just noticeable difference, spread over three channels
    ceiling = max(color_spread(task.exemplar), visible)
    more = {"channels": dict(zip("Lab", map(float, channels), strict=True))}
    floor = between_halves(task.exemplar, lambda one, other: float(color_distance(one, other).mean()))
    return Figures(float(channels.mean()), sampling(task, floor), ceiling, more)


def sharpness(task: Task) -> Figures:
    """Fine detail relative to the exemplar's."""
    require_variation(task.exemplar)
    require_side(8, task.exemplar, task.result)
    exemplar = laplacians(task.exemplar.tone, counted=task.exemplar.counted)
    result = laplacians(task.result.tone, counted=task.result.counted)
    if not (exemplar and result):
        raise UnmeasurableError("masks leave too little")
    if exemplar[0] < FLAT:
        raise UnmeasurableError("the exemplar has no detail")
    levels = [one / max(other, 1e-9) for one, other in zip(result, exemplar, strict=False)]
    soft = laplacians(blurred(task.exemplar.tone, 1.0), 1, task.exemplar.counted)[0] / exemplar[0]
    off = float(np.log(max(levels[0], 1e-9)))
    worst = np.log(2) if off > 0 else max(-np.log(max(soft, 1e-9)), 0.2)
    score = share(abs(off), np.log(1.05), worst)
    more = {"levels": levels, "target": [0.95, 1.05]}  # at twice the detail the score is 0
    return Figures(levels[0], 1.0, soft, more, score)


def smoothness(task: Task) -> Figures:
    """Share of windows as smooth as the exemplar's smoothest tenth."""
    require_variation(task.exemplar)
    side = task.window
    require_side(4 * side, task.exemplar)
    require_side(2 * side, task.result)
    contrast = _contrast(task.exemplar, side)
    limit = max(float(np.quantile(contrast, 0.1)), 0.05 * float(contrast.mean()))

    def smooth(picture: MeasuredPicture) -> float:
        return float((_contrast(picture, side) < limit).mean())

    floor = max(smooth(half) for pair in halves(task.exemplar) for half in pair)
    soft = dataclasses.replace(task.exemplar, tone=blurred(task.exemplar.tone, side / 4))
    return Figures(smooth(task.result), floor, smooth(soft))


def _contrast(picture: MeasuredPicture, side: int) -> np.ndarray:
    """Standard deviations in the windows that count."""
    contrast = local_contrast(picture.tone, side)
    whole = picture.windows(side, side)
    if not any_true(whole):
        raise UnmeasurableError(f"masks leave no window of {side} px")
    return np.asarray(contrast if whole is None else contrast[whole])


def seams(task: Task) -> Figures:
    """Jump across the border of a result that wraps around."""
    if not task.wraps:
        raise UnmeasurableError("the result is not meant to wrap around")
    require_side(8, task.exemplar, task.result)
    worst = seam(task.result.lab, task.wraps)
    return Figures(worst.deviations, 1.5, 5.0, {"ratio": worst.ratio, "rank": worst.rank})
