"""Steps of tone at joints of the source map: two-tone cells, cut contours, pieces that are lighter or darker."""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float32, Int64

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
_MOST = 1 << 18  # joints along an axis that are measured
_SEEN = 1.0  # from this on a step is seen
_BAD = 0.05  # share of the cells with such a step; blocks joined at random have .12, good results .01


class _Squares(NamedTuple):
    """The squares about the pixels of a picture."""

    means: Float32[np.ndarray, "h w c"]
    spread: Float32[np.ndarray, "h w"]
    """root of the mean squared distance to the mean"""
    wraps: Wraps

    @staticmethod
    def of(picture: Picture, wraps: Wraps) -> "_Squares":
        import cv2

        values = picture.compared
        margin = [(_SIDE if wrap else 0,) * 2 for wrap in wraps]
        values = np.pad(values, (*margin, (0, 0)), mode="wrap")
        inside = tuple(slice(before, -before or None) for before, _ in margin)
        means, squares = (
            cv2.boxFilter(part, -1, (_SIDE, _SIDE)).reshape(values.shape)[inside] for part in (values, values**2)
        )
        spread = np.sqrt(np.maximum(squares - means * means, 0).sum(axis=2))
        return _Squares(means, spread, wraps)

    def at(self, places: Places) -> tuple[np.ndarray, ...]:
        """Rows and columns of places, those beyond a border moved to it."""
        shape = np.array(self.spread.shape)
        return tuple(np.where(np.array(self.wraps), places % shape, np.clip(places, 0, shape - 1)).T)

    def step(self, places: Places, ahead: Int64[np.ndarray, "2"]) -> Float32[np.ndarray, "*n"]:
        """Distance between the means behind and beyond the borders between some pixels and those ``ahead``."""
        beyond, behind = self.at(places + _REACH * ahead), self.at(places - (_REACH - 1) * ahead)
        return np.sqrt(((self.means[beyond] - self.means[behind]) ** 2).sum(axis=1))


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
    match = task.source_map()
    result, exemplar = _Squares.of(task.result, task.wraps), _Squares.of(task.exemplar, NOWHERE)
    steps = np.full(match.shape[:2], -1, np.float32)
    for axis in (0, 1):
        ahead = np.eye(2, dtype=np.int64)[axis]
        places = joints_along(match, axis, task.wraps[axis])
        if task.result.counted is not None:
            places = places[task.result.counted[tuple(places.T)]]
        places = places[:: 1 + len(places) // _MOST]
        sources = [match[result.at(places + moved)].astype(np.int64) - moved for moved in (0 * ahead, ahead)]
        known = np.maximum(*(exemplar.step(one, ahead) for one in sources))
        masking = sum(result.spread[result.at(places + far * ahead)] for far in (_REACH, 1 - _REACH)) / 2
        visible = np.maximum(result.step(places, ahead) - known, 0) / np.sqrt(masking**2 + _VISIBLE**2)
        np.maximum.at(steps, tuple(places.T), visible)
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
