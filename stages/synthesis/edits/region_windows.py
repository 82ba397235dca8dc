"""Windows around the parts of a marked region, so that work depends on their size and not on the picture's."""

import dataclasses

import numpy as np
from jaxtyping import Bool, Int64

from texloom.stages.common.grids.growing import grown
from texloom.stages.kernels.core.loading import loaded
from texloom.stages.vocabulary.arrays import Mask
from texloom.stages.vocabulary.facts import NOWHERE, Wraps


@dataclasses.dataclass(frozen=True)
class RegionWindow:
    """A rectangle of a picture, which may continue across its borders."""

    rows: Int64[np.ndarray, "m"]
    """of the picture"""
    columns: Int64[np.ndarray, "n"]
    wrap: Wraps
    """where it wraps: along axes of which it has all of the picture"""

    @property
    def at(self) -> tuple[np.ndarray, ...]:
        """Index of the window's pixels in arrays of the picture."""
        return np.ix_(self.rows, self.columns)


def windows(region: Mask, margin: int, wrap: Wraps) -> list[tuple[RegionWindow, Bool[np.ndarray, "m n"]]]:
    """Windows that contain all of a region, and the part of the region in each; parts are disjoint.

    Parameters
    ----------
    margin : px around a part that belong to its window. Parts closer than that share a window.
    wrap : where the picture wraps. A part that goes all around it has all of the picture along axes that wrap.
    """
    parts = _parts(region, margin, wrap)
    made = []
    for number in range(1, int(parts.max()) + 1):
        part = region & (parts == number)
        lines = [_interval(part.any(axis=1 - axis), margin, wrap[axis]) for axis in (0, 1)]
        around = wrap if any(line.size == 0 for line in lines) else NOWHERE
        for axis in (0, 1):
            if around[axis]:
                lines[axis] = np.arange(region.shape[axis])
        window = RegionWindow(lines[0], lines[1], around)
        made.append((window, part[window.at]))
    return made


def _parts(region: Mask, margin: int, wrap: Wraps) -> np.ndarray:
    """Numbers of the parts from 1, at their pixels; each part is at least ``margin`` px from the others."""
    ndimage = loaded("scipy.ndimage")
    parts = np.asarray(ndimage.label(grown(region, margin // 2, wrap), np.ones((3, 3)))[0])
    if not wrap:
        return parts
    ends = [(parts[0], parts[-1])] * wrap.down + [(parts[:, 0], parts[:, -1])] * wrap.across
    equal = np.arange(int(parts.max()) + 1)
    for first, last in ends:
        for one, other in zip(first, last, strict=True):
            if one and other:
                equal[equal == equal[other]] = equal[one]
    _, numbers = np.unique(equal, return_inverse=True)
    return np.asarray(numbers[parts])


def _interval(marked: np.ndarray, margin: int, wraps: bool) -> Int64[np.ndarray, "n"]:  # type: ignore[name-defined]
    """Lines from ``margin`` before the first marked one to as many after the last, of which none is there twice.

    Empty where it wraps without an unmarked line.
    """
    lines, side = np.flatnonzero(marked), marked.size
    if not wraps:
        return np.arange(max(0, lines[0] - margin), min(side, lines[-1] + 1 + margin))
    gaps = np.diff(lines, append=lines[0] + side) - 1
    widest = int(gaps.argmax())
    gap = int(gaps[widest])
    if gap == 0:
        return np.zeros(0, np.int64)
    first = int(lines[(widest + 1) % lines.size])
    before = min(margin, gap // 2)
    after = min(margin, gap - before)
    return (first - before + np.arange(before + side - gap + after)) % side
