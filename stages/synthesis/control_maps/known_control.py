"""Values of control that an exemplar hardly has."""

import itertools

import numpy as np
from jaxtyping import Float32

from texloom.stages.kernels.core.loading import loaded

_LEVELS = 64  # of a channel's range
_OVERUSE = 3.0  # times even use that the exemplar's pixels of some values may serve those of the target
_ENOUGH = 0.04  # of the exemplar's pixels, which may serve any number
_REACHES = (0, 1, 2, 3, 4, 6, 8, 12, 16, 24, 32, 48, 63)  # levels to every side; the last contain all
_FARTHEST = 16  # levels; values farther away are another material's, however few the pixels within
_NOTABLE = 0.05 * _LEVELS  # change of a value that is reported
_MAX_OUTSIDE = 0.01  # share of the target outside the range of control, above which a note is given
_MAX_RARE = 0.02  # share of the target with values that are rare in control, above which a note is given


def extrapolated(
    own: Float32[np.ndarray, "h w k"], wanted: Float32[np.ndarray, "H W k"], strength: float
) -> tuple[Float32[np.ndarray, "H W k"], float]:
    """The target's control with values that the exemplar hardly has replaced by the mean of those around.

    Where a value occurs in a few pixels of the exemplar only, these would repeat over the whole region that asks
    for it. The mean is that of the exemplar's pixels within the least distance at which they are enough for all of
    the target that asks for values there, within a quarter of the range if there are any: a label of a small part
    of the exemplar keeps its material.

    Parameters
    ----------
    own, wanted : control of the exemplar and of the target, 0 to ``strength``.

    Returns
    -------
    the control, and the share of its pixels that change by more than a twentieth of the range, 0..1.
    """
    spatial = loaded("scipy.spatial")
    channels = own.shape[2]
    if channels not in (1, 2, 3) or strength <= 0:
        return wanted, 0.0
    shape = (_LEVELS,) * channels
    factor = _LEVELS / strength
    planes = [part.reshape(-1, channels) for part in (own, wanted)]
    levels = [np.clip((part * factor).astype(np.int64), 0, _LEVELS - 1) for part in planes]
    numbers = [np.ravel_multi_index(tuple(part.T), shape) for part in levels]
    count = _LEVELS**channels
    supply, demand = (np.bincount(part, minlength=count) / len(part) for part in numbers)
    sums = [np.bincount(numbers[0], plane, count) / len(plane) for plane in planes[0].T]
    totals = _cumulative(np.stack([supply, demand, *sums], axis=1).reshape(*shape, -1))
    middles = (np.indices(shape).reshape(channels, -1).T + 0.5) / factor
    means = middles.copy()
    cells = np.flatnonzero(demand)
    for reach in _REACHES:
        around = _around(totals, np.stack(np.unravel_index(cells, shape), axis=1), reach)
        enough = around[:, 0] >= np.minimum(around[:, 1] / _OVERUSE, _ENOUGH)
        if reach >= _FARTHEST:
            enough |= around[:, 0] > 0
        if reach > 0:
            means[cells[enough]] = around[enough, 2:] / around[enough, :1]
        cells = cells[~enough]
        if not cells.size:
            break
    change = np.sqrt(np.square(means - middles).sum(axis=1)) * factor
    changed = change > 1
    if not changed.any():
        return wanted, 0.0
    # a mean may lie in the gap between the values of two materials
    known = middles[supply > 0]
    gap, nearest = spatial.KDTree(known).query(means[changed])
    means[changed] = np.where((gap > 1 / factor)[:, None], known[nearest], means[changed])
    moved = np.where(changed[numbers[1], None], means[numbers[1]], planes[1]).reshape(wanted.shape)
    return np.asarray(moved, np.float32), float(demand[change > _NOTABLE].sum())


def _cumulative(planes: np.ndarray) -> np.ndarray:
    """Sums of planes, the last axis, over all that comes before each edge of a cell."""
    for axis in range(planes.ndim - 1):
        planes = planes.cumsum(axis=axis)
    return np.pad(planes, [(1, 0)] * (planes.ndim - 1) + [(0, 0)])


def _around(totals: np.ndarray, cells: np.ndarray, reach: int) -> np.ndarray:
    """Sums of planes over the cells within ``reach`` of each cell, (n, planes), by their cumulative sums."""
    ends = np.maximum(cells - reach, 0), np.minimum(cells + reach + 1, _LEVELS)
    corners = itertools.product((0, 1), repeat=cells.shape[1])
    sums = np.zeros((len(cells), totals.shape[-1]))
    for corner in corners:
        at = tuple(ends[end][:, axis] for axis, end in enumerate(corner))
        sums += (-1) ** (len(corner) - sum(corner)) * totals[at]
    return sums


def notes_on_target(outside: float, rare: float) -> list[str]:
    """What is to be said of a target, a sentence each.

    Parameters
    ----------
    outside, rare : shares of its pixels, 0..1: outside the range of control, and of values too rare in control.
    """
    notes = []
    if outside > _MAX_OUTSIDE:
        notes.append(f"{outside:.1%} of the target is beyond the control map's values and takes the nearest.")
    if rare > _MAX_RARE:
        notes.append(
            f"{rare:.1%} of the target has values too rare in control for so large a region; it takes near ones."
        )
    return notes
