"""Steps of tone at joints of the source map: two-tone cells, cut contours, pieces that are lighter or darker."""

import numpy as np
from jaxtyping import Float32

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
_VISIBLE = 2.3  # CIELAB units; a just noticeable difference
_SLACK = 5  # px about a source within which the exemplar may show the step, as results are bent and blended
_MOST = 1 << 18  # joints along an axis that are measured
_SEEN = 0.5  # from this on a step is seen
_BAD = 0.1  # share of the cells with such a step; blocks joined at random have more, good results .01


def _fields(
    picture: Picture, axis: int, wraps: Wraps
) -> tuple[Float32[np.ndarray, "h w"], Float32[np.ndarray, "h w"]]:
    """The step behind each pixel along an axis, and the deviation within the squares on both sides of it."""
    import cv2

    margin = [(_SIDE,) * 2 if wrap else (0, 0) for wrap in wraps]
    values = np.pad(picture.compared, (*margin, (0, 0)), mode="wrap")
    means, squares = (
        cv2.boxFilter(part, -1, (_SIDE, _SIDE)).reshape(values.shape) for part in (values, values * values)
    )
    deviation = np.sqrt(np.maximum(squares - means * means, 0).sum(axis=2))
    reach = [(_REACH - 1, _REACH) if one == axis else (0, 0) for one in (0, 1)]
    means, deviation = np.pad(means, (*reach, (0, 0)), mode="edge"), np.pad(deviation, reach, mode="edge")
    before, after = (
        tuple(np.s_[part] if one == axis else np.s_[:] for one in (0, 1))
        for part in (np.s_[: -2 * _REACH + 1], np.s_[2 * _REACH - 1 :])
    )
    step = np.sqrt(((means[after] - means[before]) ** 2).sum(axis=2))
    inside = tuple(slice(one, -one or None) for one, _ in margin)
    return step[inside], ((deviation[after] + deviation[before]) / 2)[inside]


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
    for axis in (0, 1):
        places = joints_along(match, axis, task.wraps[axis])
        if task.result.counted is not None:
            places = places[task.result.counted[tuple(places.T)]]
        places = places[:: 1 + len(places) // _MOST]
        at = tuple(places.T)
        shown, masking = (field[at] for field in _fields(task.result, axis, task.wraps))
        known = cv2.dilate(_fields(task.exemplar, axis, NOWHERE)[0], np.ones((_SLACK, _SLACK), np.uint8))
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
