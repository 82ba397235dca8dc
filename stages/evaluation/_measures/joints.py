"""Joints of the source map: how unlike the exemplar's own patches are those across them."""

import dataclasses
from typing import NamedTuple, TypeAlias

import numpy as np
from jaxtyping import Float32, Float64, Int64

from texloom.stages.arrays import Correspondence, ScalarMap
from texloom.stages.evaluation._measures.patches import (
    SIDE,
    patch_windows,
    principal_directions,
    product,
    smoothed,
    whole_patches,
)
from texloom.stages.evaluation._measures.pictures import (
    UnmeasurableError,
    require_side,
    require_variation,
)
from texloom.stages.evaluation._measures.table import Figures
from texloom.stages.evaluation._measures.task import Task
from texloom.stages.masks import count_excluded

_STEPS = (1, 2, 4)  # px between samples
_MAX_CELLS = 2048
_MIN_CELL = 4  # px
_MAX_TARGETS = 1 << 14
_SELF = 256  # exemplar patches whose distance to the others is the reference
_CHUNK = 256
_WORST = 0.1  # share of the joints; people see the worst ones
_GOOD, _BAD = 1.4, 3.0  # of worst joints: usual of good results; usual of blocks joined at random

Places: TypeAlias = Int64[np.ndarray, "n 2"]
"""rows and columns, px"""


@dataclasses.dataclass(frozen=True)
class Joints:
    """The joints that were measured, one a cell of the result."""

    places: Places
    ratios: Float64[np.ndarray, "n s"]
    """distance of the patch at a joint over the exemplar's to itself, by scale; NaN where a mask covers it"""
    cell: int
    """side of the cells, px"""

    @property
    def ratio(self) -> Float64[np.ndarray, "*n"]:
        """Mean over the scales."""
        return np.asarray(np.nanmean(self.ratios, axis=1))

    def map(self, shape: tuple[int, int]) -> ScalarMap:
        """The ratio of the joint in each pixel's cell; 0 in cells without joints."""
        cells = np.zeros((-(-shape[0] // self.cell), -(-shape[1] // self.cell)), np.float32)
        cells[self.places[:, 0] // self.cell, self.places[:, 1] // self.cell] = self.ratio
        whole = cells.repeat(self.cell, axis=0).repeat(self.cell, axis=1)
        return np.ascontiguousarray(whole[: shape[0], : shape[1]])


def joint_contrast(
    exemplar: Float32[np.ndarray, "h w 3"],
    result: Float32[np.ndarray, "H W 3"],
    match: Correspondence,
    tileable: bool = False,
) -> Float32[np.ndarray, "H W"]:
    """How much a pixel's right or lower neighbour differs from the neighbour of its source; -1 where both are kept.

    The larger of both directions and both sides, squared CIELAB units. Where the source has no such neighbour, 0.
    """
    contrast = np.full(match.shape[:2], -1, np.float32)
    shape = exemplar.shape[:2]
    for axis in (0, 1):
        unit = np.array([1 - axis, axis])
        following = np.roll(match, -1, axis).astype(np.int64)
        cut = (following != match + unit).any(axis=2)
        if not tileable:
            cut[(slice(None),) * axis + (-1,)] = False
        rows, columns = np.nonzero(cut)
        places = np.stack([rows, columns], axis=1)
        after = (places + unit) % match.shape[:2]
        jump = np.zeros(len(places), np.float32)
        for one, other, step in ((places, after, unit), (after, places, -unit)):
            expected = match[one[:, 0], one[:, 1]].astype(np.int64) + step
            inside = ((expected >= 0) & (expected < shape)).all(axis=1)
            expected, pixel = expected[inside], other[inside]
            difference = exemplar[expected[:, 0], expected[:, 1]] - result[pixel[:, 0], pixel[:, 1]]
            jump[inside] = np.maximum(jump[inside], (difference**2).sum(axis=1))
        contrast[rows, columns] = np.maximum(contrast[rows, columns], jump)
    return contrast


def worst_of_cells(contrast: ScalarMap, cell: int) -> Places:
    """The pixel of largest contrast in every cell of ``cell`` px that has a joint; of equals the first."""
    height, width = contrast.shape
    rows, columns = -(-height // cell), -(-width // cell)
    padded = np.full((rows * cell, columns * cell), -1, np.float32)
    padded[:height, :width] = contrast
    cells = padded.reshape(rows, cell, columns, cell).swapaxes(1, 2).reshape(rows * columns, cell * cell)
    best = cells.argmax(axis=1)
    number = np.flatnonzero(cells[np.arange(len(cells)), best] >= 0)
    inner = np.stack(np.divmod(best[number], cell), axis=1)
    return np.asarray(np.stack(np.divmod(number, columns), axis=1) * cell + inner, np.int64)


def worst_joints(
    task: Task, exemplar: Float32[np.ndarray, "h w 3"], result: Float32[np.ndarray, "H W 3"]
) -> tuple[Places, int]:
    """The joints of largest contrast in these pictures, one a cell, and the side of the cells, px.

    `UnmeasurableError` where nothing of the result was made.
    """
    contrast = joint_contrast(exemplar, result, task.source_map(), task.tileable)
    made = task.result.made
    if made is not None:
        if not made.any():
            raise UnmeasurableError("nothing of the result was made")
        contrast[~made] = -1
    cell = max(_MIN_CELL, int(np.ceil(np.sqrt(contrast.size / _MAX_CELLS))))
    return worst_of_cells(contrast, cell), cell


class _Targets(NamedTuple):
    """Patches of the exemplar at one scale that are searched."""

    windows: np.ndarray
    """all patches, by their upper left samples"""
    corners: Places
    """those that are searched, row by row"""
    components: Float32[np.ndarray, "n d"]
    directions: Float32[np.ndarray, "e d"]
    stride: int


def _targets(task: Task, lab: np.ndarray, step: int) -> _Targets:
    whole = whole_patches(task.exemplar, step)
    directions = principal_directions(lab, step, whole)
    patches = patch_windows(lab, step)
    height, width = patches.shape[:2]
    stride = int(np.ceil(np.sqrt(height * width / _MAX_TARGETS)))
    chosen = np.zeros((height, width), bool)
    chosen[::stride, ::stride] = True
    if whole is not None:
        chosen = chosen & whole if (chosen & whole).any() else whole
    corners = np.argwhere(chosen)
    components = np.empty((len(corners), directions.shape[1]), np.float32)
    for start in range(0, len(corners), 4096):
        part = corners[start : start + 4096]
        components[start : start + 4096] = product(_gather(patches, part), directions)
    return _Targets(patches, corners, components, directions, stride)


def _gather(patches: np.ndarray, corners: Places) -> np.ndarray:
    return np.asarray(patches[corners[:, 0], corners[:, 1]].reshape(len(corners), -1))


def _squared(one: np.ndarray, other: np.ndarray) -> np.ndarray:
    difference = one - other
    return np.asarray(np.einsum("ne,ne->n", difference, difference)) / SIDE**2


def _nearest(targets: _Targets, wanted: np.ndarray, apart: Places | None = None, reach: int = 0) -> Places:
    """Corners of the target nearest to each patch by principal components.

    ``apart``: corners of the patches; targets nearer than ``reach`` px are left out.
    """
    components = product(wanted, targets.directions)
    squares = (targets.components**2).sum(axis=1)
    known = np.column_stack([targets.components, squares])
    nearest = np.zeros(len(wanted), np.int64)
    for first in range(0, len(wanted), _CHUNK):
        part = components[first : first + _CHUNK]
        factors = np.ascontiguousarray(np.column_stack([-2 * part, np.ones(len(part), np.float32)]).T)
        best = np.full(len(part), np.inf, np.float32)
        number = np.zeros(len(part), np.int64)
        for start in range(0, len(known), 1024):
            distances = product(known[start : start + 1024], factors)
            if apart is not None:
                gaps = np.abs(targets.corners[start : start + 1024, None] - apart[None, first : first + _CHUNK])
                distances[gaps.max(axis=2) < reach] = np.inf
            least = distances.min(axis=0)
            better = np.flatnonzero(least < best)
            best[better], number[better] = least[better], distances[:, better].argmin(axis=0) + start
        nearest[first : first + _CHUNK] = number
    return np.asarray(targets.corners[nearest])


def _refined(
    targets: _Targets, wanted: np.ndarray, corners: Places, apart: Places | None = None, reach: int = 0
) -> np.ndarray:
    """Exact squared distance to the best patch about ``corners``, down to steps of one pixel."""
    last = np.array(targets.windows.shape[:2]) - 1
    offsets = [(row, column) for row in (-1, 0, 1) for column in (-1, 0, 1) if row or column]
    best = _squared(wanted, _gather(targets.windows, corners))
    hop = targets.stride
    while hop > 1:
        hop = (hop + 1) // 2
        centre = corners.copy()
        for offset in offsets:
            tried = np.clip(centre + hop * np.array(offset), 0, last)
            distance = _squared(wanted, _gather(targets.windows, tried))
            if apart is not None:
                distance[np.abs(tried - apart).max(axis=1) < reach] = np.inf
            better = distance < best
            best[better], corners[better] = distance[better], tried[better]
    return best


def measure_joints(task: Task) -> Joints:
    """Search the exemplar for the patches across joints; `UnmeasurableError` where pictures do not allow it."""
    task.source_map()
    require_variation(task.exemplar)
    require_side(4 * SIDE, task.exemplar, task.result)
    places, cell = worst_joints(task, task.exemplar.lab, task.result.lab)
    if not len(places):
        return Joints(places, np.zeros((0, 1)), cell)
    shorter = min(task.exemplar.shorter, task.result.shorter)
    ratios = np.stack([_ratios(task, places, step) for step in _STEPS if shorter >= 4 * SIDE * step], axis=1)
    known = np.isfinite(ratios).any(axis=1)
    if not known.any():
        raise UnmeasurableError("masks leave no patch at a joint")
    return Joints(places[known], ratios[known], cell)


def _ratios(task: Task, places: Places, step: int) -> Float64[np.ndarray, "*n"]:
    """Distances of the patches at ``places`` over those of the exemplar's own; NaN where masks cover them."""
    half = (SIDE - 1) * step // 2
    mean = task.exemplar.colors.mean(axis=0)
    targets = _targets(task, smoothed(task.exemplar.lab - mean, step), step)
    result = task.result.lab - mean
    corners = places - half
    if task.tileable:
        result = np.pad(result, ((2 * half, 2 * half), (2 * half, 2 * half), (0, 0)), mode="wrap")
        corners = corners + 2 * half
    patches = patch_windows(smoothed(result, step), step)
    corners = np.clip(corners, 0, np.array(patches.shape[:2]) - 1)
    wanted = _gather(patches, corners)
    distances = _refined(targets, wanted, _nearest(targets, wanted)).astype(np.float64)
    if task.result.valid is not None:
        reach = (SIDE - 1) * step + 1
        whole = count_excluded(task.result.valid, reach, reach) == 0
        inside = np.clip(places - half, 0, np.array(whole.shape) - 1)
        distances[~whole[inside[:, 0], inside[:, 1]]] = np.nan
    return distances / max(_own_distance(targets, step), 1e-12)


def _own_distance(targets: _Targets, step: int) -> float:
    """Mean squared distance of random patches of the exemplar to those that do not overlap them."""
    height, width = targets.windows.shape[:2]
    reach = SIDE * step
    chosen = np.random.default_rng(5).permutation(len(targets.corners))[:_SELF]
    offset = np.random.default_rng(6).integers(0, targets.stride, (len(chosen), 2))
    own = np.minimum(targets.corners[chosen] + offset, (height - 1, width - 1))
    patches = _gather(targets.windows, own)
    return float(
        _refined(targets, patches, _nearest(targets, patches, own, reach), own, reach).mean(dtype=np.float64)
    )


def joint_figures(joints: Joints) -> Figures:
    """The mean ratio of the worst tenth of the joints; a result without joints is perfect."""
    if not len(joints.places):
        return Figures(0.0, _GOOD, _BAD, {"mean": 0.0})
    ratio = np.sort(joints.ratio)
    worst = ratio[-max(1, round(_WORST * len(ratio))) :]
    more = {"mean": float(ratio.mean()), "levels": np.nanmean(joints.ratios, axis=0).tolist()}
    return Figures(float(worst.mean()), _GOOD, _BAD, more)
