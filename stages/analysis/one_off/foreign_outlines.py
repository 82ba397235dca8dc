"""Where foreign parts end, by the pixels that the rest of a picture does not explain."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float32, Float64, Int64

from texloom.stages.kernels.core.elementary_functions import log
from texloom.stages.numerics.filters import gaussian_blur, gradients
from texloom.stages.vocabulary.arrays import Mask

_BINS = 12  # of each feature, between its extremes but for `_TAIL` of the pixels on either side
_TAIL = 0.005
_PASSES = 8  # of telling the pixels apart; outlines then move by less than a pixel
_SURE = 3.0  # logarithm of odds that one pixel counts at most
_NEARBY = 2.0  # deviation, px, over which the odds of pixels are averaged: less than the width of a pipe
_BLUR = 1.5  # deviation, px, over which steepness is averaged
_LEAST = 0.1  # share of a part that its pixels must tell apart; the part is kept whole where they do not
_STAIN = 0.6  # overlap of distributions: stains and drifts had .66 to .90, objects .38 at most
_LIKELY = 0.6  # mean logarithm of odds of another part: the windows of a wall had .9, its joints like a pipe less
_LEAF, _CERTAIN = 0.1, 1.2  # share of the least part that a part of such mean odds has: leaves beside a plant
_PIECE = 0.02  # share of a part below which a piece of it is chance


def outlined(planes: Float32[np.ndarray, "h w c"], valid: Mask, found: Mask, sure: Mask) -> Mask:
    """The pixels of ``found`` that look unlike the rest, one by one; whole parts where none can be told.

    Windows in which looks are compared make foreign parts wider than they are. Colours and steepness of the pixels
    in a part and of those beyond all parts have two distributions; pixels of a part belong to it where, averaged
    nearby, they are likelier by its own. What is left makes its distribution clearer, so that this is repeated. A
    part with no sure pixel whose distribution is mostly that of the rest is a stain of the surface, and dropped.

    Parameters
    ----------
    planes : CIELAB, or what a mean cell leaves of it.
    valid : where the picture is known.
    found : the parts, too wide.
    sure : pixels so unlike the rest that their parts are foreign whatever their colours are.

    References
    ----------
    [Rother2004]_ section 3: distributions of colour of both sides, estimated from a rough outline by turns with
    the outline. Histograms stand for mixtures, and a mean of odds for the cut. The overlap is Bhattacharyya's
    coefficient.
    """
    import cv2

    rest = valid & ~found
    if not found.any() or not rest.any():
        return found
    cells, count = _bins(planes, valid)
    usual = _density(cells[rest], count)
    _, labels = cv2.connectedComponents(found.astype(np.uint8), connectivity=4)
    made = np.zeros_like(found)
    for label in range(1, int(labels.max()) + 1):
        part = labels == label
        inside = _of_part(cells, part, usual, count)
        if (part & sure).any() or _shared(cells, inside, valid, count) < _STAIN:
            made |= inside
    return made


def likewise(planes: Float32[np.ndarray, "h w c"], valid: Mask, found: Mask, least: float) -> Mask:
    """Parts beyond ``found`` whose pixels look more like it than like the rest: the other windows of a wall.

    Parameters
    ----------
    planes, valid : see `outlined`.
    found : foreign parts, as they are outlined.
    least : pixels of a part; a tenth where it is surely like ``found``, as single leaves beside a plant are.
    """
    import cv2

    rest = valid & ~found
    if not found.any() or not rest.any():
        return np.zeros_like(found)
    cells, count = _bins(planes, valid)
    odds = log(_density(cells[found & valid], count)) - log(_density(cells[rest], count))
    each = np.where(valid, np.clip(odds, -_SURE, _SURE).astype(np.float32)[cells], np.float32(0))
    near = gaussian_blur(each, 2 * _NEARBY)
    of_part = ((near > 0) & rest).astype(np.uint8)
    count, labels, boxes, _ = cv2.connectedComponentsWithStats(of_part, connectivity=4)
    sums = np.bincount(labels.ravel(), near.ravel().astype(np.float64), count)
    area = boxes[:, cv2.CC_STAT_AREA]
    likely = np.where(area >= least, _LIKELY, np.where(area >= _LEAF * least, _CERTAIN, np.inf))
    large = sums >= likely * area
    large[0] = False
    return np.asarray(large[labels])


def _bins(planes: Float32[np.ndarray, "h w c"], valid: Mask) -> tuple[Int64[np.ndarray, "h w"], int]:
    """The bin of each pixel by its colours and steepness, and the number of these."""
    steep = np.sqrt(np.square(np.stack(gradients(planes[..., 0], (1, 2, 1)))).sum(axis=0))
    features = np.concatenate([planes, gaussian_blur(steep, _BLUR)[..., None]], axis=2)
    return _cells(features, valid), features.shape[2]


def _of_part(cells: Int64[np.ndarray, "h w"], part: Mask, usual: Float64[np.ndarray, "n"], count: int) -> Mask:  # type: ignore[name-defined]
    """The pixels of one part."""
    inside = part
    for _ in range(_PASSES):
        odds = log(_density(cells[inside], count)) - log(usual)
        each = np.clip(odds, -_SURE, _SURE).astype(np.float32)[cells]
        inside = part & (gaussian_blur(np.where(part, each, np.float32(-_SURE)), _NEARBY) > 0)
        if inside.sum() < _LEAST * part.sum():
            return part
    return _without_pieces(inside, _PIECE * float(part.sum()))


def _shared(cells: Int64[np.ndarray, "h w"], inside: Mask, valid: Mask, count: int) -> float:
    """How far the distributions of a part and of all else overlap, 0..1."""
    part, rest = (_density(cells[mask], count) for mask in (inside, valid & ~inside))
    return float(np.sqrt(part * rest).sum())


def _without_pieces(inside: Mask, least: float) -> Mask:
    import cv2

    _, labels, boxes, _ = cv2.connectedComponentsWithStats(inside.astype(np.uint8), connectivity=8)
    large = boxes[:, cv2.CC_STAT_AREA] >= least
    large[0] = False
    return np.asarray(large[labels])


def _cells(features: Float32[np.ndarray, "h w k"], valid: Mask) -> Int64[np.ndarray, "h w"]:
    """The bin of each pixel in a histogram of all features."""
    number = np.zeros(valid.shape, np.int64)
    for plane in np.moveaxis(features, 2, 0):
        low, high = np.quantile(plane[valid], (_TAIL, 1 - _TAIL))
        step = np.floor((plane - low) * (_BINS / max(float(high - low), 1.0)))
        number = number * _BINS + np.clip(step, 0, _BINS - 1).astype(np.int64)
    return number


def _density(cells: Int64[np.ndarray, "n"], count: int) -> Float64[np.ndarray, "bins"]:  # type: ignore[name-defined]
    """Share of pixels in each bin and those beside it, never 0."""
    table = np.bincount(cells, minlength=_BINS**count).astype(np.float64).reshape((_BINS,) * count)
    for axis in range(count):
        wide = np.pad(table, [(int(axis == each),) * 2 for each in range(count)], "edge")
        before, after = (np.take(wide, np.arange(start, start + _BINS), axis) for start in (0, 2))
        table = 0.25 * before + 0.5 * table + 0.25 * after
    table = table.reshape(-1) + 1.0 / table.size
    return table / table.sum()
