"""Lines that cross a whole picture once: pipes, cornices, cracks from border to border."""

from __future__ import annotations

import dataclasses

import numpy as np
from jaxtyping import Bool, Float32

from texloom.stages.common.grids.pyramid import reduced
from texloom.stages.vocabulary.arrays import Image, Mask, ScalarMap
from texloom.stages.vocabulary.color import lab_from_linear
from texloom.stages.vocabulary.masks import fill_excluded

_SIDE = 320  # px of the longer side, at which they are searched
_WIDTHS = 1, 3, 6, 12  # px of a line
_BLUR = 5  # px along a line
_SECTIONS = 6  # of a line, of which the second faintest counts: it crosses the whole picture
_NOTICED = 1.5  # CIELAB, added to what the second line stands out by
_BESIDE = 2, 3  # widths, and px, around a line that are no other line
_MARGIN = 2  # px by which lines are wider: their borders are soft
_REACH = 24  # px to both sides of a line that are looked at for its width
_FAINT = 0.3  # of a line's greatest difference, that still is of it
_LEAST_SIDE = 48  # px
_FLOOR = -5.0  # CIELAB a pixel of a line counts at least


@dataclasses.dataclass(frozen=True)
class CrossingLine:
    """The line that stands out most beside the next best one."""

    stands_out: float
    """how many times more it differs from both of its sides than the next line of its kind"""
    mask: Mask
    """of the picture's size"""
    along: int
    """the axis that it crosses: 0 down, 1 across"""


def crossing_line(image: Image, valid: Mask) -> CrossingLine | None:
    """The line across the whole picture that is least like any other; None of small pictures.

    A line is a path from one border to the opposite one, which moves by a pixel at most from each to the next, on
    whose pixels lightness, a or b is higher, or lower, than on both sides, a width away. The best path and the best
    one away from it are compared: joints of bricks, and chains of gaps between pebbles, have others like them,
    a crack or a pipe has none: of 38 exemplars without such lines the best stood out 1.38 times as much.

    Parameters
    ----------
    image : the picture; searched at 320 px.
    valid : where it counts; no line stands out elsewhere.

    References
    ----------
    [Efros2001]_ section 2.1 for the cheapest path; ours else.
    """
    lab = lab_from_linear(reduced(np.ascontiguousarray(fill_excluded(image).color), _SIDE))
    known = reduced(valid[..., None].astype(np.float32), _SIDE)[..., 0] > 0.5
    if min(known.shape) < _LEAST_SIDE:
        return None
    best: tuple[float, int, int, np.ndarray] | None = None
    for along in (0, 1):
        turned = lab if along == 0 else lab.transpose(1, 0, 2)
        shown = known if along == 0 else known.T
        for plane in np.moveaxis(turned, 2, 0):
            for width in _WIDTHS:
                for sign in (-1, 1):
                    found = _path(_standing_out(sign * plane, shown, width), width)
                    if best is None or found[0] > best[0]:
                        best = (found[0], along, width, found[1])
    assert best is not None
    ratio, along, width, path = best
    turned = lab if along == 0 else lab.transpose(1, 0, 2)
    first, last = _extent(turned, path, width)
    offset = np.arange(turned.shape[1])[None] - path[:, None]
    near = (offset >= first - _MARGIN) & (offset <= last + _MARGIN)
    small = near if along == 0 else near.T
    return CrossingLine(ratio, _enlarged(small, valid.shape) & valid, along)


def _extent(
    lab: Float32[np.ndarray, "h w 3"],
    path: np.ndarray,
    width: int,
) -> tuple[int, int]:
    """How far a line reaches left and right of its path, px: as long as its mean colour is not that beside it."""
    reach = np.arange(-_REACH, _REACH + 1)
    columns = path[:, None] + reach
    inside = (columns >= 0) & (columns < lab.shape[1])
    drawn = lab[np.arange(len(path))[:, None], np.clip(columns, 0, lab.shape[1] - 1)]
    count = np.maximum(inside.sum(axis=0), 1)
    profile = (drawn * inside[..., None]).sum(axis=0, dtype=np.float64) / count[:, None]
    beside = profile[np.abs(reach) > _REACH // 2]
    away = np.sqrt(np.square(profile - np.median(beside, axis=0)).sum(axis=1))
    usual = float(np.median(away[np.abs(reach) > _REACH // 2]))
    differs = (away > max(_FAINT * away[np.abs(reach) <= width].max(), 2 * usual)) & inside.any(axis=0)
    differs |= np.abs(reach) <= width // 2
    gaps = np.ones(2 * max(1, width // 4) + 1, np.bool_)
    differs = (
        np.convolve(np.convolve(differs, gaps, "same") == 0, gaps, "same") == 0
    )  # a profile may cross the mean
    ends = np.flatnonzero(~differs)
    left, right = ends[ends < _REACH], ends[ends > _REACH]
    first = -(width // 2) if not len(left) else int(left[-1]) + 1 - _REACH
    last = width // 2 if not len(right) else int(right[0]) - 1 - _REACH
    return first, last


def _standing_out(plane: ScalarMap, shown: Mask, width: int) -> ScalarMap:
    """By how much each pixel is higher than both sides of a line down through it."""
    import cv2

    smooth = cv2.blur(np.ascontiguousarray(plane), (width, 1 if width == 1 else 3), borderType=cv2.BORDER_REFLECT)
    away = width + 1
    sides = np.pad(smooth, ((0, 0), (away, away)), "edge")
    most = np.maximum(sides[:, : -2 * away], sides[:, 2 * away :])
    out = np.maximum(smooth - most, np.float32(_FLOOR))
    return np.asarray(cv2.blur(np.where(shown, out, np.float32(_FLOOR)), (1, _BLUR)), np.float32)


def _path(out: ScalarMap, width: int) -> tuple[float, np.ndarray]:
    """The best path down, and how many times it stands out more than the next."""
    from texloom.stages.kernels.seams.boundary_cut import cheapest_path

    path, other = (np.empty(len(out), np.int64) for _ in range(2))
    rows = np.arange(len(out))
    cheapest_path(-out, path)
    beside = np.abs(np.arange(out.shape[1])[None] - path[:, None]) <= _BESIDE[0] * width + _BESIDE[1]
    cheapest_path(np.where(beside, np.float32(-10 * _FLOOR), -out), other)
    parts = sorted(float(part.mean()) for part in np.array_split(out[rows, path], _SECTIONS))
    second = max(0.0, float(out[rows, other].mean()))
    return parts[1] / (second + _NOTICED), path


def _enlarged(mask: Mask, shape: tuple[int, int]) -> Bool[np.ndarray, "H W"]:
    import cv2

    plane: Float32[np.ndarray, "_ _"] = mask.astype(np.float32)
    return np.asarray(cv2.resize(plane, shape[::-1], interpolation=cv2.INTER_LINEAR) > 0.5)
