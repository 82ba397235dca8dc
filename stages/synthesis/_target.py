"""The control map that a result follows, at every level."""

import numpy as np
from jaxtyping import Float32

from stages.kernels.threads import run_all, spans, thread_count
from stages.synthesis._levels import NOTHING, Level, Levels, Rect

_ALONE = 20_000  # pixels that one thread does alone


def _rows(area: Rect) -> list[tuple[int, int]]:
    pixels = (area.bottom - area.top) * (area.right - area.left)
    pieces = spans(area.bottom - area.top, 1 if pixels < _ALONE else thread_count())
    return [(area.top + first, area.top + last) for first, last in pieces]


class Target:
    """Planes of control in 0..1 and their means over 2, 4, 8 ... px; what ``levels`` is given follows them.

    Parameters
    ----------
    planes : kept, and changed by `paint`; pixel (0, 0) is that of the endless result.
    """

    def __init__(self, planes: Float32[np.ndarray, "H W k"], levels: Levels):
        self.levels = levels
        self.pyramid = [np.ascontiguousarray(planes)]
        for _ in levels.levels[1:]:
            height, width, count = self.pyramid[-1].shape
            self.pyramid.append(np.empty((-(-height // 2), -(-width // 2), count), np.float32))
        self.follow(Rect(0, planes.shape[0], 0, planes.shape[1]))

    def paint(self, planes: Float32[np.ndarray, "h w k"], top: int, left: int) -> list[Rect]:
        """Replace a rectangle, which lies inside; returns what `follow` does."""
        area = Rect(top, top + planes.shape[0], left, left + planes.shape[1])
        self.pyramid[0][area.top : area.bottom, area.left : area.right] = planes
        return self.follow(area)

    def follow(self, area: Rect) -> list[Rect]:
        """Bring every level up to date after changes in ``area``, px.

        Returns
        -------
        for each level where `Level.given` may have changed, px of its arrays.
        """
        from stages.kernels.control_pyramid import halve

        changed = []
        for number, level in enumerate(self.levels.levels):
            if number:
                area = area.coarser
                fine, coarse = self.pyramid[number - 1 : number + 1]
                run_all(halve, [(fine, coarse, area.left, area.right, *rows) for rows in _rows(area)])
            changed.append(self._place(level, area))
        return changed

    def _place(self, level: Level, area: Rect) -> Rect:
        from stages.kernels.control_pyramid import place_control

        planes = self.pyramid[level.number]
        rows, columns = level.given.shape[:2]
        into = area.moved(-level.origin[0], -level.origin[1])
        # what lies beyond a border follows it
        into = Rect(
            into.top if area.top > 0 else 0,
            into.bottom if area.bottom < planes.shape[0] else rows,
            into.left if area.left > 0 else 0,
            into.right if area.right < planes.shape[1] else columns,
        ).within(Rect(0, rows, 0, columns))
        if into.empty:
            return NOTHING
        strength = np.float32(self.levels.tables.strengths[level.number])
        shared = (planes, level.given, *level.origin, strength, into.left, into.right)
        run_all(place_control, [(*shared, *rows) for rows in _rows(into)])
        return into.within(level.everything)
