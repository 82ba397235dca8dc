"""Steps of tone at joints of the source map: two-tone cells, cut contours, pieces that are lighter or darker."""

import numpy as np
from jaxtyping import Float32

from texloom.stages.common.grids.working_size import reduction
from texloom.stages.common.similarity.patch_distance import Places
from texloom.stages.common.source_maps.source_joints import worst_of_cells
from texloom.stages.evaluation._measures.pictures import (
    Picture,
    UnmeasurableError,
    require_side,
    require_variation,
)
from texloom.stages.evaluation._measures.table import Figures
from texloom.stages.evaluation._measures.task import Task
from texloom.stages.vocabulary.arrays import Correspondence, ScalarMap
from texloom.stages.vocabulary.facts import NOWHERE, Wraps

_SIDE = 9  # px of the squares on both sides of a joint
_REACH = _SIDE // 2 + 1  # px from a joint to the middle of the square beyond it
_INSIDE = np.s_[_SIDE - _REACH : _REACH - _SIDE, _SIDE - _REACH : _REACH - _SIDE]
_STRIP = 256  # rows of a large exemplar
_VISIBLE = 2.3  # CIELAB units; a just noticeable difference
_SLACK = 5  # px about a source within which the exemplar may show the step, as results are bent and blended
_MOST = 1 << 18  # joints along an axis that are measured
_SEEN = 0.5  # from this on a step is seen
_BAD = 0.1  # share of the cells with such a step; blocks joined at random have more, good results .01


def _squares(picture: Picture, wraps: Wraps) -> tuple[Float32[np.ndarray, "H W c"], Float32[np.ndarray, "H W"]]:
    """Mean colours of the squares about the pixels and `_REACH` px around, and the deviations within them."""
    values = _padded(picture.compared, wraps)
    means, squares = _means(values), _means(values * values)
    deviation = np.sqrt(np.maximum(squares - means * means, 0).sum(axis=2))
    return means[_INSIDE], deviation[_INSIDE]


def _padded(values: Float32[np.ndarray, "h w c"], wraps: Wraps) -> Float32[np.ndarray, "H W c"]:
    for axis, wrap in enumerate(wraps):
        margin = [(_SIDE if one == axis else 0,) * 2 for one in range(3)]
        values = np.pad(values, margin, mode="wrap" if wrap else "edge")
    return values


def _means(values: Float32[np.ndarray, "h w c"]) -> Float32[np.ndarray, "h w c"]:
    import cv2

    return cv2.boxFilter(values, -1, (_SIDE, _SIDE)).reshape(values.shape)


def _known_steps(picture: Picture) -> list[Float32[np.ndarray, "h w"]]:
    """`_steps_along` both axes of an exemplar; of a large one in strips, as means take the picture's memory."""
    height, width = picture.tone.shape
    rows = _STRIP if reduction(height, width) > 1 else height
    known = [np.empty((height, width), np.float32) for _ in range(2)]
    for top in range(0, height, rows):
        first = max(0, top - _SIDE)
        means = _means(_padded(picture.compared[first : top + rows + _SIDE], NOWHERE))[_INSIDE]
        for axis, steps in enumerate(known):
            steps[top : top + rows] = _steps_along(means, axis)[top - first :][:rows]
    return known


def _steps_along(means: Float32[np.ndarray, "H W c"], axis: int) -> Float32[np.ndarray, "h w"]:
    """Distance between the means behind and beyond the border after each pixel along an axis."""
    behind, beyond = (_beside(means, axis, offset) for offset in (1 - _REACH, _REACH))
    difference = beyond - behind
    return np.sqrt((difference * difference).sum(axis=2))


def _beside(values: np.ndarray, axis: int, offset: int) -> np.ndarray:
    """The values ``offset`` px further along an axis, without the margin of `_squares`."""
    place = [np.s_[_REACH:-_REACH], np.s_[_REACH:-_REACH]]
    place[axis] = np.s_[_REACH + offset : values.shape[axis] - _REACH + offset]
    return values[tuple(place)]


def joints_along(match: Correspondence, axis: int, wraps: bool) -> Places:
    """The pixels whose next neighbour along an axis is not the neighbour of their source."""
    following = np.roll(match, -1, axis)
    kept = (following[..., axis] == match[..., axis] + 1) & (following[..., 1 - axis] == match[..., 1 - axis])
    if not wraps:
        np.moveaxis(kept, axis, 0)[-1] = True
    return np.argwhere(~kept)


def step_map(task: Task) -> ScalarMap:
    """How far the step of tone at each joint is beyond those beside its sources, in units of its visibility.

    The distance between the mean colours of 9x9 px on both sides, less the larger of those that the exemplar shows
    where the sources continue each side, over their mean deviation, which masks it, and a just noticeable
    difference, both squared and added. 0 or more; -1 without a joint.
    """
    import cv2

    match = task.source_map()
    steps = np.full(match.shape[:2], -1, np.float32)
    (means, deviation), of_exemplar = _squares(task.result, task.wraps), _known_steps(task.exemplar)
    for axis in (0, 1):
        places = joints_along(match, axis, task.wraps[axis])
        if task.result.counted is not None:
            places = places[task.result.counted[tuple(places.T)]]
        places = places[:: 1 + len(places) // _MOST]
        at = tuple(places.T)
        shown = _steps_along(means, axis)[at]
        masking = (_beside(deviation, axis, 1 - _REACH)[at] + _beside(deviation, axis, _REACH)[at]) / 2
        known = cv2.dilate(of_exemplar.pop(0), np.ones((_SLACK, _SLACK), np.uint8))
        ahead = np.eye(2, dtype=np.int64)[axis]
        beside = match[tuple(((places + ahead) % match.shape[:2]).T)].astype(np.int64) - ahead
        of_sources = (known[tuple(match[at].T)], known[tuple(np.maximum(beside, 0).T)])
        seen = np.maximum(shown - np.maximum(*of_sources), 0) / np.sqrt(masking**2 + _VISIBLE**2)
        np.maximum.at(steps, at, seen)
    return steps


def tone_steps(task: Task) -> Figures:
    """Share of the cells of 9x9 px of the result with a step that is seen; none without joints."""
    task.source_map()
    require_variation(task.exemplar)
    require_side(4 * _SIDE, task.exemplar, task.result)
    if task.result.counted is not None and not task.result.counted.any():
        raise UnmeasurableError("nothing of the result was made")
    steps = step_map(task)
    worst = steps[tuple(worst_of_cells(steps, _SIDE).T)]
    cells = steps.size if task.result.counted is None else int(task.result.counted.sum())
    share = float((worst > _SEEN).sum()) * _SIDE**2 / cells
    return Figures(share, 0.0, _BAD, {"largest": float(worst.max(initial=0))})
