"""Whole cells from anywhere in the exemplar, for cells of a lattice that show parts of several."""

import math

import numpy as np
from jaxtyping import Bool, Float32, Float64, Int64

from texloom.stages.numerics.matrices import determinant, inverse_of
from texloom.stages.synthesis.optimisation.allowed import Allowed
from texloom.stages.synthesis.optimisation.cell_segments import Segments
from texloom.stages.synthesis.optimisation.correspondence import Patches
from texloom.stages.synthesis.stitching.seams import ABSENT, FILLED, FREE, KEPT, SeamCosts, cheapest_cut, pairs
from texloom.stages.vocabulary.arrays import Vectors

_BAND = 0.1  # of a cell's width, on either side of its outline: where it may be cut out
_BANDS = (2, 6)  # px, the least and the most of it
_JITTER = 0.06  # of a cell's width, by which cells of the exemplar may lie off the lattice
_JITTERS = (1, 3)  # px, the least and the most of it
_MAJORITY = 0.5  # weight of the inside of the most frequent source, relative to the pixels at the outline
_POINTS = 250  # of a cell that are compared
_MIN_TONE = 3.0  # difference of mean colours of two parts of a cell that is seen, CIELAB units
_MIN_PART = 0.06  # of a cell's area, that is seen


class WholeCells:
    """Finds whole cells in an exemplar and lays them over mixed ones.

    Parameters
    ----------
    lab : the exemplar, CIELAB.
    costs : of its seams.
    generators : px, two rows.
    segments : the parts of a cell.
    allowed : which of its patches may be used; none for all.
    """

    def __init__(
        self,
        lab: Float32[np.ndarray, "h w 3"],
        costs: SeamCosts,
        generators: Vectors,
        segments: Segments,
        patch_size: int,
        allowed: Allowed | None,
    ):
        self.lab, self.costs, self.segments = lab, costs, segments
        self.middle = patch_size // 2
        basis = generators.astype(np.float64)
        spacing = abs(float(determinant(basis))) / float(np.hypot(*basis.T).max())
        self.band = int(np.clip(round(_BAND * spacing), *_BANDS))
        jitter = int(np.clip(round(_JITTER * spacing), *_JITTERS))
        self.offsets = _offsets(basis, lab.shape[:2], jitter)
        forbidden = np.ones(lab.shape[:2], bool)
        inside = tuple(slice(self.middle, self.middle + side - patch_size + 1) for side in lab.shape[:2])
        forbidden[inside] = False if allowed is None else ~allowed.places
        self.forbidden = np.zeros((lab.shape[0] + 1, lab.shape[1] + 1), np.int64)
        self.forbidden[1:, 1:] = forbidden.cumsum(axis=0).cumsum(axis=1)

    def complete(
        self, match: Patches, position: Float64[np.ndarray, "2 p q"], ends: Bool[np.ndarray, "p q"]
    ) -> None:
        """Complete all mixed cells but those with pixels of ``ends``, in place.

        Each is searched in the whole exemplar by the pixels around its outline and those of its most frequent
        source, and cut out along the cheapest path near its outline.

        Parameters
        ----------
        position : of the middles of patches, in generators.
        """
        cell, part = self.segments(position)
        cell -= cell.min(axis=(1, 2), keepdims=True)
        number = (cell[0] * (cell[1].max() + 1) + cell[1]) * self.segments.count + part
        count = int(number.max()) + 1
        source = match.astype(np.int64) + self.middle
        several = np.zeros(count, bool)
        for axis in (0, 1):
            one, other = pairs(source[0], axis), pairs(source[1], axis)
            apart = (one[1] - one[0] != (axis == 0)) | (other[1] - other[0] != (axis == 1))
            first, second = pairs(number, axis)
            several[first[(first == second) & apart]] = True
        several[number[ends]] = False
        group = np.full(count, -1)
        group[number] = (cell[0] % 2 * 2 + cell[1] % 2) * self.segments.count + part
        boxes, middles = _boxes(number), _middles(number)
        for index in range(4 * self.segments.count):
            source = self._completed(source, number, np.flatnonzero(several & (group == index)), boxes, middles)
        match[:] = source - self.middle

    def _completed(
        self,
        source: Int64[np.ndarray, "2 p q"],
        number: Int64[np.ndarray, "p q"],
        cells: Int64[np.ndarray, "n"],  # type: ignore[name-defined]
        boxes: list[tuple[slice, slice]],
        middles: Int64[np.ndarray, "2 k"],
    ) -> Int64[np.ndarray, "2 p q"]:
        """``source`` with whole cells in place of those of ``cells``, no two of them neighbours, that are mixed."""
        from texloom.stages.kernels.cells.cell_search import search_cells
        from texloom.stages.kernels.core.threads import run_all, spans

        found = [self._template(source, number, int(cell), boxes[cell], middles) for cell in cells]
        templates = [template for template in found if template is not None]
        if not templates:
            return source
        points = np.concatenate([template.points for template in templates])
        weights = np.concatenate([template.weights for template in templates])
        wanted = self.lab[source[0][tuple(points.T)], source[1][tuple(points.T)]]
        ends = np.cumsum([0, *(len(template.points) for template in templates)])
        count = len(templates)
        shifts, costs = np.array([template.base for template in templates]), np.full(count, np.inf)
        around = np.array([template.box for template in templates])
        taken = np.array([template.taken for template in templates])
        for offsets in self.offsets:
            given = self.lab, self.forbidden, points, weights, wanted, ends, around, shifts.copy(), offsets, taken
            run_all(search_cells, [(*given, *span, shifts, costs) for span in spans(count, 16)])
        whole = np.isfinite(costs)
        return self._laid(source, [one for one, has in zip(templates, whole, strict=True) if has], shifts[whole])

    def _template(
        self, source: np.ndarray, number: np.ndarray, cell: int, box: tuple[slice, slice], middles: np.ndarray
    ) -> "_Template | None":
        """What of a cell is searched; none where it shows no two tones."""
        import cv2

        sides = number.shape
        first = [max(0, one.start - self.band - 1) for one in box]
        last = [min(side, one.stop + self.band + 1) for one, side in zip(box, sides, strict=True)]
        view = np.s_[first[0] : last[0], first[1] : last[1]]
        own = number[view] == cell
        here = np.indices(own.shape) + np.array(first)[:, None, None]
        shift = source[:, *view] - here
        code = shift[0] * (4 * self.lab.shape[1]) + shift[1]
        values, counts = np.unique(code[own], return_counts=True)
        common = code == values[counts.argmax()]
        base = shift[:, common & own][:, 0]
        if not self._is_mixed(source[:, *view], own & ~common, base, here, code, int(own.sum())):
            return None
        element = np.ones((2 * self.band + 1,) * 2, np.uint8)
        near = cv2.dilate(own.astype(np.uint8), element) > 0
        core = cv2.erode(own.astype(np.uint8), element, borderType=cv2.BORDER_CONSTANT, borderValue=0) > 0
        thin = np.ones((3, 3), np.uint8)
        edge = (cv2.dilate(own.astype(np.uint8), thin) > 0) & (cv2.erode(own.astype(np.uint8), thin) == 0)
        ring = (near & ~own) | (own & ~core & common) | edge
        weight = np.where(ring, 1.0, np.where(core & common, _MAJORITY, 0.0)).astype(np.float32)
        chosen = np.flatnonzero(weight.ravel())
        step = max(1, len(chosen) // _POINTS)
        stride = _coprime(len(chosen[::step]))
        chosen = chosen[::step][np.arange(len(chosen[::step])) * stride % len(chosen[::step])]
        points = np.stack(np.divmod(chosen, own.shape[1]), axis=1) + first
        taken = _taken(source, middles[:, np.unique(number[view][near & ~own])], middles[:, cell])
        return _Template(points, weight.ravel()[chosen], base, (*first, *last), taken, own, near, core)

    def _is_mixed(
        self,
        source: np.ndarray,
        other: Bool[np.ndarray, "a b"],
        base: np.ndarray,
        here: np.ndarray,
        code: np.ndarray,
        area: int,
    ) -> bool:
        """Whether parts of a cell from ``other`` sources differ in tone from what its most frequent one shows."""
        expected = np.clip(here[:, other] + base[:, None], 0, np.array(self.lab.shape[:2])[:, None] - 1)
        difference = self.lab[tuple(source[:, other])] - self.lab[tuple(expected)]
        _, part = np.unique(code[other], return_inverse=True)
        sizes = np.bincount(part)
        means = np.stack([np.bincount(part, one) for one in difference.T], axis=1) / np.maximum(sizes, 1)[:, None]
        seen = np.abs(means).max(axis=1, initial=0) >= _MIN_TONE
        return bool(sizes[seen].sum() >= _MIN_PART * area)

    def _laid(
        self, source: np.ndarray, templates: "list[_Template]", shifts: Int64[np.ndarray, "n 2"]
    ) -> Int64[np.ndarray, "2 p q"]:
        """``source`` with the found cells, each cut out of its surroundings at least cost, where that pays."""
        heights = [template.own.shape[0] for template in templates]
        tops = np.cumsum([0, *heights[:-1]]) + np.arange(len(templates))  # a row apart
        sides = int(tops[-1]) + heights[-1] + 1, max(template.own.shape[1] for template in templates)
        old, new = np.zeros((*sides, 2), np.int32), np.zeros((*sides, 2), np.int32)
        state = np.full(sides, ABSENT, np.int8)
        number = np.repeat(np.arange(len(templates)), np.array(heights) + 1)
        for template, shift, first in zip(templates, shifts, tops, strict=True):
            top, left, bottom, right = template.box
            view = np.s_[first : first + bottom - top, : right - left]
            old[view] = np.moveaxis(source[:, top:bottom, left:right], 0, 2)
            new[view] = np.moveaxis(np.mgrid[top:bottom, left:right], 0, 2) + shift
            state[view] = np.where(template.core, FILLED, np.where(template.near, FREE, KEPT))
        taken, _ = cheapest_cut(self.costs, old, new, state)
        laid = np.where(taken[..., None], new, old)
        before, after = (self._joints(one, state != ABSENT, number, len(templates)) for one in (old, laid))
        result = source.copy()
        for index in np.flatnonzero(after < before):
            template, first = templates[index], tops[index]
            top, left, bottom, right = template.box
            own = np.s_[first : first + bottom - top, : right - left]
            result[:, top:bottom, left:right] = np.where(
                template.near, np.moveaxis(laid[own], 2, 0), result[:, top:bottom, left:right]
            )
        return result

    def _joints(
        self, source: np.ndarray, present: Bool[np.ndarray, "a b"], number: np.ndarray, count: int
    ) -> Float64[np.ndarray, "n"]:  # type: ignore[name-defined]
        """Costs of the joints by the number of their rows."""
        total = np.zeros(count)
        for axis in (0, 1):
            one, other = pairs(source, axis)
            first, second = pairs(present, axis)
            rows, columns = np.nonzero(first & second)
            cost = self.costs.between(axis, one[rows, columns], other[rows, columns])
            total += np.bincount(number[rows], cost, count)
        return total


class _Template:
    """A mixed cell: what is compared, and where it may be cut out."""

    def __init__(
        self,
        points: Int64[np.ndarray, "n 2"],
        weights: Float32[np.ndarray, "n"],  # type: ignore[name-defined]
        base: Int64[np.ndarray, "2"],
        box: tuple[int, int, int, int],
        taken: Int64[np.ndarray, "8 2"],
        own: Bool[np.ndarray, "a b"],
        near: Bool[np.ndarray, "a b"],
        core: Bool[np.ndarray, "a b"],
    ):
        self.points, self.weights, self.base, self.box = points, weights, base, box
        self.own, self.near, self.core = own, near, core
        self.taken = taken


def _offsets(
    basis: np.ndarray, sides: tuple[int, int], jitter: int
) -> tuple[Int64[np.ndarray, "n 2"], Int64[np.ndarray, "m 2"]]:
    """Displacements by whole cells within an exemplar, to a pixel, and small ones: shortest first."""
    reach = [math.ceil(float((np.abs(line) * sides).sum())) for line in inverse_of(basis).T]
    steps = np.stack(np.meshgrid(*(np.arange(-one, one + 1) for one in reach), indexing="ij"), axis=-1).reshape(
        -1, 2
    )
    cells = np.rint(steps[:, :1] * basis[0] + steps[:, 1:] * basis[1]).astype(np.int64)
    cells = cells[(np.abs(cells) < np.array(sides)).all(axis=1)]
    cells = cells[np.lexsort((cells[:, 1], cells[:, 0], (cells**2).sum(axis=1)))]
    moves = np.stack(np.meshgrid(*[np.arange(-jitter, jitter + 1)] * 2, indexing="ij"), axis=-1).reshape(-1, 2)
    moves = moves[np.lexsort((moves[:, 1], moves[:, 0], (moves**2).sum(axis=1)))]
    near = moves[(np.abs(moves) <= 1).all(axis=1)]
    return np.ascontiguousarray((cells[:, None] + near).reshape(-1, 2)), np.ascontiguousarray(moves)


def _taken(
    source: Int64[np.ndarray, "2 p q"],
    neighbours: Int64[np.ndarray, "2 k"],
    middle: Int64[np.ndarray, "2"],
) -> Int64[np.ndarray, "8 2"]:
    """The displacements by which a cell around ``middle`` would show the same as each of its neighbours."""
    taken = np.full((8, 2), -(1 << 30), np.int64)
    for index, (row, column) in enumerate(neighbours.T[:8]):
        taken[index] = source[:, row, column] - middle
    return taken


def _boxes(number: Int64[np.ndarray, "p q"]) -> list[tuple[slice, slice]]:
    """Rows and columns that hold each cell; empty for a number that no cell has."""
    count = int(number.max()) + 1
    sides = []
    for places in np.indices(number.shape):
        low, high = np.full(count, places.max() + 1), np.zeros(count, np.int64)
        np.minimum.at(low, number, places)
        np.maximum.at(high, number, places + 1)
        sides.append([slice(*pair) for pair in zip(low.tolist(), high.tolist(), strict=True)])
    return list(zip(*sides, strict=True))


def _middles(number: Int64[np.ndarray, "p q"]) -> Int64[np.ndarray, "2 n"]:
    """Mean row and column of the pixels of each cell."""
    count = np.maximum(np.bincount(number.ravel()), 1)
    rows, columns = np.indices(number.shape)
    total = [np.bincount(number.ravel(), line.ravel()) for line in (rows, columns)]
    return np.stack([np.rint(one / count).astype(np.int64) for one in total])


def _coprime(count: int) -> int:
    """A step through so many numbers that meets all of them, far apart."""
    step = max(1, round(0.618 * count))
    while math.gcd(step, count) > 1:
        step += 1
    return step
