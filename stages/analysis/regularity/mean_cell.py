"""The median cell of a lattice, and what it leaves unexplained."""

from __future__ import annotations

import dataclasses

import numpy as np
from jaxtyping import Float32, Float64, Int32

from texloom.stages.numerics.matrices import inverse_of, matrix_product
from texloom.stages.vocabulary.arrays import Mask, ScalarMap, Vectors

_SLACK = 0.03  # of the shorter generator, by which parts of a cell may lie beside those of the median cell
_REACH = 0.12  # of the shorter generator, by which a whole cell may be moved
_PASSES = 2  # of placing the cells, and taking the median of them as they are placed
_FLOOR = 1e-3  # of mean differences; smaller ones are equal
_COMPARED = 2**15  # pixels of all cells, by which these are placed


@dataclasses.dataclass(frozen=True)
class MeanCell:
    """The cells of a lattice against their median."""

    median: Float32[np.ndarray, "m n c"]
    """of all cells as they are placed, by position along the first and the second generator"""
    deviation: Float32[np.ndarray, "m n"]
    """median absolute difference of the cells from it, mean of the channels; NaN where less than two cells are
    known"""
    expected: Float32[np.ndarray, "h w c"]
    """the picture as the median cell has it, each cell moved to where it fits best"""
    number: Int32[np.ndarray, "h w"]
    """which cell a pixel belongs to"""
    phase: Int32[np.ndarray, "h w 2"]
    """where in the median cell it lies"""
    lowest: Float32[np.ndarray, "h w c"]
    """least value of the median cell near there, within a few px; see `highest`"""
    highest: Float32[np.ndarray, "h w c"]
    """highest value there: what lies between both is explained, as edges are never quite where they should be"""

    @property
    def count(self) -> int:
        """Number of cells that the picture shows a part of."""
        return int(self.number.max()) + 1

    def per_cell(self, planes: Float32[np.ndarray, "h w c"], valid: Mask) -> Float32[np.ndarray, "h w c"]:
        """The median of planes over each cell's valid pixels, at all of its pixels; 0 where none is valid."""
        number = self.number[valid]
        order = np.argsort(number, kind="stable")
        values = np.zeros((self.count, planes.shape[2]), np.float32)
        ends = np.cumsum(np.bincount(number, minlength=self.count))
        rows = planes[valid][order]
        for index, (start, end) in enumerate(zip([0, *ends[:-1]], ends, strict=True)):
            if end > start:
                values[index] = np.median(rows[start:end], axis=0)
        return values[self.number]

    def explained(self, plane: ScalarMap, valid: Mask, channel: int = 0) -> float:
        """Correlation of the cells, as ``plane`` has them, with the median cell's channel; their median, -1..1."""
        number = self.number[valid]
        expected = self.expected[valid][:, channel].astype(np.float64)
        values = plane[valid].astype(np.float64)

        def mean(of: Float64[np.ndarray, "n"]) -> Float64[np.ndarray, "k"]:  # type: ignore[name-defined]
            return np.bincount(number, of, self.count) / np.maximum(np.bincount(number, minlength=self.count), 1)

        one, other = values - mean(values)[number], expected - mean(expected)[number]
        product, first, second = mean(one * other), mean(one * one), mean(other * other)
        known = np.bincount(number, minlength=self.count) * 2 >= self.median.shape[0] * self.median.shape[1]
        correlation = product / np.sqrt(np.maximum(first * second, 1e-12))
        return float(np.median(correlation[known])) if known.any() else 0.0


def mean_cell(planes: Float32[np.ndarray, "h w c"], generators: Vectors, valid: Mask | None = None) -> MeanCell:
    """Take the median cell of a picture's lattice.

    Each pixel of the median cell is the median over all cells, so that what is seen in less than half of them,
    such as a door in a wall, leaves no trace. Cells are first moved by up to an eighth of the shorter generator, to
    where they differ least from the median, but for a tint; twice, as it becomes sharper.

    Parameters
    ----------
    planes : of the picture, such as CIELAB.
    generators : of its lattice, px, two rows.
    valid : where it is known; all, if none.

    References
    ----------
    Ours.
    """
    shape = (planes.shape[0], planes.shape[1])
    frame = np.asarray(generators, np.float64)
    known = np.ones(shape, np.bool_) if valid is None else valid
    side = np.maximum(2, np.rint(np.hypot(*frame.T))).astype(int)
    cycles = matrix_product(np.indices(shape).reshape(2, -1).T.astype(np.float64), inverse_of(frame))
    steps = np.floor(cycles).astype(np.int64)
    steps -= steps.min(axis=0)
    low = np.floor(cycles.min(axis=0))
    _, number = np.unique(steps[:, 0] * (steps[:, 1].max() + 1) + steps[:, 1], return_inverse=True)
    number = number.reshape(-1)
    count = int(number.max()) + 1
    corner = np.zeros((count, 2))
    corner[number] = matrix_product(steps + low, frame)
    along = np.moveaxis(np.indices(tuple(side)), 0, -1).reshape(-1, 2) / side
    offsets = matrix_product(along, frame)
    shorter = float(np.hypot(*frame.T).min())
    moves = np.zeros((count, 2), np.int64)
    cells = _cut(planes, known, corner, offsets)
    median = _median(cells)
    for _ in range(_PASSES):
        moves = _placed(planes, known, corner, offsets, median, moves, round(_REACH * shorter))
        cells = _cut(planes, known, corner + moves, offsets)
        median = _median(cells)
    differences = np.abs(cells - median).mean(axis=2)
    deviation = _median(differences[..., None])[:, 0]
    deviation[np.isfinite(differences).sum(axis=0) < 2] = np.nan
    pixels = np.indices(shape).reshape(2, -1).T - moves[number]
    phase = matrix_product(pixels.astype(np.float64), inverse_of(frame))
    phase = np.minimum((np.mod(phase, 1.0) * side).astype(np.int64), side - 1)
    picture = median.reshape(*side, -1)
    slack = max(1, round(_SLACK * shorter))
    lowest, highest = _extremes(picture, slack)
    row, column = phase.T

    def spread(values: Float32[np.ndarray, "m n c"]) -> Float32[np.ndarray, "h w c"]:
        return values[row, column].reshape(*shape, -1)

    return MeanCell(
        median=picture,
        deviation=deviation.reshape(tuple(side)),
        expected=spread(picture),
        number=number.reshape(shape).astype(np.int32),
        phase=phase.reshape(*shape, 2).astype(np.int32),
        lowest=spread(lowest),
        highest=spread(highest),
    )


def _cut(
    planes: Float32[np.ndarray, "h w c"],
    known: Mask,
    corner: Float64[np.ndarray, "k 2"],
    offsets: Float64[np.ndarray, "p 2"],
) -> Float32[np.ndarray, "k p c"]:
    """The pixels of all cells; NaN where they are not known."""
    height, width = known.shape
    row, column = (np.rint(corner[:, axis, None] + offsets[:, axis]).astype(np.int64) for axis in (0, 1))
    inside = (row >= 0) & (row < height) & (column >= 0) & (column < width)
    row, column = np.clip(row, 0, height - 1), np.clip(column, 0, width - 1)
    inside &= known[row, column]
    cells = planes[row, column]
    cells[~inside] = np.nan
    return cells


def _median(cells: Float32[np.ndarray, "k p c"]) -> Float32[np.ndarray, "p c"]:
    """Over the cells, of those that are known; of a pixel that none of them knows, the median of all."""
    median = _known_median(cells)
    if np.isfinite(median).all():
        return median
    return np.asarray(np.where(np.isfinite(median), median, np.nanmedian(cells, axis=(0, 1))), np.float32)


def _known_median(values: Float32[np.ndarray, "n k c"]) -> Float32[np.ndarray, "k c"]:
    """Over the first axis, of what is known; NaN where nothing is."""
    ordered = np.sort(values, axis=0)  # NaN last
    count = np.isfinite(ordered).sum(axis=0)
    low, high = (
        np.take_along_axis(ordered, index[None], 0)[0] for index in (np.maximum(count - 1, 0) // 2, count // 2)
    )
    return np.asarray((low + high) / 2, np.float32)


def _placed(
    planes: Float32[np.ndarray, "h w c"],
    known: Mask,
    corner: Float64[np.ndarray, "k 2"],
    offsets: Float64[np.ndarray, "p 2"],
    median: Float32[np.ndarray, "p c"],
    moves: np.ndarray,
    reach: int,
) -> np.ndarray:
    """By how many px each cell is moved to differ least from the median, mean absolute difference."""
    best, least = moves.copy(), np.full(len(corner), np.inf)
    thin = slice(None, None, max(1, len(offsets) * len(corner) // _COMPARED))
    around = np.moveaxis(np.indices((2 * reach + 1, 2 * reach + 1)), 0, -1).reshape(-1, 2) - reach
    around = around[np.argsort(np.abs(around).sum(axis=1), kind="stable")]  # the smallest of several equal moves
    step = max(1, reach // 4)
    for move in around[(around % step == 0).all(axis=1)]:
        off = _cut(planes, known, corner + move, offsets[thin]) - median[thin]
        shift = _known_median(np.moveaxis(off, 1, 0))  # (cells, c): tint of each
        difference = np.abs(off - shift[:, None]).mean(axis=2)
        counts = np.isfinite(difference).sum(axis=1)
        mean = np.where(np.isfinite(difference), difference, 0).sum(axis=1) / np.maximum(counts, 1)
        mean = np.where(counts >= difference.shape[1] // 4, mean, np.inf)
        better = mean < least * (1 - 1e-3) - _FLOOR * (least < np.inf)
        best[better], least[better] = move, mean[better]
    return best


def _extremes(
    picture: Float32[np.ndarray, "m n c"], slack: int
) -> tuple[Float32[np.ndarray, "m n c"], Float32[np.ndarray, "m n c"]]:
    """Least and highest values in a square around each pixel of a cell, which wraps."""
    shifts = [(down, across) for down in range(-slack, slack + 1) for across in range(-slack, slack + 1)]
    lowest = highest = picture
    for shift in shifts:
        moved = np.roll(picture, shift, (0, 1))
        lowest, highest = np.minimum(lowest, moved), np.maximum(highest, moved)
    return lowest, highest
