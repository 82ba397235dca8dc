"""Multilevel free-form deformation: a smooth one-to-one map through pairs of points."""

import dataclasses
from typing import TypeAlias

import numpy as np
from jaxtyping import Float64

from texloom.stages.numerics.matrices import least_squares, matrix_product

Points: TypeAlias = Float64[np.ndarray, "n 2"]

_MAX_ITERATIONS = 100  # of fitting a control lattice
_MAX_MAPS = 4  # of one level, where one may not move the points far enough
_MAX_MOVE = 0.48  # of a control point, in control cells; larger moves could fold the map over
_MIN_PROGRESS = 0.99  # ratio of errors above which another iteration, or map, is not worthwhile
_TOLERANCE = 0.01  # px; smaller errors count as 0
_BLOCK_SIZE = 1 << 15  # points per kernel call


@dataclasses.dataclass(frozen=True)
class _SplineGrid:
    control: Float64[np.ndarray, "m n 2"]
    low: Float64[np.ndarray, "2"]
    """first corner of the box that the splines span, px; points outside use the splines at its border"""
    spacing: Float64[np.ndarray, "2"]
    """px"""
    wrap: bool

    def move(self, points: Points) -> Points:
        """Move the points in place."""
        from texloom.stages.kernels.distortion.free_form import deform

        deform(self.control, self.low, self.spacing, self.wrap, points)
        return points


@dataclasses.dataclass(frozen=True)
class FreeForm:
    """The map, a callable on points (n, 2), px."""

    affine: Float64[np.ndarray, "3 2"]
    """applied first: two rows for the axes, one for the translation"""
    levels: tuple[_SplineGrid, ...]
    """applied from coarse to fine"""

    def __call__(self, points: Points) -> Points:
        """The mapped points; bit-identical for any number of threads."""
        from texloom.stages.kernels.core.threads import run_all, spans

        ends = spans(len(points), -(-len(points) // _BLOCK_SIZE))
        parts = run_all(self._moved, [(points[first:last],) for first, last in ends])
        return np.concatenate(parts) if parts else points

    def _moved(self, points: Points) -> Points:
        moved = _affine_moved(self.affine, points)
        for level in self.levels:
            level.move(moved)
        return moved


def _affine_moved(affine: Float64[np.ndarray, "3 2"], points: Points) -> Points:
    """``points @ affine[:2] + affine[2]`` with a fixed order of operations."""
    return np.ascontiguousarray(points[:, :1] * affine[0] + points[:, 1:] * affine[1] + affine[2], np.float64)


def fitted(
    points: Points, targets: Points, box: tuple[np.ndarray, np.ndarray], finest: float, wrap: bool = False
) -> FreeForm:
    """Fit the smoothest map from ``points`` to ``targets``.

    The best affine map is followed by levels of control lattices, each twice as fine as the last. A lattice is
    refined by its residual while that helps, so that smooth deformations are not left to fine levels, which only
    bend around the points.

    Parameters
    ----------
    points, targets : at least three, not on a line, unless ``wrap``.
    box : two opposite corners of the splines' domain, px. Points outside are clamped to its border.
    finest : control cell side at which no finer level follows, px.
    wrap : whether the map is periodic over the box. It then has no affine part.

    References
    ----------
    [Lee1996]_ section 4 for the sequence of one-to-one maps, [Lee1997]_ section 3.1 for the control lattice of one
    level. Refining a level by its residual is ours.
    """
    low, high = (np.asarray(corner, np.float64) for corner in box)
    affine = np.array([[1.0, 0.0], [0.0, 1.0], [0.0, 0.0]])
    if not wrap:
        centre = points.mean(axis=0)
        system = np.column_stack([points - centre, np.ones(len(points))])
        affine = least_squares(system, targets)
        affine[2] -= matrix_product(centre, affine[:2])
    levels: list[_SplineGrid] = []
    moved = _affine_moved(affine, points)
    error = _error(moved, targets)
    count = 4 if wrap else 1
    while error > _TOLERANCE:
        cells = np.maximum(count if wrap else 1, np.rint(count * (high - low) / (high - low).max())).astype(int)
        spacing = (high - low) / cells
        flat = _SplineGrid(np.zeros((*(cells if wrap else cells + 3), 2)), low, spacing, wrap)
        for _ in range(_MAX_MAPS):
            level, residual = _fitted_level(flat, moved, targets)
            if residual >= _MIN_PROGRESS * error:
                break
            levels.append(level)
            moved, error = level.move(moved), residual
            if (np.abs(level.control) < _MAX_MOVE * spacing).all():
                break
        if spacing.max() <= finest:
            break
        count *= 2
    return FreeForm(affine, tuple(levels))


def _fitted_level(level: _SplineGrid, points: Points, targets: Points) -> tuple[_SplineGrid, float]:
    """The control lattice that moves ``points`` closest to ``targets``, and the remaining error, px."""
    from texloom.stages.kernels.distortion.free_form import approximate

    change = np.empty_like(level.control)
    error = np.inf
    for _ in range(_MAX_ITERATIONS):
        moved = level.move(points.copy())
        residual = _error(moved, targets)
        if residual >= _MIN_PROGRESS * error:
            break
        error = residual
        approximate(points, targets - moved, level.low, level.spacing, level.wrap, change)
        limit = _MAX_MOVE * level.spacing
        level = dataclasses.replace(level, control=np.clip(level.control + change, -limit, limit))
    return level, _error(level.move(points.copy()), targets)


def _error(points: Points, targets: Points) -> float:
    """Root mean square distance, px."""
    return float(np.sqrt(((points - targets) ** 2).sum(axis=1).mean()))
