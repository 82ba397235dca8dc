"""Multilevel free-form deformation: a smooth one-to-one map through given pairs of points."""

import dataclasses
from typing import TypeAlias

import numpy as np
from jaxtyping import Float64

Points: TypeAlias = Float64[np.ndarray, "n 2"]

_ROUNDS = 100  # in which a control lattice is improved
_MAPS = 4  # of one level, where points are to move farther than one may move them
_MOST = 0.48  # of a control cell, by which a control point may move: more could fold the map over
_GAIN = 0.99  # of the error that another round, or map, must leave at most
_MET = 0.01  # px, the error that counts as none
_CALL = 1 << 15  # points handed to a kernel at a time


@dataclasses.dataclass(frozen=True)
class _Level:
    control: Float64[np.ndarray, "m n 2"]
    spacing: Float64[np.ndarray, "2"]
    """px"""

    def moved(self, points: Points, low: Float64[np.ndarray, "2"], wrap: bool) -> Points:
        from texloom.stages.kernels.distortion.free_form import deform

        moved = points.copy()
        deform(self.control, low, self.spacing, wrap, moved)
        return moved


@dataclasses.dataclass(frozen=True)
class FreeForm:
    """The map; call it with points, (n, 2) px."""

    affine: Float64[np.ndarray, "3 2"]
    """applied first: two rows for the axes, one for the shift"""
    low: Float64[np.ndarray, "2"]
    """first corner of the box that the splines span; beyond it they are as at its border"""
    wrap: bool
    levels: tuple[_Level, ...]
    """applied in turn, from coarse to fine"""

    def __call__(self, points: Points) -> Points:
        """Where the points go; the same for any number of threads."""
        from texloom.stages.kernels.core.threads import run_all, spans

        ends = spans(len(points), -(-len(points) // _CALL))
        parts = run_all(self._moved, [(points[first:last],) for first, last in ends])
        return np.concatenate(parts) if parts else points

    def _moved(self, points: Points) -> Points:
        from texloom.stages.kernels.distortion.free_form import deform

        moved = affine_moved(self.affine, points)
        for level in self.levels:
            deform(level.control, self.low, level.spacing, self.wrap, moved)
        return moved


def affine_moved(affine: Float64[np.ndarray, "3 2"], points: Points) -> Points:
    """``points @ affine[:2] + affine[2]`` with a fixed order of operations."""
    return np.ascontiguousarray(points[:, :1] * affine[0] + points[:, 1:] * affine[1] + affine[2], np.float64)


def fitted(
    points: Points,
    targets: Points,
    box: tuple[np.ndarray, np.ndarray],
    finest: float,
    wrap: bool = False,
) -> FreeForm:
    """The map that takes ``points`` to ``targets``, as smooth as that allows.

    First comes the affine map that does it best. Then each level bends by a lattice of control points twice as fine
    as the last. A lattice is improved by what it leaves over as long as that helps, so that nothing smooth is left
    to fine levels, which would bend around the points alone.

    Parameters
    ----------
    points, targets : at least three, not on a line, unless ``wrap``.
    box : two opposite corners of what the splines span, px. Points beyond are taken to its border.
    finest : side of a control cell at which no finer level follows, px.
    wrap : the map goes on over the box's borders as over the opposite ones. There is no affine part then.

    References
    ----------
    [Lee1996]_ section 4 for the sequence of one-to-one maps, [Lee1997]_ section 3.1 for the control lattice of one
    level. Improving a level is ours.
    """
    low, high = (np.asarray(corner, np.float64) for corner in box)
    affine = np.array([[1.0, 0.0], [0.0, 1.0], [0.0, 0.0]])
    if not wrap:
        centre = points.mean(axis=0)
        system = np.column_stack([points - centre, np.ones(len(points))])
        affine = np.linalg.lstsq(system, targets, rcond=None)[0]
        affine[2] -= centre @ affine[:2]
    levels: list[_Level] = []
    moved = affine_moved(affine, points)
    error = _error(moved, targets)
    count = 4 if wrap else 1
    while error > _MET:
        cells = np.maximum(count if wrap else 1, np.rint(count * (high - low) / (high - low).max())).astype(int)
        spacing = (high - low) / cells
        for _ in range(_MAPS):
            level, left = _level(moved, targets, low, cells, spacing, wrap)
            if left >= _GAIN * error:
                break
            levels.append(level)
            moved, error = level.moved(moved, low, wrap), left
            if (np.abs(level.control) < _MOST * spacing).all():
                break
        if spacing.max() <= finest:
            break
        count *= 2
    return FreeForm(affine, low, wrap, tuple(levels))


def _level(
    points: Points, targets: Points, low: np.ndarray, cells: np.ndarray, spacing: np.ndarray, wrap: bool
) -> tuple[_Level, float]:
    """The control lattice that moves ``points`` nearest to ``targets``, and the error that it leaves, px."""
    from texloom.stages.kernels.distortion.free_form import approximate

    level = _Level(np.zeros((*(cells if wrap else cells + 3), 2)), spacing)
    change = np.empty_like(level.control)
    error = np.inf
    for _ in range(_ROUNDS):
        moved = level.moved(points, low, wrap)
        left = _error(moved, targets)
        if left >= _GAIN * error:
            break
        error = left
        approximate(points, targets - moved, low, spacing, wrap, change)
        level = _Level(np.clip(level.control + change, -_MOST * spacing, _MOST * spacing), spacing)
    return level, _error(level.moved(points, low, wrap), targets)


def _error(points: Points, targets: Points) -> float:
    """Root mean square distance, px."""
    return float(np.sqrt(((points - targets) ** 2).sum(axis=1).mean()))
