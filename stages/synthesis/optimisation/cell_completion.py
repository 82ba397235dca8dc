"""Whole cells between contours in place of those that a result shows parts of several of."""

from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np
from jaxtyping import Bool, Float32, Float64, Int16, Int64

from texloom.stages.analysis.structure.contour_cells import ContourCells, boxes_of
from texloom.stages.synthesis.optimisation.allowed import Allowed
from texloom.stages.synthesis.optimisation.cells import most_frequent
from texloom.stages.synthesis.optimisation.correspondence import Patches
from texloom.stages.synthesis.optimisation.target_windows import target_windows
from texloom.stages.synthesis.stitching.seams import UNIT, SeamCosts, pairs
from texloom.stages.vocabulary.facts import Wraps

_WINDOW = 1024  # px of the result that are in memory at once
_WIDEST = 256  # px of a cell that is completed
_LARGEST = 0.8  # of the exemplar's shorter side, the same
_BAND = 4  # px around a cell in which it may be cut out
_REACH = 0.35  # of a cell's side, by which a cell laid over it may be larger; and sizes of those tried may differ
_MIN_PART = 0.06  # of a cell's area, that is seen
MIN_SEAM = 8  # px of a just visible seam across a cell
_OFFSET = 8.0  # CIELAB units, added to gradients: else flat places outweigh broken contours
_MAJORITY = 0.5  # weight of the most frequent source, relative to the pixels around
_POINTS = 120  # of a cell that are compared
_TRIED = 48  # cells of the exemplar for a cell
_SAME = 2.0  # factor on the cost of a cell that is also next to it
_LEAST_KNOWN = 0.25  # of a cell's area, that is shown, for it to be completed at its place
_NEAR = 0.3  # of a cell's area, that counts as shown
_CHOSEN = 2  # best cells, and as many completed fragments, that are cut out
_STUB = 0.5  # of the area of the exemplar's small cells, below which a cell is a stub
_STUB_COST = 50.0  # of a stub, in just visible seams as long as its side
_SMALL = 0.1  # quantile of the areas that is a small cell's
_JITTER = np.stack(np.meshgrid([0, -1, 1], [0, -1, 1], indexing="ij"), axis=-1).reshape(-1, 2)


@dataclass(frozen=True)
class Shown:
    """The cells that a result shows: connected insides of cells, whatever they come from."""

    number: Int64[np.ndarray, "p q"]
    """of the cell of each pixel; 0 for contours"""
    boxes: Int64[np.ndarray, "n 4"]
    severity: Float64[np.ndarray, "n"]
    """cost of the seams across a cell; 0 where what differs from its most frequent source is too small to see"""
    used: Float64[np.ndarray, "k"]
    """use of the exemplar's cells, relative to even use, at least 1"""
    extents: Int64[np.ndarray, "n 4"]
    """boxes, with the rest of those that other exemplars cut"""


class CellCompletion:
    """Searches whole cells in an exemplar and lays them over cells with seams.

    Parameters
    ----------
    lab : the exemplar with its border, CIELAB.
    cells : of the exemplar.
    allowed : which patches may be used; none for all.
    numbers : of each pixel's exemplar, from 1, where ``lab`` shows several; 0 between them.
    """

    rounds: ClassVar = 2
    reach: ClassVar = 0
    """px around what a round changes in which the next one looks too"""

    def __init__(
        self,
        lab: Float32[np.ndarray, "h w 3"],
        cells: ContourCells,
        patch_size: int,
        allowed: Allowed | None,
        numbers: Int16[np.ndarray, "h w"] | None = None,
    ):
        self.lab, self.cells, self.middle = np.ascontiguousarray(lab), cells, patch_size // 2
        self.places = np.zeros(lab.shape[:2], bool)
        inside = tuple(slice(self.middle, self.middle + side - patch_size + 1) for side in lab.shape[:2])
        self.places[inside] = True if allowed is None else allowed.places
        self.stub = _STUB * float(np.quantile(cells.area[cells.whole], _SMALL))
        self.stub_cost = _STUB_COST * UNIT * float(np.sqrt(self.stub))
        self.whole = np.flatnonzero(cells.whole)
        self.fair = np.bincount(cells.label.ravel(), minlength=len(cells.area)) / max(1, int(self.places.sum()))
        numbers = np.ones(cells.label.shape, np.int16) if numbers is None else numbers
        self.inside = np.where(cells.core, numbers, -numbers)
        """number of each pixel's exemplar, from 1; below 0 where it is not inside a cell"""
        self.owner = np.ones(len(cells.area), np.int16)
        """exemplar of each cell"""
        self.owner[cells.label[cells.core]] = self.inside[cells.core]
        self.costs = self._costs()

    def _costs(self) -> SeamCosts:
        return SeamCosts(self.lab, gradients=True, squared=True, offset=_OFFSET)

    def complete(self, match: Patches, wrap: Wraps) -> int:
        """Complete cells of a result in place, and tell how many.

        Each cell with a visible seam is compared at the pixels around it, and at those of its most frequent source,
        with every cell of the exemplar of like size, in nine alignments of both boxes; and the cells that it shows
        parts of are tried at their place. The best are cut out along the cheapest path near their contours. What
        saves most cost of seams is kept, if anything does. Cells that are used much, or lie next to it, cost more.
        """
        total = 0
        recent = np.ones(match.shape[1:], bool)  # what the round before changed
        for _ in range(self.rounds):
            changed = 0
            waiting, recent = wider(recent, self.reach), np.zeros(match.shape[1:], bool)
            for window in target_windows(match.shape[1:], wrap, _WINDOW, _WIDEST + 2 * int(_pad(_WIDEST)) + 2):
                own = waiting[window.place]
                if not own.any():
                    continue
                source = match[:, *window.place].astype(np.int64) + self.middle
                before = source.copy()
                count = self._completed(source, window.border, own)
                waiting[window.place] = own
                if count:
                    match[:, *window.place] = source - self.middle
                    recent[window.place] |= (source != before).any(axis=0)
                changed += count
            total += changed
            if not changed:
                break
        return total

    def _completed(
        self, source: Int64[np.ndarray, "2 p q"], border: Bool[np.ndarray, "p q"], waiting: Bool[np.ndarray, "p q"]
    ) -> int:
        """Complete those cells of a window, in place, that have pixels of ``waiting``; how many.

        What was looked at waits no longer: cells that no border of the window cuts, with all around them.
        """
        shown = self._shown(source)
        largest = min(_WIDEST, int(_LARGEST * min(self.lab.shape[:2])))
        sides = shown.boxes[:, 2:] - shown.boxes[:, :2]
        mixed = (shown.severity >= MIN_SEAM * UNIT) & (sides.max(axis=1) <= largest)
        mixed &= np.bincount(shown.number[waiting], minlength=len(mixed)) > 0
        pad, inside = _pad(sides), np.ones(len(sides), bool)
        limits = np.array(source.shape[1:])
        outer = np.concatenate([shown.extents[:, :2] - pad, shown.extents[:, 2:] + pad], axis=1)
        for axis in (0, 1):
            before, after = (border[0, :], border[-1, :]) if axis == 0 else (border[:, 0], border[:, -1])
            if before[1:-1].any():
                inside &= outer[:, axis] > 0
            if after[1:-1].any():
                inside &= outer[:, axis + 2] < limits[axis]
        waiting &= ~inside[shown.number]
        outer = np.clip(outer, 0, np.tile(limits, 2))
        left_over = np.flatnonzero(mixed & inside)
        left_over = left_over[np.lexsort((left_over, -shown.severity[left_over]))]
        done = 0
        while len(left_over):
            busy = np.zeros(source.shape[1:], bool)
            now: list[int] = []
            later: list[int] = []
            for cell in left_over.tolist():
                top, left, bottom, right = outer[cell]
                view = busy[top:bottom, left:right]
                (later if view.any() else now).append(cell)
                view[:] = True
            done += self._laid(source, shown, now, outer)
            left_over = np.array(later, np.int64)
        return done

    def _shown(self, source: Int64[np.ndarray, "2 p q"]) -> Shown:
        core = np.maximum(self.inside[source[0], source[1]], 0)
        number, count = _connected(core)
        severity = np.zeros(count)
        for axis in (0, 1):
            first, second = pairs(number, axis)
            one, other = ([pairs(plane, axis)[end] for plane in source] for end in (0, 1))
            apart = (other[0] - one[0] != (axis == 0)) | (other[1] - one[1] != (axis == 1))
            seam = (first > 0) & (first == second) & apart
            severity += np.bincount(first[seam], self._seam_costs(source, axis, seam), count)
        shift = source - np.indices(core.shape)
        inside = core > 0
        code = (shift[0] * (4 * max(self.lab.shape[1], core.shape[1])) + shift[1])[inside]
        own = number[inside]
        with_seam = severity[own] > 0
        _, most = most_frequent(own[with_seam], code[with_seam], count)
        size = np.bincount(own, minlength=count)
        severity[size - most < _MIN_PART * size] = 0
        use = np.bincount(self.cells.label[source[0], source[1]].ravel(), minlength=len(self.cells.area))
        boxes = boxes_of(number, inside, count)
        return Shown(number, boxes, severity, np.maximum(1.0, use / (self.fair * number.size)), boxes)

    def _seam_costs(
        self, source: Int64[np.ndarray, "2 p q"], axis: int, seam: Bool[np.ndarray, "u v"]
    ) -> Int64[np.ndarray, "n"]:  # type: ignore[name-defined]
        """Cost of each seam between neighbours along ``axis``."""
        ends = [np.stack([pairs(plane, axis)[end][seam] for plane in source], axis=1) for end in (0, 1)]
        return self.costs.between(axis, *(end.astype(np.int32) for end in ends))

    def _laid(
        self, source: Int64[np.ndarray, "2 p q"], shown: Shown, cells: list[int], outer: Int64[np.ndarray, "n 4"]
    ) -> int:
        """Complete cells whose surroundings do not overlap: with the first candidates, else with the others."""
        found = self._candidates(source, shown, cells, outer)
        done: set[int] = set()
        for first in (True, False):
            tried = [
                (cell, shift, region, factor)
                for cell, own in zip(cells, found, strict=True)
                for is_first, shift, region, factor in own
                if is_first == first and cell not in done
            ]
            if tried:
                done |= self._cut_out(source, shown, tried, outer)
        return len(done)

    def _cut_out(
        self,
        source: Int64[np.ndarray, "2 p q"],
        shown: Shown,
        tried: list[tuple[int, np.ndarray, np.ndarray, float]],
        outer: Int64[np.ndarray, "n 4"],
    ) -> set[int]:
        """Lay the best of the tried displacements over each cell, where one pays; the cells where it does."""
        import cv2

        from texloom.stages.kernels.cells.cell_cuts import cut_cells
        from texloom.stages.kernels.core.threads import run_all, spans
        from texloom.stages.kernels.seams.window_state import FILLED, FREE, KEPT

        boxes = np.array([_box_around(shown.boxes[cell], region, outer[cell]) for cell, _, region, _ in tried])
        sides = boxes[:, 2:] - boxes[:, :2]
        rows = np.cumsum([0, *sides[:, 0]])
        width = int(sides[:, 1].max())
        old, state = np.zeros((rows[-1], width, 2), np.int32), np.full((rows[-1], width), KEPT, np.int8)
        shifts = np.zeros((len(tried), 3), np.int64)
        element = np.ones((2 * _BAND + 1,) * 2, np.uint8)
        possible = np.ones(len(tried), bool)
        for index, (cell, shift, whole, _) in enumerate(tried):
            top, left, bottom, right = boxes[index]
            view = np.s_[rows[index] : rows[index + 1], : right - left]
            old[view] = np.moveaxis(source[:, top:bottom, left:right], 0, 2)
            own = shown.number[top:bottom, left:right] == cell
            first = outer[cell, :2]
            region = whole[top - first[0] : bottom - first[0], left - first[1] : right - first[1]]
            shifts[index] = top + shift[0], left + shift[1], right - left
            usable = window_of(self.places, shifts[index, :2], own.shape)
            near = cv2.dilate((own | region).astype(np.uint8), element) > 0
            state[view] = np.where(region, FILLED, np.where(near & usable, FREE, KEPT))
            possible[index] = not (region & ~usable).any()
        taken = np.zeros(state.shape, bool)
        saved = np.zeros((len(tried), 2), np.int64)
        given = self.costs.given, self.inside, old, rows, shifts, state
        run_all(cut_cells, [(*given, *span, taken, saved) for span in spans(len(tried), 4)])
        best: dict[int, tuple[float, int]] = {}
        for index, (cell, _, _, factor) in enumerate(tried):
            gain = float(saved[index, 0] - saved[index, 1])
            if not possible[index] or gain <= 0 or gain / factor <= best.get(cell, (0.0, 0))[0]:
                continue
            chosen = taken[rows[index] : rows[index + 1], : sides[index, 1]]
            gain -= self.stub_cost * self._more_stubs(source, outer[cell], boxes[index], chosen, shifts[index, :2])
            if gain > 0 and gain / factor > best.get(cell, (0.0, 0))[0]:
                best[cell] = gain / factor, index
        for _, index in best.values():
            top, left, bottom, right = boxes[index]
            chosen = taken[rows[index] : rows[index + 1], : right - left]
            new = np.indices(chosen.shape) + shifts[index, :2, None, None]
            source[:, top:bottom, left:right] = np.where(chosen, new, source[:, top:bottom, left:right])
        return set(best)

    def _more_stubs(
        self,
        source: Int64[np.ndarray, "2 p q"],
        around: Int64[np.ndarray, "4"],
        box: Int64[np.ndarray, "4"],
        taken: Bool[np.ndarray, "a b"],
        corner: Int64[np.ndarray, "2"],
    ) -> int:
        """How many stubs of cells a cut in ``box`` leaves, less those it removes."""
        import cv2

        top, left, bottom, right = around
        before = self.cells.core[source[0, top:bottom, left:right], source[1, top:bottom, left:right]]
        after = before.copy()
        cut = after[box[0] - top : box[2] - top, box[1] - left : box[3] - left]
        np.copyto(cut, window_of(self.cells.core, corner, cut.shape), where=taken)
        counts = []
        for inside in (before, after):
            boxes = cv2.connectedComponentsWithStats(inside.view(np.uint8), connectivity=4)[2][1:]
            within = (boxes[:, :2] > 0).all(axis=1)
            within &= (boxes[:, :2] + boxes[:, 2:4] < inside.shape[::-1]).all(axis=1)
            counts.append(int((within & (boxes[:, 4] < self.stub)).sum()))
        return counts[1] - counts[0]

    def _candidates(
        self, source: Int64[np.ndarray, "2 p q"], shown: Shown, cells: list[int], outer: Int64[np.ndarray, "n 4"]
    ) -> list[list[tuple[bool, np.ndarray, np.ndarray, float]]]:
        """For each cell, whether it is tried first, displacements, what is laid at least, and a divisor of the
        saving: the best cells of the exemplar, and those of which it shows parts."""
        from texloom.stages.kernels.cells.cell_costs import fit_cells
        from texloom.stages.kernels.core.threads import run_all, spans

        points, weights, shifts, labels, factors, own, removed = [], [], [], [], [], [], []
        for cell in cells:
            top, left, bottom, right = outer[cell]
            view = np.s_[top:bottom, left:right]
            inside = shown.number[view] == cell
            shift = source[:, *view] - np.indices(inside.shape) - np.array([top, left])[:, None, None]
            parts, common = self._parts(inside, shift, self.cells.label[source[0][view], source[1][view]])
            own.append((inside, parts))
            at, weight = _template(inside, inside & common)
            points.append(at + np.array([top, left]))
            weights.append(weight)
            owner = self.inside[tuple(source[:, *view][:, inside][:, 0])]
            removed.append(self._removed(inside, source[:, *view], shift))
            moved, label = self._alignments(shown.boxes[cell], self.whole[self.owner[self.whole] == owner])
            shifts.append(moved)
            labels.append(label)
            around = self.cells.label[source[0][view], source[1][view]][(shown.number[view] > 0) & ~inside]
            near = np.bincount(around, minlength=len(shown.used)) > _NEAR * self.cells.area
            factors.append((shown.used * np.where(near, _SAME, 1.0))[label])
        ends, tried = (np.cumsum([0, *(len(one) for one in parts)]) for parts in (points, shifts))
        every, at = np.concatenate(shifts), np.concatenate(points)
        costs, best = np.full(len(every), np.inf), np.zeros(len(every), np.int64)
        given = (
            self.lab,
            self.places,
            at,
            np.concatenate(weights),
            self.lab[source[0][tuple(at.T)], source[1][tuple(at.T)]],
        )
        tests = ends, every, np.concatenate(factors), tried, _JITTER
        run_all(fit_cells, [(*given, *tests, *span, costs, best) for span in spans(len(cells), 8)])
        found = []
        for index, (cell, (inside, parts)) in enumerate(zip(cells, own, strict=True)):
            span = np.s_[tried[index] : tried[index + 1]]
            chosen: list[tuple[bool, np.ndarray, np.ndarray, float]] = []
            taken: set[int] = set()
            for place in np.argsort(costs[span], kind="stable").tolist():
                if len(chosen) == _CHOSEN or not np.isfinite(costs[span][place]):
                    break
                if labels[index][place] not in taken:
                    taken.add(int(labels[index][place]))
                    moved = every[span][place] + _JITTER[best[span][place]]
                    chosen.append((not chosen, moved, inside, float(factors[index][place])))
            count = len(chosen)
            for label, moved in parts:
                box = self.cells.boxes[label] - np.tile(moved, 2)
                limit = outer[cell] + np.array([1, 1, -1, -1]) * (_BAND + 1)
                if (box[:2] >= limit[:2]).all() and (box[2:] <= limit[2:]).all():
                    first = outer[cell][:2] + moved
                    here = window_of(self.cells.core, first, inside.shape)
                    here &= window_of(self.cells.label, first, inside.shape) == label
                    chosen.append((len(chosen) == count, moved, here, 1.0))
            if (other := removed[index]) is not None:
                chosen.append((len(chosen) == count, *other, 1.0))
            found.append(chosen)
        return found

    def _removed(
        self,
        inside: Bool[np.ndarray, "a b"],  # noqa: ARG002
        source: Int64[np.ndarray, "2 a b"],  # noqa: ARG002
        shift: Int64[np.ndarray, "2 a b"],  # noqa: ARG002
    ) -> tuple[np.ndarray, np.ndarray] | None:
        """A displacement and the pixels to which it is laid so that a cell is shown no more; none."""
        return None

    def _parts(
        self, inside: np.ndarray, shift: np.ndarray, label: np.ndarray
    ) -> tuple[list[tuple[int, np.ndarray]], Bool[np.ndarray, "a b"]]:
        """Label and displacement of the whole cells that are shown most, and where the most frequent one is."""
        width = 4 * max(*self.lab.shape[:2], *inside.shape, int(np.abs(shift).max()))
        code = (label[inside] * width + shift[0][inside] + width // 2) * width + shift[1][inside] + width // 2
        _, first, inverse, counts = np.unique(code, return_index=True, return_inverse=True, return_counts=True)
        order = np.argsort(-counts, kind="stable")[:_CHOSEN].tolist()
        common = np.zeros(inside.shape, bool)
        common[inside] = inverse == order[0]
        labels, moves = label[inside][first[order]], shift[:, inside][:, first[order]].T
        kept = [
            (int(own), move)
            for own, move, count in zip(labels, moves, counts[order], strict=True)
            if self.cells.whole[own] and count >= _LEAST_KNOWN * self.cells.area[own]
        ]
        return kept, common

    def _alignments(
        self, box: Int64[np.ndarray, "4"], whole: np.ndarray
    ) -> tuple[Int64[np.ndarray, "m 2"], Int64[np.ndarray, "m"]]:  # type: ignore[name-defined]
        """Displacements that align a box with those of cells of the exemplar of like size, and their labels."""
        boxes = self.cells.boxes[whole]
        sides = boxes[:, 2:] - boxes[:, :2]
        unlike = np.abs(sides - (box[2:] - box[:2])).sum(axis=1)
        near = np.argsort(unlike, kind="stable")[:_TRIED]
        moves, labels = [], []
        for down in range(3):
            for across in range(3):
                ends = [boxes[near, axis::2] - box[axis::2] for axis in (0, 1)]
                steps = [
                    (end[:, 0], end.sum(axis=1) // 2, end[:, 1])[where]
                    for end, where in zip(ends, (down, across), strict=True)
                ]
                moves.append(np.stack(steps, axis=1))
                labels.append(whole[near])
        every = np.unique(np.concatenate([np.concatenate(moves), np.concatenate(labels)[:, None]], axis=1), axis=0)
        return np.ascontiguousarray(every[:, :2]), every[:, 2]


def wider(mask: Bool[np.ndarray, "p q"], by: int) -> Bool[np.ndarray, "p q"]:
    """A mask with the pixels up to ``by`` px around it."""
    import cv2

    if by == 0:
        return mask
    element = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (2 * by + 1,) * 2)
    return np.asarray(cv2.dilate(mask.view(np.uint8), element) > 0)


def _connected(core: np.ndarray) -> tuple[Int64[np.ndarray, "p q"], int]:
    """Numbers of connected pixels of equal value above 0, from 1; and how many numbers there are, with 0."""
    import cv2

    number, count = np.zeros(core.shape, np.int64), 1
    for value in np.unique(core[core > 0]).tolist():
        found, labels = cv2.connectedComponents((core == value).astype(np.uint8), connectivity=4)
        number[labels > 0] = labels[labels > 0] + (count - 1)
        count += found - 1
    return number, count


def _pad(sides: Any) -> Any:
    """How far around a cell of these sides the pixels lie that its completion looks at or changes, px."""
    return _BAND + 3 + np.ceil(_REACH * np.asarray(sides)).astype(np.int64)


def _box_around(
    cell: Int64[np.ndarray, "4"], region: Bool[np.ndarray, "a b"], outer: Int64[np.ndarray, "4"]
) -> Int64[np.ndarray, "4"]:
    """The part of ``outer`` in which a cut of a cell and a region of ``outer`` may lie, with a pixel around."""
    rows, columns = np.flatnonzero(region.any(axis=1)), np.flatnonzero(region.any(axis=0))
    laid = np.array([rows[0], columns[0], rows[-1] + 1, columns[-1] + 1]) + np.tile(outer[:2], 2)
    first = np.minimum(cell[:2], laid[:2]) - (_BAND + 1)
    last = np.maximum(cell[2:], laid[2:]) + (_BAND + 1)
    return np.concatenate([np.maximum(first, outer[:2]), np.minimum(last, outer[2:])])


def _template(
    inside: Bool[np.ndarray, "a b"], common: Bool[np.ndarray, "a b"]
) -> tuple[Int64[np.ndarray, "n 2"], Float32[np.ndarray, "n"]]:  # type: ignore[name-defined]
    """The pixels around a cell and those of its most frequent source, evenly chosen, and their weights."""
    import cv2

    near = cv2.dilate(inside.astype(np.uint8), np.ones((2 * _BAND + 1,) * 2, np.uint8)) > 0
    weight = np.where(near & ~inside, 1.0, np.where(common, _MAJORITY, 0.0)).astype(np.float32)
    chosen = np.flatnonzero(weight)
    chosen = chosen[:: max(1, len(chosen) // _POINTS)]
    return np.stack(np.divmod(chosen, inside.shape[1]), axis=1), weight.ravel()[chosen]


def window_of(plane: np.ndarray, corner: Int64[np.ndarray, "2"], shape: tuple[int, int]) -> np.ndarray:
    """The part of a plane from ``corner`` on, which may lie beyond it, where it is 0."""
    result = np.zeros(shape, plane.dtype)
    first, last = np.maximum(0, -corner), np.minimum(shape, plane.shape - corner)
    if (first < last).all():
        part = plane[tuple(slice(*ends) for ends in zip(first + corner, last + corner, strict=True))]
        result[first[0] : last[0], first[1] : last[1]] = part
    return result
