"""Parts of a picture that the rest of it does not explain, at reduced size."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator
from typing import TypeAlias

import numpy as np
from jaxtyping import Bool, Float32

from texloom.stages.analysis.one_off.foreign_outlines import likewise, outlined
from texloom.stages.analysis.one_off.unlikeness import unlikeness
from texloom.stages.analysis.regularity.mean_cell import mean_cell
from texloom.stages.common.grids.growing import convex_hull
from texloom.stages.common.grids.pyramid import reduced, resize, resized_mask
from texloom.stages.numerics.filters import gaussian_blur
from texloom.stages.numerics.matrices import determinant
from texloom.stages.vocabulary.arrays import Image, Mask, ScalarMap, Vectors
from texloom.stages.vocabulary.color import lab_from_linear
from texloom.stages.vocabulary.masks import fill_excluded
from texloom.stages.vocabulary.progress import Progress, report

_SIDE = 480  # px of the longer side, at which it is searched
_CELL, _FINEST = 24, 960  # px of a cell, and of the longer side at most, at which the mean cell is taken
_SCREENED, _SLACK = 240, 0.9  # px of the longer side of a quick look, and share of the threshold there
_SCREENED_PLACES = 1000  # that are compared in it
_ODD, _ODD_SHARE = 3.0, 0.004  # times the usual difference of cells, and share of the picture that has it
_WINDOWS = 24, 48  # deviations of the windows that are compared: the side over these
_GROWS = 0.6  # of the threshold, down to which a foreign part reaches
_SURE = 0.4  # share of the first parts that reaches it: drifts of tone rise slowly
_CERTAIN = 2.0  # times the threshold, from which colours need not differ
_SURE_LOOK, _LEFT = 1.5, 0.5  # of the threshold: looks so unlike all others count where the mean cell leaves this
_LEAST = 0.01  # share of the picture that is a part
_CONVEX = 0.6  # share of its convex hull; two shutters under a lintel have .63
_PIECE = 0.01  # share of the picture that is left between foreign parts
_EXPLAINS = 0.5  # median correlation of the cells with their median from which it explains the picture
_MIN_CELLS = 6.0  # of a lattice, for a mean
_SMALL = 16  # cells along a side, and px of one, from which these are judged with those around them
_MARGIN = 2.0  # px at which it is searched, by which masks are wider: borders are soft
_FINE = 1 / 12  # deviation of the window in a cell, of the shorter generator
_FINEST_WINDOWS = 160  # the side over that is the least deviation of the window: one of fewer pixels is chance
_NOTICED = 1.5  # CIELAB
_TINT = np.array([25.0, 8.0, 8.0], np.float32)  # CIELAB by which light may change a cell
_USUAL_TINTS, _LEAST_TINT = 6.0, np.array([6.0, 3.0, 3.0], np.float32)  # times the median of cells, and CIELAB

Searched: TypeAlias = tuple[Float32[np.ndarray, "H W 3"], Bool[np.ndarray, "H W"]]
"""a picture as it is searched: CIELAB, and where it counts"""


def looks_foreign(image: Image, valid: Mask, generators: Vectors | None, threshold: float) -> bool:
    """Whether a search may find parts at ``threshold``; a quick look at half the size.

    In a lattice a part also differs from most of the cells around it, in the mean of a window.
    """
    lab, small = as_searched(image, valid, _SCREENED)
    side = float(np.sqrt(small.sum()))
    looks = [unlikeness(lab, small, max(1.5, side / windows), places=_SCREENED_PLACES) for windows in _WINDOWS]
    unlike = np.maximum.reduce(looks)
    found = _parts(unlike, small, _SLACK * threshold, 0.0)
    if not found.any() or generators is None or len(generators) < 2:
        return bool(found.any())
    factor = np.array(small.shape) / (image.height, image.width)
    away = _from_cells_around(lab, small, generators * factor)
    return bool((found & (away > _ODD * np.median(away[small]) + _NOTICED)).sum() >= _ODD_SHARE * small.sum())


def _from_cells_around(lab: Float32[np.ndarray, "h w 3"], valid: Mask, frame: np.ndarray) -> ScalarMap:
    """The median CIELAB difference of each pixel to those a cell away in eight directions."""
    deviation = max(1.0, 2 * _FINE * float(np.hypot(*frame.T).min()))
    weight = np.maximum(gaussian_blur(valid.astype(np.float32), deviation), np.float32(1e-6))
    means = gaussian_blur(lab * valid[..., None], deviation) / weight[..., None]
    others = []
    for row, column, known in itertools.islice(_cells_around(valid, frame), 1, None):
        differs = np.abs(means - means[row, column]).sum(axis=2)
        others.append(np.where(known, differs, np.float32(np.inf)))
    ordered = np.sort(np.stack(others), axis=0)  # those not known are last
    known = np.isfinite(ordered).sum(axis=0)
    median = np.take_along_axis(ordered, (np.maximum(known - 1, 0) // 2)[None], axis=0)[0]
    return np.asarray(np.where(valid & (known > 0), median, 0), np.float32)


def as_searched(image: Image, valid: Mask, side: int = _SIDE) -> Searched:
    """CIELAB at which is searched, and where it counts."""
    return lab_from_linear(reduced(np.ascontiguousarray(fill_excluded(image).color), side)), counted(valid, side)


def counted(valid: Mask, side: int = _SIDE) -> Bool[np.ndarray, "H W"]:
    """A mask at the size at which is searched."""
    return np.asarray(reduced(valid[..., None].astype(np.float32), side)[..., 0] > 0.5)


def foreign_search(
    image: Image, valid: Mask, generators: Vectors | None, threshold: float, less: float = 0.75
) -> tuple[ScalarMap, Mask, bool]:
    """How unlike each pixel is, whether it is foreign, and whether a mean cell explains the picture.

    Parameters
    ----------
    image : a surface from the front, or an exemplar; searched at 480 px. The mean cell is taken where cells have
        24 px, at up to 960 px; from 16 along a side it explains the picture where it explains means of nine.
    valid : where it counts.
    generators : of its lattice; less than two count as none. What its mean cell explains is not foreign.
    threshold : times as far from what explains it as is usual, from which on a part is foreign.
    less : share of the threshold that counts where some part was found: others are likelier then.

    References
    ----------
    Ours; see `unlikeness`, `mean_cell` and `outlined`.
    """
    lab, small = as_searched(image, valid)
    cell = None
    if generators is not None and len(generators) == 2:
        cell = _unlike_cell_of(image, valid, generators, (lab, small))
    side = float(np.sqrt(small.sum()))
    unlike = np.zeros(small.shape, np.float32)
    found = np.zeros(small.shape, np.bool_)
    for done, share, most in ((0.2, 1.0, _SURE), (0.5, less, 0.0)):
        report(Progress(done))
        looks = [unlikeness(lab, small, max(1.5, side / windows), found) for windows in _WINDOWS]
        unlike = np.maximum.reduce(looks)
        if cell is not None:
            unlike = _beside_lattice(unlike, cell[0], small, threshold)
        found = found | _parts(unlike, small, share * threshold, most)
        if not found.any():
            break
    planes = lab if cell is None else cell[1]
    found = outlined(planes, small, found, unlike >= _CERTAIN * threshold)  # windows blur outlines
    found = found | likewise(planes, small, found, _LEAST * float(small.sum()))
    foreign = _closed(found, small, _MARGIN)
    both = resize(np.stack([foreign, unlike], axis=2).astype(np.float32), image.height, image.width, bilinear=True)
    return np.ascontiguousarray(both[..., 1]), both[..., 0] > 0.5, cell is not None


def with_margin(found: Mask, shape: tuple[int, int]) -> Bool[np.ndarray, "H W"]:
    """Parts at the size at which is searched, a little wider, at full size."""
    return resized_mask(_grown(found, _MARGIN), *shape)


def _unlike_cell_of(
    image: Image, valid: Mask, generators: Vectors, searched: Searched
) -> tuple[Float32[np.ndarray, "H W"], Float32[np.ndarray, "H W 3"]] | None:
    """See `_unlike_cell`: at a size where a cell has enough pixels, and of that of ``searched`` then."""
    longer, shorter = max(image.height, image.width), float(np.hypot(*generators.astype(np.float64).T).min())
    side = max(_SIDE, math.ceil(_CELL / shorter * longer))
    is_finer = _SIDE < side <= _FINEST
    lab, small = as_searched(image, valid, side) if is_finer else searched
    factor = np.array(lab.shape[:2]) / (image.height, image.width)
    made = _unlike_cell(lab, small, (generators * factor).astype(np.float32))
    if made is None or not is_finer:
        return made
    height, width = searched[1].shape
    both = resize(np.concatenate([made[0][..., None], made[1]], axis=2), height, width, bilinear=True)
    return np.ascontiguousarray(both[..., 0]), np.ascontiguousarray(both[..., 1:])


def _unlike_cell(
    lab: Float32[np.ndarray, "h w 3"], valid: Mask, generators: Vectors
) -> tuple[ScalarMap, Float32[np.ndarray, "h w 3"]] | None:
    """How many times farther from the mean cell each pixel is than is usual, and what the mean cell leaves of it.

    None where the mean cell explains too little.
    """
    frame = generators.astype(np.float64)
    area, shorter = abs(float(determinant(frame))), float(np.hypot(*frame.T).min())
    if valid.sum() < _MIN_CELLS * area or shorter < 6:
        return None
    cell = mean_cell(lab, generators, valid)
    light = lab[..., 0]
    if valid.sum() >= _SMALL * _SMALL * area and shorter >= _SMALL:  # tinier cells tell no pipe from their tints
        light = _with_cells_around(light, valid, frame)
    if cell.explained(light, valid) < _EXPLAINS:
        return None
    tint = cell.per_cell(lab - cell.expected, valid)
    most = np.clip(_USUAL_TINTS * np.median(np.abs(tint[valid]), axis=0), _LEAST_TINT, _TINT)
    tint = np.clip(tint, -most, most)
    toned = lab - tint
    left = toned - np.clip(toned, cell.lowest, cell.highest)
    rest = np.abs(left).mean(axis=2)
    usual = np.nan_to_num(cell.deviation)[cell.phase[..., 0], cell.phase[..., 1]]
    deviation = max(1.0, _FINE * shorter, max(valid.shape) / _FINEST_WINDOWS)
    counted = valid.astype(np.float32)
    weight = np.maximum(gaussian_blur(counted, deviation), np.float32(1e-6))
    mean, expected = (gaussian_blur(plane * counted, deviation) / weight for plane in (rest, usual))
    unlike = np.where(valid, 2 * mean / (expected + np.float32(_NOTICED)), 0)
    return np.asarray(unlike, np.float32), np.asarray(left, np.float32)


def _with_cells_around(plane: ScalarMap, valid: Mask, frame: np.ndarray) -> ScalarMap:
    """The mean of each pixel and those a cell away in eight directions, so that what repeats outweighs grain."""
    total, count = np.zeros((2, *valid.shape), np.float32)
    for row, column, known in _cells_around(valid, frame):
        total += np.where(known, plane[row, column], np.float32(0))
        count += known
    return np.asarray(total / np.maximum(count, 1), np.float32)


def _cells_around(valid: Mask, frame: np.ndarray) -> Iterator[tuple[np.ndarray, np.ndarray, Mask]]:
    """The places themselves, and those a cell away in eight directions: row, column, and whether it is known."""
    rows, columns = np.indices(valid.shape)
    for first, second in ((0, 0), (0, 1), (0, -1), (1, 0), (-1, 0), (1, 1), (-1, -1), (1, -1), (-1, 1)):
        down, across = (int(value) for value in np.rint(first * frame[0] + second * frame[1]))
        row, column = rows + down, columns + across
        inside = (row >= 0) & (row < len(rows)) & (column >= 0) & (column < valid.shape[1])
        row, column = np.clip(row, 0, len(rows) - 1), np.clip(column, 0, valid.shape[1] - 1)
        yield row, column, inside & valid[row, column]


def _beside_lattice(looks: ScalarMap, cell: ScalarMap, valid: Mask, threshold: float) -> ScalarMap:
    """How unlike each pixel is both to other looks and to the mean cell: the lesser of both.

    Where a look is surely foreign, half of the threshold is enough of the mean cell, which parts no darker than its
    own gaps never leave far; there the look counts. Of 18 regular exemplars the most unlike look was 5.9 times as
    far as usual, and the mean cell left .2 there; bolts on a tread plate had 6.3 to 7.6, and 2.3 to 2.8.
    """
    import cv2

    both = np.minimum(looks, cell)
    parts = _parts(looks, valid, threshold, 0.0)
    count, labels = cv2.connectedComponents(parts.astype(np.uint8), connectivity=4)
    for label in range(1, count):
        part = labels == label
        if looks[part].max() >= _SURE_LOOK * threshold and cell[part].max() >= _LEFT * threshold:
            both[part] = looks[part]
    return both


def _parts(unlike: ScalarMap, valid: Mask, threshold: float, sure: float) -> Mask:
    """Parts that are nearly as unlike as the threshold, and not small, of which more than a share reaches it."""
    import cv2

    near = (unlike >= max(1.5, _GROWS * threshold)) & valid
    count, labels, boxes, _ = cv2.connectedComponentsWithStats(near.astype(np.uint8), connectivity=4)
    reach = np.bincount(labels.ravel(), (unlike >= threshold).ravel().astype(np.float64), minlength=count)
    large = (boxes[:, cv2.CC_STAT_AREA] >= _LEAST * valid.sum()) & (reach > sure * boxes[:, cv2.CC_STAT_AREA])
    large[0] = False
    return np.asarray(large[labels])


def _closed(found: Mask, valid: Mask, reach: float) -> Mask:
    """Foreign parts with a margin, their holes filled, and without small pieces of the rest."""
    import cv2

    if not found.any():
        return found
    rest = (valid & ~_filled(_grown(found, reach), valid)).astype(np.uint8)
    _, labels, boxes, _ = cv2.connectedComponentsWithStats(rest, connectivity=4)
    small = boxes[:, cv2.CC_STAT_AREA] < _PIECE * valid.sum()
    small[0] = True  # what is foreign, or was not known
    return np.asarray(small[labels])


def _filled(found: Mask, valid: Mask) -> Mask:
    """Parts that fill most of their convex hull with all of it: a pane that mirrors the sky between shutters.

    Not parts at the border of what is known, such as a street with a door above it.
    """
    import cv2

    count, labels, boxes, _ = cv2.connectedComponentsWithStats(found.astype(np.uint8), connectivity=4)
    filled = found.copy()
    whole = np.arange(count) > 0
    whole[labels[~_within(valid)]] = False
    for label in np.flatnonzero(whole):
        hull = convex_hull(labels == label)
        if boxes[label, cv2.CC_STAT_AREA] >= _CONVEX * np.count_nonzero(hull):
            filled |= hull
    return filled


def _within(valid: Mask) -> Mask:
    """What is known and not at the border of that."""
    import cv2

    known = np.pad(valid.astype(np.uint8), 1)
    return cv2.erode(known, np.ones((3, 3), np.uint8))[1:-1, 1:-1] > 0


def _grown(found: Mask, reach: float) -> Mask:
    """With what is within ``reach`` px."""
    import cv2

    side = 2 * max(1, round(reach)) + 1
    return cv2.dilate(found.astype(np.uint8), cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (side, side))) > 0
