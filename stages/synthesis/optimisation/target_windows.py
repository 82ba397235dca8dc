"""Overlapping windows of a result, of which what lies within one can be changed at a time."""

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Int64

from texloom.stages.vocabulary.facts import Wraps


class TargetWindow(NamedTuple):
    """A part of a result."""

    rows: Int64[np.ndarray, "p"]
    """from its first row on, without a step where the result wraps"""
    columns: Int64[np.ndarray, "q"]
    ends: tuple[bool, bool, bool, bool]
    """whether the result goes on beyond its first and last row, first and last column"""
    place: tuple[np.ndarray, np.ndarray]
    """index of its pixels in the result"""

    @property
    def border(self) -> Bool[np.ndarray, "p q"]:
        """Pixels beyond which the result goes on."""
        mask = np.zeros((len(self.rows), len(self.columns)), bool)
        mask[0], mask[-1] = self.ends[:2]
        mask[:, 0] |= self.ends[2]
        mask[:, -1] |= self.ends[3]
        return mask


def target_windows(sides: tuple[int, int], wrap: Wraps, side: int, overlap: int) -> Iterator[TargetWindow]:
    """Windows of ``side`` px at most such that all that is no wider than ``overlap`` px lies within one.

    Where the result wraps, windows lie across its border too.
    """
    lines = [_along(count, around, side, overlap) for count, around in zip(sides, wrap, strict=True)]
    for top, down, above, below in lines[0]:
        for left, across, before, after in lines[1]:
            rows, columns = np.arange(top, top + down), np.arange(left, left + across)
            place = np.ix_(rows % sides[0], columns % sides[1])
            yield TargetWindow(rows, columns, (above, below, before, after), (place[0], place[1]))


def _along(count: int, around: bool, side: int, overlap: int) -> list[tuple[int, int, bool, bool]]:
    """First line and number of lines of each window along an axis, and whether the result goes on at its ends."""
    if around and count <= side:
        return [(0, count, True, True), (count // 2, count, True, True)]
    if around:
        return [(first, side, True, True) for first in range(0, count, side - overlap)]
    firsts = range(0, max(1, count - overlap), side - overlap)
    return [(first, min(side, count - first), first > 0, first + side < count) for first in firsts]
