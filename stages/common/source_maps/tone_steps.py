"""Steps of tone at joints of a source map: where tone jumps and the exemplar's does not beside either source."""

from collections.abc import Callable

import numpy as np
from jaxtyping import Float32

from texloom.stages.common.grids.working_size import reduction
from texloom.stages.common.similarity.patch_distance import Places
from texloom.stages.vocabulary.arrays import Correspondence, Mask
from texloom.stages.vocabulary.facts import NOWHERE, Wraps

SIDE = 9
"""px of the squares on both sides of a joint"""
SEEN = 0.5
"""from this on a step is seen"""

_REACH = SIDE // 2 + 1  # px from a joint to the middle of the square beyond it
_INSIDE = np.s_[SIDE - _REACH : _REACH - SIDE, SIDE - _REACH : _REACH - SIDE]
_OFFSETS = 1 - _REACH, _REACH  # of the middles of both squares from a joint's first pixel
_STRIP = 256  # rows of a large exemplar
_VISIBLE = 2.3  # CIELAB units; a just noticeable difference
_SLACK = 5  # px about a source within which the exemplar may show the step, as results are bent and blended
_MOST = 1 << 18  # joints along an axis that are measured


class ToneSteps:
    """The steps of tone of results of one exemplar.

    Parameters
    ----------
    shape : height and width of the exemplar.
    lab : CIELAB, or L alone, of its rows from one to before another.
    """

    def __init__(self, shape: tuple[int, int], lab: Callable[[int, int], Float32[np.ndarray, "n w c"]]):
        self._known = _known_steps(*shape, lab)

    def at_joints(
        self, result: Float32[np.ndarray, "H W c"], match: Correspondence, wraps: Wraps, counted: Mask | None = None
    ) -> Float32[np.ndarray, "H W"]:
        """How far the step at each joint is beyond those beside its sources, in units of its visibility.

        The distance between the mean colours of 9x9 px on both sides, less the larger of those that the exemplar
        shows where the sources continue each side, over their mean deviation, which masks it, and a just noticeable
        difference, both squared and added. 0 or more; -1 without a joint.

        Parameters
        ----------
        counted : where joints count; None is everywhere.
        """
        steps = np.full(match.shape[:2], -1, np.float32)
        values = _padded(result, wraps)
        means, squares = _means(values)[_INSIDE], _means(values * values)[_INSIDE]
        for axis, of_exemplar in enumerate(self._known):
            places = joints_along(match, axis, wraps[axis])
            if counted is not None:
                places = places[counted[tuple(places.T)]]
            places = places[:: 1 + len(places) // _MOST]
            at = tuple(places.T)
            sides = [_beside(means, axis, offset)[at] for offset in _OFFSETS]
            shown = _length(sides[1] - sides[0])
            masking = np.zeros(len(places), np.float32)
            for mean, offset in zip(sides, _OFFSETS, strict=True):
                spread = np.maximum(_beside(squares, axis, offset)[at] - mean * mean, 0)
                masking += np.sqrt(_summed(spread)) / 2
            ahead = np.eye(2, dtype=np.int64)[axis]
            beside = match[tuple(((places + ahead) % match.shape[:2]).T)].astype(np.int64) - ahead
            of_sources = (of_exemplar[tuple(match[at].T)], of_exemplar[tuple(np.maximum(beside, 0).T)])
            seen = np.maximum(shown - np.maximum(*of_sources), 0) / np.sqrt(masking**2 + _VISIBLE**2)
            np.maximum.at(steps, at, seen)
        return steps


def joints_along(match: Correspondence, axis: int, wraps: bool) -> Places:
    """The pixels whose next neighbour along an axis is not the neighbour of their source."""
    following = np.roll(match, -1, axis)
    kept = (following[..., axis] == match[..., axis] + 1) & (following[..., 1 - axis] == match[..., 1 - axis])
    if not wraps:
        np.moveaxis(kept, axis, 0)[-1] = True
    return np.argwhere(~kept)


def _known_steps(
    height: int, width: int, lab: Callable[[int, int], Float32[np.ndarray, "n w c"]]
) -> list[Float32[np.ndarray, "h w"]]:
    """The largest of `_steps_along` within `_SLACK` px, along both axes; of a large exemplar in strips."""
    import cv2

    rows = _STRIP if reduction(height, width) > 1 else height
    known = [np.empty((height, width), np.float32) for _ in range(2)]
    for top in range(0, height, rows):
        first = max(0, top - SIDE - _SLACK)
        means = _means(_padded(lab(first, min(height, top + rows + SIDE + _SLACK)), NOWHERE))[_INSIDE]
        for axis, steps in enumerate(known):
            near = cv2.dilate(_steps_along(means, axis), np.ones((_SLACK, _SLACK), np.uint8))
            steps[top : top + rows] = near[top - first :][:rows]
    return known


def _padded(values: Float32[np.ndarray, "h w c"], wraps: Wraps) -> Float32[np.ndarray, "H W c"]:
    for axis, wrap in enumerate(wraps):
        margin = [(SIDE if one == axis else 0,) * 2 for one in range(3)]
        values = np.pad(values, margin, mode="wrap" if wrap else "edge")
    return values


def _means(values: Float32[np.ndarray, "h w c"]) -> Float32[np.ndarray, "h w c"]:
    import cv2

    return cv2.boxFilter(values, -1, (SIDE, SIDE)).reshape(values.shape)


def _steps_along(means: Float32[np.ndarray, "H W c"], axis: int) -> Float32[np.ndarray, "h w"]:
    """Distance between the means behind and beyond the border after each pixel along an axis."""
    behind, beyond = (_beside(means, axis, offset) for offset in _OFFSETS)
    return _length(beyond - behind)


def _length(vectors: Float32[np.ndarray, "*n c"]) -> Float32[np.ndarray, "*n"]:
    return np.asarray(np.sqrt(_summed(vectors * vectors)))


def _summed(values: Float32[np.ndarray, "*n c"]) -> Float32[np.ndarray, "*n"]:
    """The sum over the few channels, which NumPy adds slowly along a short axis."""
    total = values[..., 0].copy()
    for channel in range(1, values.shape[-1]):
        total += values[..., channel]
    return np.asarray(total)


def _beside(values: np.ndarray, axis: int, offset: int) -> np.ndarray:
    """The values ``offset`` px further along an axis, without the margin."""
    place = [np.s_[_REACH:-_REACH], np.s_[_REACH:-_REACH]]
    place[axis] = np.s_[_REACH + offset : values.shape[axis] - _REACH + offset]
    return values[tuple(place)]
