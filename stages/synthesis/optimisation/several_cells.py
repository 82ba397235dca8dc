"""Whole cells of several exemplars in one picture, where they meet."""

import dataclasses
from typing import ClassVar

import numpy as np
from jaxtyping import Bool, Float32, Float64, Int64

from texloom.stages.analysis.structure.contour_cells import MIN_CELLS, ContourCells
from texloom.stages.analysis.structure.ground_objects import GroundObjects
from texloom.stages.common.grids.border import Border
from texloom.stages.common.similarity.neighbourhoods import Rectangles, numbers_in
from texloom.stages.synthesis.optimisation.allowed import Allowed
from texloom.stages.synthesis.optimisation.cell_completion import MIN_SEAM, CellCompletion, Shown
from texloom.stages.synthesis.optimisation.cells import most_frequent
from texloom.stages.synthesis.optimisation.object_completion import ObjectCompletion
from texloom.stages.synthesis.stitching.seams import UNIT, pairs
from texloom.stages.vocabulary.arrays import ScalarMap

_SOME_SHARE = 0.2  # of the area of whole cells, in closed contours, of an exemplar whose cells no border should cut
_STANDS = 0.6  # of a cell's area, shown in one piece, from which on it is not removed


class SeveralCells(ContourCells):
    """The cells of those exemplars in one picture that have some.

    Parameters
    ----------
    strength : of the contours of all.
    rectangles : of the exemplars.
    border : by which the picture is continued.
    """

    exemplar: Int64[np.ndarray, "h w"]
    """number of each pixel's exemplar, from 1; 0 between them"""
    consists: Bool[np.ndarray, "n"]
    """cells of exemplars that consist of cells; others only have some"""

    def __init__(self, strength: ScalarMap, rectangles: Rectangles, border: Border):
        label, core = np.zeros(strength.shape, np.int64), np.zeros(strength.shape, bool)
        whole, area, boxes = [np.zeros(1, bool)], [np.zeros(1, np.int64)], [np.zeros((1, 4), np.int64)]
        consists = [np.zeros(1, bool)]
        count = 1  # label 0 is no cell
        for row, column, height, width in rectangles.tolist():
            place = np.s_[row : row + height, column : column + width]
            own = ContourCells(np.ascontiguousarray(strength[place]), Border(1))
            if own.whole.sum() < MIN_CELLS or own.closed_share < _SOME_SHARE:
                continue
            consists.append(np.full(len(own.area), own.clear))
            label[place], core[place] = own.label + count, own.core
            count += len(own.area)
            whole.append(own.whole)
            area.append(own.area)
            boxes.append(own.boxes + (np.array([row, column] * 2) + border.before))
        self.label, self.core = border.around(label), border.around(core)
        self.exemplar = border.around(numbers_in(rectangles, *strength.shape).astype(np.int64))
        self.whole, self.area, self.boxes = np.concatenate(whole), np.concatenate(area), np.concatenate(boxes)
        self.consists = np.concatenate(consists)

    @property
    def clear(self) -> bool:
        """Whether an exemplar has cells."""
        return bool(self.whole.any())


class SeveralCellCompletion(CellCompletion):
    """`CellCompletion` where several exemplars meet, whose borders come to lie between their cells.

    Cells that border on another exemplar are completed too, by their own rest or by another cell of their exemplar;
    or where only a smaller part of one is shown, the other exemplar is continued over it.
    """

    rounds: ClassVar = 4
    """a cell that is completed may cut one of another exemplar"""

    def __init__(
        self, lab: Float32[np.ndarray, "h w 3"], cells: SeveralCells, patch_size: int, allowed: Allowed | None
    ):
        super().__init__(lab, cells, patch_size, allowed, cells.exemplar.astype(np.int16))
        self.exemplar, self.consists = cells.exemplar, cells.consists

    def _shown(self, source: Int64[np.ndarray, "2 p q"]) -> Shown:
        shown, label = super()._shown(source), self.cells.label[source[0], source[1]]
        number, count = shown.number, len(shown.severity)
        only_some = np.ones(count, bool)
        only_some[number[(number > 0) & self.consists[label]]] = False
        cut = self._cut_by_others(source, number, count)
        return dataclasses.replace(
            shown,
            severity=np.where(only_some, 0, shown.severity) + cut,
            extents=self._extents(shown.boxes, source, number, label, cut >= MIN_SEAM * UNIT),
        )

    def _cut_by_others(
        self, source: Int64[np.ndarray, "2 p q"], number: Int64[np.ndarray, "p q"], count: int
    ) -> Float64[np.ndarray, "n"]:  # type: ignore[name-defined]
        """Cost of each cell's seams to other exemplars."""
        total = np.zeros(count)
        exemplar = self.exemplar[source[0], source[1]]
        for axis in (0, 1):
            (first, second), (here, there) = pairs(number, axis), pairs(exemplar, axis)
            seam = (here != there) & ((first > 0) | (second > 0))
            cost = self._seam_costs(source, axis, seam)
            for cell in (first, second):
                total += np.bincount(cell[seam], cost, count)
        total[0] = 0
        return total

    def _extents(
        self,
        boxes: Int64[np.ndarray, "n 4"],
        source: Int64[np.ndarray, "2 p q"],
        number: Int64[np.ndarray, "p q"],
        label: Int64[np.ndarray, "p q"],
        cut: Bool[np.ndarray, "n"],  # type: ignore[name-defined]
    ) -> Int64[np.ndarray, "n 4"]:
        """The boxes; of cells that are ``cut``, with all of the exemplar's cell that they show most of."""
        result = boxes.copy()
        inside = cut[number]
        down, across = (source - np.indices(number.shape))[:, inside]
        width = 4 * max(*self.lab.shape[:2], *number.shape)
        code = (label[inside] * width + down + width // 2) * width + across + width // 2
        best, _ = most_frequent(number[inside], code, len(boxes))
        rest, column = np.divmod(best, width)
        cell, row = np.divmod(rest, width)
        whole = self.cells.boxes[cell] - np.tile(np.stack([row, column], axis=1) - width // 2, 2)
        known = cut & self.cells.whole[cell]
        result[known, :2] = np.minimum(boxes, whole)[known, :2]
        result[known, 2:] = np.maximum(boxes, whole)[known, 2:]
        return result

    def _removed(
        self,
        inside: Bool[np.ndarray, "a b"],
        source: Int64[np.ndarray, "2 a b"],
        shift: Int64[np.ndarray, "2 a b"],
    ) -> tuple[np.ndarray, np.ndarray] | None:
        """The displacement of another exemplar beside a cell, and all that is shown of the cell, with its contour;
        none where no other is beside it, or most of a cell is shown."""
        import cv2

        exemplar = self.exemplar[source[0], source[1]]
        near = cv2.dilate(inside.astype(np.uint8), np.ones((3, 3), np.uint8)) > 0
        beside = near & (exemplar != exemplar[inside][0])
        if not beside.any():
            return None
        label = self.cells.label[source[0], source[1]]
        code = shift[0] * (4 * max(*self.lab.shape[:2], *inside.shape)) + shift[1]
        most, times = _mode(code[inside])
        shown = int(label[inside & (code == most)][0])
        if times > _STANDS * self.cells.area[shown]:
            return None
        moved = shift[:, beside & (code == _mode(code[beside])[0])][:, 0]
        return moved, inside | ((label == shown) & (code == most))


def _mode(values: Int64[np.ndarray, "n"]) -> tuple[int, int]:  # type: ignore[name-defined]
    """The most frequent value, and how often it occurs."""
    best, times = most_frequent(np.zeros(len(values), np.int64), values, 1)
    return int(best[0]), int(times[0])


def completion_of(
    cells: ContourCells, lab: Float32[np.ndarray, "h w 3"], patch_size: int, allowed: Allowed | None
) -> CellCompletion:
    """That of the cells of one exemplar or of several, which contours surround, or of objects on a ground."""
    if isinstance(cells, SeveralCells):
        return SeveralCellCompletion(lab, cells, patch_size, allowed)
    kind = ObjectCompletion if isinstance(cells, GroundObjects) else CellCompletion
    return kind(lab, cells, patch_size, allowed)
