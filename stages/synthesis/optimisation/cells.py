"""Whole cells of a lattice without clear contours: joints that cross a cell are moved to its outline."""

import math
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float32, Float64, Int64

from texloom.stages.numerics.matrices import determinant, inverse_of, matrix_product
from texloom.stages.synthesis.optimisation.allowed import Allowed
from texloom.stages.synthesis.optimisation.correspondence import Patches
from texloom.stages.synthesis.optimisation.lattice_phase import LatticePhase
from texloom.stages.synthesis.optimisation.target_windows import target_windows
from texloom.stages.synthesis.stitching.seams import SeamCosts, pairs
from texloom.stages.vocabulary.arrays import Vectors
from texloom.stages.vocabulary.facts import Wraps

_LEAST_SAVING = 0.5  # of the cost of a cell's joints; with less, lines across several cells break
_STEPS = ((1, 0), (0, 1), (1, 1), (1, -1))  # generators to the cells that are compared
_WINDOW = 1024  # px of the result that are in memory at once


@dataclass(frozen=True)
class _Outline:
    """Rows of cells along one generator, divided at right angles to it: like a wall, whose rows may be shifted."""

    along: int
    """the generator that rows follow"""
    slope: float
    """of the other one along it, in generators"""
    origin: Float64[np.ndarray, "2"]
    """row and column of the first outline, in cells"""

    def __call__(self, position: Float64[np.ndarray, "2 *n"]) -> Float64[np.ndarray, "2 *n"]:
        """Row and column, in cells, of positions in generators; integers are outlines."""
        row = position[1 - self.along] - self.origin[0]
        column = position[self.along] - self.origin[1] + (row + self.origin[0] - np.floor(row)) * self.slope
        return np.stack([row, column])


def complete_cells(
    match: Patches,
    lab: Float32[np.ndarray, "h w 3"],
    patch_size: int,
    margin: tuple[int, int],
    wrap: Wraps,
    generators: Vectors,
    phase: LatticePhase,
    allowed: Allowed | None,
) -> None:
    """Give cells that show parts of several their most frequent displacement, where that halves their joints' cost.

    Where cells differ in tone alone, a joint costs the same wherever it crosses a cell, so the optimisation ends
    with cells of two tones. Costs of joints are those of graph cuts, squared: less along contours than in flat
    places, and most across contours that do not continue. Cells larger than half of `_WINDOW` are left.

    Parameters
    ----------
    match : at full size, changed in place; the target has ``margin`` px above and below, left and right.
    wrap : where the target wraps.
    lab : the exemplar, CIELAB.
    generators : px, two rows.
    """
    reach = 2 + math.ceil(np.abs(generators).sum(axis=0).max())  # more than the height and width of a cell
    if 2 * reach > _WINDOW:
        return
    costs = SeamCosts(lab, gradients=True, squared=True)
    outline = _outline(*_unlikeness(lab, generators), generators)
    down, across = phase.target[..., None, None]
    for window in target_windows(match.shape[1:], wrap, _WINDOW, reach):
        rows, columns = (
            line + (patch_size // 2 - before)
            for line, before in zip((window.rows, window.columns), margin, strict=True)
        )
        position = rows[:, None] * down + columns * across + phase.origin[:, None, None]
        part = match[:, *window.place]
        cell = np.floor(outline(position)).astype(np.int64)
        _complete(part, cell, window.border, costs, patch_size, allowed)
        match[:, *window.place] = part


def _complete(
    match: Patches,
    cell: Int64[np.ndarray, "2 p q"],
    ends: Bool[np.ndarray, "p q"],
    costs: SeamCosts,
    patch_size: int,
    allowed: Allowed | None,
) -> None:
    """`complete_cells` for a part; cells that contain pixels of ``ends`` are left."""
    middle = patch_size // 2
    cell -= cell.min(axis=(1, 2), keepdims=True)
    number = cell[0] * (cell[1].max() + 1) + cell[1]
    count = int(number.max()) + 1
    # Sources as one number, so wide that no displacement within the part is ambiguous.
    line = costs.shape[1] + match.shape[2]
    here = np.arange(match.shape[1])[:, None] * line + np.arange(match.shape[2])
    source = (match[0].astype(np.int64) + middle) * line + match[1] + middle
    mixed = np.zeros(count, bool)
    for axis, step in enumerate((line, 1)):
        (one, other), (first, second) = pairs(source, axis), pairs(number, axis)
        mixed[first[(first == second) & (other - one != step)]] = True
    mixed[number[ends]] = False
    inside = mixed[number]
    if not inside.any():
        return

    proposed = source.copy()
    shift, _ = most_frequent(number[inside], (source - here)[inside], count)
    proposed[inside] = here[inside] + shift[number[inside]]
    row, column = np.divmod(proposed, line)
    row, column = row - middle, column - middle
    places = np.array(costs.shape) - patch_size + 1
    usable = (row >= 0) & (column >= 0) & (row < places[0]) & (column < places[1])
    if allowed is not None:
        usable[usable] = allowed.places[row[usable], column[usable]]
    proposed[~usable] = source[~usable]

    # neighbours are decided one after the other
    of_cells = np.zeros(count, np.int64)
    of_cells[number] = cell[0] % 2 * 2 + cell[1] % 2
    for group in range(4):
        active = mixed & (of_cells == group)
        tried = np.where(active[number], proposed, source)
        before, after = (_joint_costs(costs, line, one, number, active) for one in (source, tried))
        taken = active & (after < _LEAST_SAVING * before)
        source = np.where(taken[number], proposed, source)
    match[0], match[1] = np.divmod(source, line)
    match -= middle


def most_frequent(
    number: Int64[np.ndarray, "n"],  # type: ignore[name-defined]
    value: Int64[np.ndarray, "n"],  # type: ignore[name-defined]
    count: int,
) -> tuple[Int64[np.ndarray, "k"], Int64[np.ndarray, "k"]]:  # type: ignore[name-defined]
    """The most frequent value of each number, of equals the smallest, and how often it occurs."""
    order = np.lexsort((value, number))
    number, value = number[order], value[order]
    first = np.flatnonzero(np.r_[True, (np.diff(number) != 0) | (np.diff(value) != 0)][: len(number)])
    runs = np.diff(np.r_[first, len(number)])
    best, times = np.zeros(count, np.int64), np.zeros(count, np.int64)
    last = np.lexsort((-value[first], runs))
    best[number[first][last]] = value[first][last]  # the last of a number is kept
    times[number[first][last]] = runs[last]
    return best, times


def _joint_costs(
    costs: SeamCosts,
    line: int,
    source: Int64[np.ndarray, "p q"],
    number: Int64[np.ndarray, "p q"],
    active: Bool[np.ndarray, "n"],  # type: ignore[name-defined]
) -> Float64[np.ndarray, "n"]:  # type: ignore[name-defined]
    """Cost of the joints in and around each active cell."""
    width = source.shape[1]
    source, number = source.ravel(), number.ravel()
    total = np.zeros(len(active))
    for axis, (step, hop) in enumerate(((line, width), (1, 1))):
        joint = np.flatnonzero(source[hop:] - source[:-hop] != step)
        if axis == 1:
            joint = joint[joint % width != width - 1]
        first, second = number[joint], number[joint + hop]
        counted = active[first] | active[second]
        joint, first, second = joint[counted], first[counted], second[counted]
        ends = [np.stack(np.divmod(source[end], line), axis=1).astype(np.int32) for end in (joint, joint + hop)]
        cost = costs.between(axis, ends[0], ends[1])
        total += np.bincount(first, cost, len(active))
        total += np.bincount(second, np.where(first == second, 0, cost), len(active))
    return total


def _unlikeness(
    lab: Float32[np.ndarray, "h w 3"], generators: Vectors
) -> tuple[Float64[np.ndarray, "h w"], Float64[np.ndarray, "h w"]]:
    """Mean squared difference of each pixel from those in the same place of the cells around, and their number."""
    import cv2

    smooth = cv2.blur(lab, (3, 3))
    height, width = lab.shape[:2]
    total, pairs_of = np.zeros((height, width)), np.zeros((height, width))
    for step in _STEPS:
        down, across = (int(one) for one in np.rint(matrix_product(step, generators.astype(np.float64))))
        if abs(down) >= height or abs(across) >= width:
            continue
        one = np.s_[max(0, -down) : height - max(0, down), max(0, -across) : width - max(0, across)]
        other = np.s_[max(0, down) : height + min(0, down), max(0, across) : width + min(0, across)]
        difference = ((smooth[one] - smooth[other]) ** 2).sum(axis=2)
        for end in (one, other):
            total[end] += difference
            pairs_of[end] += 1
    return total / np.maximum(pairs_of, 1), pairs_of


def _outline(
    different: Float64[np.ndarray, "h w"], pairs_of: Float64[np.ndarray, "h w"], generators: Vectors
) -> _Outline:
    """The outline on which the cells of an exemplar differ least from each other, see `_unlikeness`."""
    basis = generators.astype(np.float64)
    here = np.moveaxis(np.indices(different.shape), 0, 2)
    position = np.moveaxis(matrix_product(here, inverse_of(basis)), 2, 0)
    found = []
    for along in (0, 1):
        direction, other = basis[along], basis[1 - along]
        slope = float(matrix_product(direction, other) / matrix_product(direction, direction))
        outline, least = _Outline(along, slope, np.zeros(2)), 0.0
        area = abs(determinant(basis))
        for axis, spacing in enumerate((area / np.hypot(*direction), np.hypot(*direction))):
            bins = max(4, round(float(spacing)))
            place = np.minimum(outline(position)[axis] % 1 * bins, bins - 1).astype(np.int64).ravel()
            known = np.bincount(place, pairs_of.ravel() > 0, bins)
            profile = np.bincount(place, different.ravel(), bins) / np.maximum(known, 1)
            profile = (np.roll(profile, 1) + profile + np.roll(profile, -1)) / 3
            outline.origin[axis] = (int(profile.argmin()) + 0.5) / bins
            least += float(profile.min())
        found.append((least, along, outline))
    return min(found, key=lambda one: one[:2])[2]
