"""Whole objects apart on a ground in place of those that a result shows fused, cut or mixed."""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from jaxtyping import Bool, Float32, Float64, Int8, Int16, Int32, Int64

from texloom.stages.analysis.structure.contour_cells import ContourCells, boxes_of
from texloom.stages.synthesis.optimisation.allowed import Allowed
from texloom.stages.synthesis.optimisation.cell_completion import CellCompletion, Shown, wider, window_of
from texloom.stages.synthesis.optimisation.cells import most_frequent
from texloom.stages.synthesis.stitching.seams import UNIT, SeamCosts

_CONTOUR = 4  # px around the inside of an object that belong to it
_APART = 2  # the same, of others that are left
_BAND = 8  # px around what has to change in which cuts may lie
_TOGETHER = 2  # px around faulty objects that are completed together where they overlap
_FAULTY = 0.1  # share of an object's area that is wrong, from which on it is faulty
_UNLIKE = 10  # CIELAB units, mean of 3 x 3 px, of a pixel that shows another thing
_STEPS = 8  # of a CIELAB unit, in whole numbers
_OUTLINE = 0.08  # the same, by which its outline differs
_SPLINTER = 0.16  # of an object's area, that a splinter counts for at least
_LEAST_SPLINTER = 5  # px of a splinter
_TRIED = 12  # objects of the exemplar for a faulty one
_ALIKE = 12  # of those that an object's shape is compared with
_GROUNDS = 16  # places of the ground for a faulty object
_CUT = 2  # of each kind that fit best, that are cut out
_PARTS = 3  # of a faulty object that are completed at their place
_LEAST_PART = 0.1  # of an object's area, that is shown, for it to be completed at its place
_POINTS = 80  # around what changes that are compared
_WRONG_COST = 30.0  # of an object that is wrong, in just visible seams as long as its side
_AREA_COST = 5.0  # the same, of one that is added or removed
_VISIBLE_GROUND = 8.0  # CIELAB units, mean, by which ground in place of an object may differ from that around it
_VISIBLE = 4.0  # CIELAB units, of a just visible seam in the ground
_UNKNOWN = -(2**14)  # tone of a pixel that is not compared


@dataclass(frozen=True)
class _Try:
    """A displacement of sources over a faulty object."""

    shift: Int64[np.ndarray, "2"]
    """from a pixel of the surroundings to its source"""
    state: Int8[np.ndarray, "a b"]
    """what it has to and may change"""
    own: Bool[np.ndarray, "a b"]
    """inside of the faulty object"""
    area: int
    """px of the object that it shows, 0 for ground"""


@dataclass(frozen=True)
class _Form:
    """An object of the exemplar."""

    mask: Bool[np.ndarray, "a b"]
    """its inside"""
    corner: Int64[np.ndarray, "2"]
    """of the mask, in the exemplar"""
    ring: Int64[np.ndarray, "n 2"]
    """pixels around it, in the exemplar"""


class ObjectCompletion(CellCompletion):
    """Searches whole objects, and ground, in an exemplar and lays them over faulty objects of a result.

    Objects are cells whose contours lie in a ground. So cuts follow the ground alone, and an object for which none
    fits can be removed. Parameters are those of `CellCompletion`, of one exemplar.
    """

    rounds: ClassVar = 6
    reach: ClassVar = 8

    def __init__(
        self, lab: Float32[np.ndarray, "h w 3"], cells: ContourCells, patch_size: int, allowed: Allowed | None
    ):
        super().__init__(lab, cells, patch_size, allowed)
        self.tone = np.rint(self.lab * _STEPS).astype(np.int16)
        wide = np.pad(self.tone, ((1, 1), (1, 1), (0, 0)), mode="edge")
        height, width = self.tone.shape[:2]
        self.smooth = np.zeros(self.tone.shape, np.int16)
        """nine times the mean of 3 x 3 px"""
        for y in range(3):
            for x in range(3):
                self.smooth += wide[y : y + height, x : x + width]
        self.typical = float(np.median(cells.area[self.whole]))
        self.largest = int((cells.boxes[self.whole, 2:] - cells.boxes[self.whole, :2]).max())
        self.ground = self.places & ~wider(cells.core, _CONTOUR)
        """places that show no object"""
        self.line = ~wider(cells.core, _CONTOUR - 1)
        """ground, and contours on its side"""
        self.around = ~cells.core & ~cells.large[cells.label]
        """contours of objects, on their side"""
        self.nearest = _nearest(cells.core)
        """row and column of the inside that lies nearest to each pixel"""
        self.forms: dict[int, _Form] = {}
        self.side_cost = UNIT * float(np.sqrt(self.typical))
        """of a just visible seam as long as an object's side"""

    def _costs(self) -> SeamCosts:
        return SeamCosts(self.lab / np.float32(_VISIBLE), gradients=False, squared=True)

    def _shown(self, source: Int64[np.ndarray, "2 p q"]) -> Shown:
        import cv2

        core = self.cells.core[source[0], source[1]]
        number, wrong = self._judged(core, source)
        splinters, more = self._splinters(core, source)
        number = np.where(splinters > 0, splinters + (len(wrong) - 1), number)
        wrong = np.concatenate([wrong, more[1:]])
        faulty = wrong > _FAULTY
        together = wider(faulty[number], _TOGETHER).view(np.uint8)
        count, joined = cv2.connectedComponents(together, connectivity=4)
        kept = int((~faulty).sum())
        single = np.cumsum(~faulty) - 1
        group = np.zeros(len(wrong), np.int64)
        group[number] = np.where(faulty[number], joined + (kept - 1), single[number])
        number, total = group[number], kept + count - 1
        severity = np.bincount(group[faulty], wrong[faulty], total) * _WRONG_COST * self.side_cost
        boxes = boxes_of(number, number > 0, total)
        more = np.maximum(0, self.largest - (boxes[:, 2:] - boxes[:, :2]))
        extents = np.concatenate([boxes[:, :2] - more, boxes[:, 2:] + more], axis=1)
        use = np.bincount(self.cells.label[source[0], source[1]].ravel(), minlength=len(self.cells.area))
        used = np.maximum(1.0, use / np.maximum(1.0, self.fair * number.size))
        return Shown(number, boxes, severity, used, extents)

    def _splinters(
        self, core: Bool[np.ndarray, "a b"], source: Int64[np.ndarray, "2 a b"]
    ) -> tuple[Int64[np.ndarray, "a b"], Float64[np.ndarray, "n"]]:  # type: ignore[name-defined]
        """Numbers of pieces of contours of which no inside is shown, from 1, and what is wrong by each."""
        import cv2

        contour = self.around[source[0], source[1]] & ~wider(core, _CONTOUR)
        rows, columns = np.nonzero(contour)
        near = self.nearest[:, source[0][contour], source[1][contour]]
        y, x = near[0] - source[0][contour] + rows, near[1] - source[1][contour] + columns
        there = (y >= 0) & (x >= 0) & (y < core.shape[0]) & (x < core.shape[1])
        at = source[:, np.where(there, y, 0), np.where(there, x, 0)]
        alone = there & (at != near).any(axis=0)
        contour[rows[~alone], columns[~alone]] = False
        _, number, stats, _ = cv2.connectedComponentsWithStats(contour.astype(np.uint8), connectivity=8)
        wrong = stats[:, cv2.CC_STAT_AREA] / self.typical + _SPLINTER
        wrong[stats[:, cv2.CC_STAT_AREA] < _LEAST_SPLINTER] = 0
        wrong[0] = 0
        keep = wrong > 0
        renumbered = np.cumsum(keep) * keep
        return renumbered[number].astype(np.int64), np.concatenate([[0.0], wrong[keep]])

    def _judged(
        self, core: Bool[np.ndarray, "a b"], source: Int64[np.ndarray, "2 a b"]
    ) -> tuple[Int64[np.ndarray, "a b"], Float64[np.ndarray, "n"]]:  # type: ignore[name-defined]
        """Numbers of the objects that are shown, from 1, and the share of each that is wrong.

        That is what it lacks of the exemplar's object that it shows most of, is more than that, or has another
        colour; or what its outline differs from that of the exemplar's object of like size, where none is mixed.
        What a border cuts lacks nothing there.
        """
        import cv2

        count, labels = cv2.connectedComponents(core.astype(np.uint8), connectivity=4)
        number = labels.astype(np.int64)
        wrong = np.zeros(count)
        rows, columns = np.nonzero(core)
        if not len(rows):
            return number, wrong
        own = number[rows, columns]
        at = source[:, rows, columns]
        label = self.cells.label[at[0], at[1]]
        height, width = self.lab.shape[:2]
        span = 4 * max(height, width, *core.shape)
        code = (label * span + at[0] - rows + span // 2) * span + at[1] - columns + span // 2
        best, _ = most_frequent(own, code, count)
        rest, across = np.divmod(best, span)
        main, down = np.divmod(rest, span)
        down, across = down - span // 2, across - span // 2
        y, x = rows + down[own], columns + across[own]
        there = (y >= 0) & (x >= 0) & (y < height) & (x < width)
        y, x = np.where(there, y, 0), np.where(there, x, 0)
        there &= self.cells.core[y, x] & (self.cells.label[y, x] == main[own])
        differs = np.abs(self.smooth[at[0], at[1]] - self.smooth[y, x]).max(axis=1) > 9 * _UNLIKE * _STEPS
        unlike = np.bincount(own[there & differs], minlength=count)
        hit = np.bincount(own[there], minlength=count)
        size = np.bincount(own, minlength=count)
        area = self.cells.area[main].copy()
        boxes = boxes_of(number, core, count)
        limits = np.tile(core.shape, 2)
        moved = self.cells.boxes[main] - np.tile(np.stack([down, across], axis=1), 2)
        for index in np.flatnonzero((moved[:, :2] < 0).any(axis=1) | (moved > limits).any(axis=1)).tolist():
            corner = np.array([down[index], across[index]])
            first, last = np.maximum(moved[index, :2], 0), np.minimum(moved[index, 2:], core.shape)
            shape = tuple(np.maximum(last - first, 0).tolist())
            area[index] = self._inside(int(main[index]), first + corner, shape).sum()
        full = np.maximum(1, self.cells.area[main])
        wrong = (size + area - 2 * hit + unlike) / full
        cut = (boxes[:, :2] <= 0).any(axis=1) | (boxes[:, 2:] >= limits[2:]).any(axis=1)
        wrong[~self.cells.whole[main] & cut] = 0
        outline = ((wrong > _FAULTY) | ~self.cells.whole[main]) & ~cut & (unlike < _FAULTY * full)
        outline[0] = False
        for index in np.flatnonzero(outline).tolist():
            top, left, bottom, right = boxes[index]
            inside = number[top:bottom, left:right] == index
            differs = self._outline_differs(inside) * (_FAULTY / _OUTLINE)
            wrong[index] = min(wrong[index], differs) if self.cells.whole[main[index]] else differs
        for index in np.flatnonzero((wrong <= _FAULTY) & (hit > size // 2) & self.cells.whole[main]).tolist():
            shift = np.array([down[index], across[index]])
            wrong[index] = max(wrong[index], self._unlike(int(main[index]), shift, source))
        wrong[0] = 0
        return number, wrong

    def _unlike(self, label: int, shift: Int64[np.ndarray, "2"], source: Int64[np.ndarray, "2 a b"]) -> float:
        """The share of an object with its contour that looks otherwise where it should be seen."""
        form = self._form(label)
        first = np.maximum(np.maximum(form.corner - _CONTOUR, 0), shift)
        last = np.minimum(form.corner + form.mask.shape + _CONTOUR, self.cells.label.shape)
        last = np.minimum(last, shift + source.shape[1:])
        view = tuple(slice(*ends) for ends in zip(first, last, strict=True))
        body = (self.cells.label[view] == label) & ~self.line[view]
        shown = source[:, *(slice(*ends) for ends in zip(first - shift, last - shift, strict=True))][:, body]
        differs = np.abs(self.smooth[shown[0], shown[1]] - self.smooth[view][body]).max(axis=1, initial=0)
        return float((differs > 9 * _UNLIKE * _STEPS).sum()) / max(1, len(differs))

    def _inside(self, label: int, corner: np.ndarray, shape: tuple[int, ...]) -> Bool[np.ndarray, "a b"]:
        """Where a window of the exemplar shows the inside of an object."""
        core = window_of(self.cells.core, corner, (shape[0], shape[1]))
        return np.asarray(core & (window_of(self.cells.label, corner, (shape[0], shape[1])) == label))

    def _outline_differs(self, inside: Bool[np.ndarray, "a b"]) -> float:
        """Least difference of a shape from the exemplar's objects of like size, middles aligned, of their area."""
        sides = self.cells.boxes[self.whole, 2:] - self.cells.boxes[self.whole, :2]
        unlike = np.abs(sides - np.array(inside.shape)).sum(axis=1)
        size, least = int(inside.sum()), np.inf
        for index in np.argsort(unlike, kind="stable")[:_ALIKE].tolist():
            label = int(self.whole[index])
            corner = self.cells.boxes[label, :2] + (sides[index] - np.array(inside.shape)) // 2
            both = int((inside & self._inside(label, corner, inside.shape)).sum())
            area = int(self.cells.area[label])
            least = min(least, (size + area - 2 * both) / area)
        return float(least)

    def _laid(
        self, source: Int64[np.ndarray, "2 p q"], shown: Shown, cells: list[int], outer: Int64[np.ndarray, "n 4"]
    ) -> int:
        """Complete or remove objects whose surroundings do not overlap; how many."""
        from texloom.stages.kernels.cells.cell_cuts import cut_cells
        from texloom.stages.kernels.core.threads import run_all, spans
        from texloom.stages.kernels.seams.window_state import KEPT

        tried = [(cell, one) for cell in cells for one in self._tries(source, shown, cell, outer[cell])]
        if not tried:
            return 0
        boxes = np.array([_changing(one.state != KEPT) for _, one in tried])
        sides = boxes[:, 2:] - boxes[:, :2]
        rows, width = np.cumsum([0, *sides[:, 0]]), int(sides[:, 1].max())
        old, state = np.zeros((rows[-1], width, 2), np.int32), np.full((rows[-1], width), KEPT, np.int8)
        shifts = np.zeros((len(tried), 3), np.int64)
        for index, (cell, one) in enumerate(tried):
            view = np.s_[rows[index] : rows[index + 1], : sides[index, 1]]
            top, left, bottom, right = boxes[index]
            first, across = outer[cell, :2]
            old[view] = np.moveaxis(source[:, first + top : first + bottom, across + left : across + right], 0, 2)
            state[view] = one.state[top:bottom, left:right]
            shifts[index] = *(one.shift + boxes[index, :2]), sides[index, 1]
        taken = np.zeros(state.shape, bool)
        saved = np.zeros((len(tried), 2), np.int64)
        given = self.costs.given, self.inside, old, rows, shifts, state
        run_all(cut_cells, [(*given, *span, taken, saved) for span in spans(len(tried), 4)])
        best: dict[int, tuple[float, np.ndarray]] = {}
        for index, (cell, one) in enumerate(tried):
            top, left, bottom, right = boxes[index]
            chosen = np.zeros(one.own.shape, bool)
            chosen[top:bottom, left:right] = taken[rows[index] : rows[index + 1], : sides[index, 1]]
            top, left, bottom, right = outer[cell]
            before = source[:, top:bottom, left:right]
            remains = one.own & ~chosen
            wrong = self._judged(remains, before)[1].sum() if remains.any() else 0.0
            gain = float(shown.severity[cell] - wrong * _WRONG_COST * self.side_cost)
            more = abs(int(remains.sum()) + one.area - int(one.own.sum())) / self.typical
            gain += float(saved[index, 0] - saved[index, 1]) - more * _AREA_COST * self.side_cost
            if gain > best.get(cell, (0.0, None))[0]:
                after = np.where(chosen, np.indices(chosen.shape) + one.shift[:, None, None], before)
                best[cell] = gain, after
        for cell, (_, after) in best.items():
            top, left, bottom, right = outer[cell]
            source[:, top:bottom, left:right] = after
        return len(best)

    def _tries(
        self, source: Int64[np.ndarray, "2 p q"], shown: Shown, cell: int, outer: Int64[np.ndarray, "4"]
    ) -> list[_Try]:
        """Those of objects instead of all that is faulty, of objects over a part of it, and of ground."""
        top, left, bottom, right = outer.tolist()
        number = shown.number[top:bottom, left:right]
        own, others = number == cell, (number > 0) & (number != cell)
        wide, others = wider(others, _APART + _CONTOUR), wider(others, _APART)
        around = wider(own, _CONTOUR) & ~others
        inner = _inner(outer, source.shape[1:])
        here = source[:, top:bottom, left:right]
        hidden = wider(own, _CONTOUR) | others
        tones = np.where(hidden[..., None], np.int16(_UNKNOWN), self.tone[here[0], here[1]])
        fitting: list[tuple[float, int, int, np.ndarray]] = []
        for label, shift in self._objects(own, here, shown.boxes[cell] - np.tile(outer[:2], 2)):
            form = self._form(label)
            if _free(form.mask, form.corner - shift, wide, inner):
                fit = self._fit(form.ring, shift, tones) * float(shown.used[label])
                fitting.append((fit, len(fitting), label, shift))
        found: list[list[_Try]] = [[], [], []]
        for _, _, label, shift in sorted(fitting, key=lambda one: one[:2]):
            if len(found[0]) == _CUT:
                break
            new = self._inside(label, shift, own.shape)
            rest = wider(window_of(self.cells.core, shift, own.shape) & ~new, _CONTOUR)
            new = wider(new, 1) | (wider(new, _CONTOUR) & ~rest)
            partly = bool((rest & around & ~new).any())
            if len(found[partly]) < _CUT:
                filled = new if partly else new | around
                if (state := self._state(filled, rest | others, shift, inner)) is not None:
                    found[partly].append(_Try(shift, state, own, int(self.cells.area[label])))
        edge = np.argwhere(wider(around, 4) & ~around)
        edge = edge[:: max(1, len(edge) // _POINTS)]
        grounds = self._grounds(around)
        limit = np.array(self.tone.shape[:2]) - 1
        fits = [self._fit(np.clip(edge + shift, 0, limit), shift, tones) for shift in grounds]
        for index in np.argsort(fits, kind="stable").tolist():
            if len(found[2]) == _CUT or fits[index] > (_VISIBLE_GROUND * _STEPS) ** 2:
                break
            rest = wider(window_of(self.cells.core, grounds[index], own.shape), _CONTOUR)
            if (state := self._state(around, rest | others, grounds[index], inner)) is not None:
                found[2].append(_Try(grounds[index], state, own, 0))
        return [one for kind in found for one in kind]

    def _state(
        self,
        filled: Bool[np.ndarray, "a b"],
        closed: Bool[np.ndarray, "a b"],
        shift: Int64[np.ndarray, "2"],
        inner: Bool[np.ndarray, "a b"],
    ) -> Int8[np.ndarray, "a b"] | None:
        """What a displacement does to each pixel: it has to change ``filled``, and may what is near and not
        ``closed``; none where it may not be used."""
        from texloom.stages.kernels.seams.window_state import FILLED, FREE, KEPT

        usable = inner & window_of(self.places, shift, filled.shape)
        if (filled & ~usable).any():
            return None
        free = wider(filled, _BAND) & usable & ~closed
        return np.where(filled, FILLED, np.where(free, FREE, KEPT)).astype(np.int8)

    def _fit(
        self, at: Int64[np.ndarray, "n 2"], shift: Int64[np.ndarray, "2"], tones: Int16[np.ndarray, "a b 3"]
    ) -> float:
        """Mean squared difference between the exemplar's pixels ``at`` and what is shown where they come to lie."""
        y, x = at[:, 0] - shift[0], at[:, 1] - shift[1]
        ok = (y >= 0) & (x >= 0) & (y < tones.shape[0]) & (x < tones.shape[1])
        shown = tones[y[ok], x[ok]]
        known = shown[:, 0] != _UNKNOWN
        differs = self.tone[at[ok, 0], at[ok, 1]][known] - shown[known].astype(np.int64)
        return float((differs**2).sum()) / max(1, len(differs))

    def _form(self, label: int) -> _Form:
        """That of a whole object of the exemplar."""
        if label not in self.forms:
            box, by = self.cells.boxes[label], _CONTOUR + 4
            mask = self._inside(label, box[:2] - by, tuple((box[2:] - box[:2] + 2 * by).tolist()))
            ring = np.argwhere(wider(mask, by) & ~wider(mask, _CONTOUR)) + box[:2] - by
            ring = ring[(ring >= 0).all(axis=1) & (ring < self.tone.shape[:2]).all(axis=1)]
            mask = mask[by:-by, by:-by]
            self.forms[label] = _Form(mask, box[:2], ring[:: max(1, len(ring) // _POINTS)])
        return self.forms[label]

    def _objects(
        self, own: Bool[np.ndarray, "a b"], here: Int64[np.ndarray, "2 a b"], box: Int64[np.ndarray, "4"]
    ) -> list[tuple[int, Int64[np.ndarray, "2"]]]:
        """Whole objects and displacements: those shown at their place, and those of like size, boxes aligned."""
        rows, columns = np.nonzero(own)
        at = here[:, rows, columns]
        label = self.cells.label[at[0], at[1]]
        every = np.stack([label, at[0] - rows, at[1] - columns], axis=1)
        parts, counts = np.unique(every, axis=0, return_counts=True)
        found = [
            (int(parts[index, 0]), parts[index, 1:])
            for index in np.argsort(-counts, kind="stable")[:_PARTS].tolist()
            if self.cells.whole[parts[index, 0]] and counts[index] >= _LEAST_PART * self.cells.area[parts[index, 0]]
        ]
        sides = self.cells.boxes[self.whole, 2:] - self.cells.boxes[self.whole, :2]
        unlike = np.abs(sides - (box[2:] - box[:2])).sum(axis=1)
        shifts, labels = self._alignments(box, self.whole[np.argsort(unlike, kind="stable")[:_TRIED]])
        return found + [(int(one), shift) for shift, one in zip(shifts, labels, strict=True)]

    def _grounds(self, around: Bool[np.ndarray, "a b"]) -> Int64[np.ndarray, "k 2"]:
        """Displacements at which the exemplar shows ground alone where ``around`` is true."""
        import cv2

        rows, columns = np.flatnonzero(around.any(axis=1)), np.flatnonzero(around.any(axis=0))
        first = np.array([rows[0], columns[0]])
        shape = around[rows[0] : rows[-1] + 1, columns[0] : columns[-1] + 1].astype(np.uint8)
        if (np.array(shape.shape) > self.ground.shape).any():
            return np.zeros((0, 2), np.int64)
        free = cv2.erode(
            self.ground.view(np.uint8), shape, anchor=(0, 0), borderType=cv2.BORDER_CONSTANT, borderValue=0
        )
        places = np.argwhere(free)
        return np.asarray(places[:: max(1, len(places) // _GROUNDS)] - first, np.int64)


def _nearest(core: Bool[np.ndarray, "h w"]) -> Int32[np.ndarray, "2 h w"]:
    """Row and column of the true pixel nearest to each."""
    import cv2

    _, number = cv2.distanceTransformWithLabels(
        (~core).astype(np.uint8), cv2.DIST_L1, 3, labelType=cv2.DIST_LABEL_PIXEL
    )
    places = np.zeros((int(number.max()) + 1, 2), np.int32)
    places[number[core]] = np.argwhere(core)
    return np.moveaxis(places[number], 2, 0)


def _inner(outer: Int64[np.ndarray, "4"], shape: tuple[int, ...]) -> Bool[np.ndarray, "a b"]:
    """Pixels of a box in a result that have all their neighbours in the box, but beyond the result's border."""
    top, left, bottom, right = outer.tolist()
    inner = np.ones((bottom - top, right - left), bool)
    inner[0] &= top == 0
    inner[-1] &= bottom == shape[0]
    inner[:, 0] &= left == 0
    inner[:, -1] &= right == shape[1]
    return inner


def _free(
    mask: Bool[np.ndarray, "a b"],
    corner: Int64[np.ndarray, "2"],
    closed: Bool[np.ndarray, "p q"],
    inner: Bool[np.ndarray, "p q"],
) -> bool:
    """Whether nothing is closed where a mask comes to lie, which may extend beyond the inner pixels of a border."""
    first, last = np.maximum(corner, 0), np.minimum(corner + mask.shape, closed.shape)
    if (first >= last).any():
        return False
    part = mask[tuple(slice(*ends) for ends in zip(first - corner, last - corner, strict=True))]
    view = tuple(slice(*ends) for ends in zip(first, last, strict=True))
    if (part & (closed[view] | ~inner[view])).any():
        return False
    beyond = [(corner[0] < 0, inner[0]), (corner[0] + mask.shape[0] > inner.shape[0], inner[-1])]
    beyond += [(corner[1] < 0, inner[:, 0]), (corner[1] + mask.shape[1] > inner.shape[1], inner[:, -1])]
    return all(side.any() for is_beyond, side in beyond if is_beyond)


def _changing(mask: Bool[np.ndarray, "a b"]) -> list[int]:
    """Box of a mask, with a pixel around where there is one."""
    rows, columns = np.flatnonzero(mask.any(axis=1)), np.flatnonzero(mask.any(axis=0))
    first = [max(0, int(line[0]) - 1) for line in (rows, columns)]
    last = [min(side, int(line[-1]) + 2) for side, line in zip(mask.shape, (rows, columns), strict=True)]
    return first + last
