"""The control map that a result follows, at every level."""

from typing import TypeAlias

import numpy as np
from jaxtyping import Float32

from texloom.stages.common.per_pixel.levels import NOTHING, Level, Levels, Rect
from texloom.stages.kernels.core.threads import run_all, spans, thread_count

_MIN_SHARED_PIXELS = 20_000  # fewer are left to one thread


def _rows(area: Rect) -> list[tuple[int, int]]:
    pixels = (area.bottom - area.top) * (area.right - area.left)
    pieces = spans(area.bottom - area.top, 1 if pixels < _MIN_SHARED_PIXELS else thread_count())
    return [(area.top + first, area.top + last) for first, last in pieces]


Limits: TypeAlias = tuple[np.ndarray, np.ndarray]
"""(k,) float32, least and greatest value of each plane as it is painted, which become 0 and 1"""


def normalised(values: Float32[np.ndarray, "h w k"], limits: Limits) -> Float32[np.ndarray, "h w k"]:
    """What was painted in 0..1; beyond the limits it counts as they do."""
    lows, highs = limits
    return np.clip((values - lows) / (highs - lows), 0, 1).astype(np.float32)


class TargetControl:
    """Planes of control in 0..1 and their means over 2, 4, 8 ... px; what ``levels`` is given follows them.

    Parameters
    ----------
    planes : pixel (0, 0) is that of the endless result.
    limits : of what is painted.
    """

    def __init__(self, planes: Float32[np.ndarray, "H W k"], levels: Levels, limits: Limits | None = None):
        self.levels = levels
        count = planes.shape[2]
        self.limits = limits or (np.zeros(count, np.float32), np.ones(count, np.float32))
        self.shapes = [planes.shape[:2]]
        for _ in levels.levels[1:]:
            height, width = self.shapes[-1]
            self.shapes.append((-(-height // 2), -(-width // 2)))
        self._hold(np.ascontiguousarray(planes))
        self.follow(Rect(0, planes.shape[0], 0, planes.shape[1]))

    def planes(self, area: Rect) -> Float32[np.ndarray, "h w k"]:
        """A part of the planes, 0..1."""
        return self._pyramid[0][area.top : area.bottom, area.left : area.right]

    def paint(self, values: Float32[np.ndarray, "h w k"], top: int, left: int) -> list[Rect]:
        """Replace a rectangle, which lies inside; returns what `follow` does."""
        area = Rect(top, top + values.shape[0], left, left + values.shape[1])
        self._replace(values, area)
        return self.follow(area)

    def follow(self, area: Rect) -> list[Rect]:
        """Bring every level up to date after changes in ``area``, px.

        Returns
        -------
        for each level where `Level.given` may have changed, px of its arrays.
        """
        changed = []
        for level in self.levels.levels:
            if level.number:
                area = area.coarser
                self._halve(level.number, area)
            changed.append(self._give(level, area))
        return changed

    def _hold(self, planes: Float32[np.ndarray, "H W k"]) -> None:
        self._pyramid = [np.empty((*shape, planes.shape[2]), np.float32) for shape in self.shapes]
        self._pyramid[0][:] = planes

    def _replace(self, values: Float32[np.ndarray, "h w k"], area: Rect) -> None:
        self._pyramid[0][area.top : area.bottom, area.left : area.right] = normalised(values, self.limits)

    def _halve(self, number: int, area: Rect) -> None:
        """Fill ``area`` of a level from the next finer one."""
        from texloom.stages.kernels.per_pixel.control_pyramid import halve

        fine, coarse = self._pyramid[number - 1 : number + 1]
        run_all(halve, [(fine, coarse, area.left, area.right, *rows) for rows in _rows(area)])

    def _give(self, level: Level, area: Rect) -> Rect:
        height, width = self.shapes[level.number]
        rows, columns = level.states.shape[1:]
        into = area.moved(-level.origin[0], -level.origin[1])
        # what lies beyond a border follows it
        into = Rect(
            into.top if area.top > 0 else 0,
            into.bottom if area.bottom < height else rows,
            into.left if area.left > 0 else 0,
            into.right if area.right < width else columns,
        ).within(Rect(0, rows, 0, columns))
        if into.empty:
            return NOTHING
        self._give_to(level, into)
        return into.within(level.everything)

    def _strength(self, number: int) -> np.float32:
        return np.float32(self.levels.tables.strengths[number])

    def _give_to(self, level: Level, into: Rect) -> None:
        """Fill pixels of `Level.given`."""
        from texloom.stages.kernels.per_pixel.control_pyramid import place_control

        planes, strength = self._pyramid[level.number], self._strength(level.number)
        shared = (planes, level.given, *level.origin, strength, into.left, into.right)
        run_all(place_control, [(*shared, *rows) for rows in _rows(into)])
