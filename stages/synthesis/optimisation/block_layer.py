"""Blocks of an exemplar laid in scan order, in phase with its lattice or its courses."""

import dataclasses

import numpy as np

from texloom.stages.kernels.core.threads import run_all
from texloom.stages.numerics.matrices import determinant, matrix_product, solve
from texloom.stages.synthesis.optimisation.block_differences import (
    differences,
    plane_means,
    square_means,
    with_squares,
)
from texloom.stages.synthesis.optimisation.block_sides import MIN_MARGIN
from texloom.stages.synthesis.optimisation.several_exemplars import SeveralExemplars, Turns
from texloom.stages.synthesis.stitching.cuts import Strips, enclosed
from texloom.stages.synthesis.stitching.overlap import OverlapSearch
from texloom.stages.synthesis.stitching.seam_map import seam_errors, slopes
from texloom.stages.vocabulary.arrays import Mask, ScalarMap, Vectors
from texloom.stages.vocabulary.masks import count_excluded
from texloom.stages.vocabulary.progress import Progress, report
from texloom.stages.vocabulary.scratch import bands, empty, release

_MAX_LATTICE_STEPS = 64  # from the exemplar's middle
_MAX_LATTICE_SHIFT = 4  # share of a cell by which a block may be shifted; more would lose the lattice
_MAX_COURSE_SHIFT = 16  # share of courses' period; all places along them are tried, so that less is needed
_SEARCH_GRID = 128  # squares along the exemplar's shorter side, whose means are compared in the global search
_LEAST_USED = 0.25  # share of the places, the least used ones, that the global search considers
_MIN_DISPLACEMENT = 0.25  # of a block's sides, to the place where a neighbour continues in the exemplar
_GUIDE_SHARE = 0.05  # of the places, those whose guide is most like the target's, that the global search considers
_GUIDE_TRIES = 4  # times as many candidates under a guide
_MAX_FULL_RESOLUTION = 256  # px of the shorter side; larger exemplars are aligned at half resolution


@dataclasses.dataclass(frozen=True)
class _Place:
    """A place of the result for a block, with its overlaps. All pairs are rows and columns, px."""

    at: np.ndarray
    """top-left pixel of the block"""
    side: np.ndarray
    before: np.ndarray
    """widths of the overlaps above and to the left"""
    after: np.ndarray
    """widths of the overlaps below, always 0, and above to the right"""
    high: np.ndarray
    """largest source corner; the smallest is ``before``"""
    masked: np.ndarray | None
    """number of masked pixels in a block of this size at each place of the exemplar"""

    @property
    def top(self) -> np.ndarray:
        return np.asarray(self.at - self.before)

    @property
    def size(self) -> np.ndarray:
        """Of the block with its overlaps."""
        return np.asarray(self.before + self.side + self.after)


class BlockLayer:
    """Lays blocks in scan order, each where it matches its neighbours best.

    Parameters
    ----------
    features : of the exemplar at full size, (h, w, c).
    generators : its lattice, two rows of px, or one, at right angles to the courses; no rows without.
    sides, margin : of a block, and its overlap with its neighbours, px.
    size : height and width of the result, px.
    tries : candidate blocks for each place with a lattice.
    usable : pixels that blocks should be limited to, as far as possible; none for all.
    guides : planes of the exemplar, and of the result, that should be alike; none without.
    share : wanted use of each pixel of the exemplar, relative to even use; none for even use.
    several : exemplars of which each gives its share of the blocks; none for one.
    """

    def __init__(
        self,
        features: np.ndarray,
        generators: Vectors,
        sides: tuple[int, int],
        margin: int,
        size: tuple[int, int],
        tries: int,
        rng: np.random.Generator,
        usable: Mask | None = None,
        guides: tuple[np.ndarray, np.ndarray] | None = None,
        share: ScalarMap | None = None,
        several: SeveralExemplars | None = None,
    ):
        self.usable = usable
        self.shape = np.array(features.shape[:2])
        self.alignment_square = 2 if self.shape.min() > _MAX_FULL_RESOLUTION else 1
        self.features = features
        self.slopes = slopes(features)
        self.generators = generators.astype(np.float64)
        self.sides = np.array(sides)
        self.tries = tries
        self.rng = rng
        self.margin = margin
        # px of the squares of the global search and of use counts
        self.square = max(1, min(int(self.shape.min()) // _SEARCH_GRID, self.margin // 4))
        self.uses = np.zeros(tuple(self.shape // self.square), np.float32)
        self.use = np.ones_like(self.uses)  # that a block adds
        if share is not None:
            self.use /= square_means(share, np.zeros(2, np.int64), self.shape, self.square)
        self.turns = None if several is None else Turns(several)
        self.search = None
        self.max_shift = self.square
        if len(generators):
            part = _MAX_LATTICE_SHIFT if len(generators) == 2 else _MAX_COURSE_SHIFT
            self.max_shift = int(min(self.margin, MIN_MARGIN, np.hypot(*generators.T).min() // part))
        if len(generators) < 2:
            self.search = with_squares(square_means(features, np.zeros(2, np.int64), self.shape, self.square))
        self.guide_search, self.target_guide = None, None
        if guides is not None:
            self.guide_search = OverlapSearch(
                plane_means(guides[0], np.zeros(2, np.int64), self.shape, self.square)
            )
            self.target_guide = guides[1]
        self.origin = np.zeros(2)
        self.match = empty((*size, 2), np.uint32)
        self.canvas = empty((*size, features.shape[2]), np.float32)
        self.filled = empty(size, np.float32)
        for band in bands(size[0], self.match, self.canvas, self.filled):
            self.match[band] = self.canvas[band] = self.filled[band] = 0

    def run(self) -> np.ndarray:
        """The source of every pixel of the result, (H, W, 2), rows and columns of the exemplar."""
        rows = range(0, self.match.shape[0], int(self.sides[0]))
        columns = range(0, self.match.shape[1], int(self.sides[1]))
        for number, row in enumerate(rows):
            for column in columns:
                self._place(self._target(np.array([row, column])))
            release(self.match, self.canvas, self.filled)
            report(Progress((number + 1) / len(rows)))
        return self.match

    def _target(self, at: np.ndarray) -> _Place:
        side = np.minimum(self.sides, np.array(self.match.shape[:2]) - at)
        to_the_right = self.match.shape[1] - at[1] - side[1]
        after = np.array([0, min(self.margin, to_the_right) if at[0] else 0])
        usable = self.usable if self.turns is None else self.turns.take(int(side.prod()), self.rng)
        masked = None if usable is None else count_excluded(usable, int(side[0]), int(side[1]))
        return _Place(at, side, np.minimum(self.margin, at), after, self.shape - side - after, masked)

    def _place(self, target: _Place) -> None:
        best, best_cost = None, (0, np.inf)
        sources = self._best_anywhere(target)
        if not len(sources):
            sources = self._candidates(target)
        guide_errors = self._guide_errors(target)
        overlap = self._overlap(target)
        aligned = [(0.0, source) for source in sources]
        if overlap is not None:
            aligned = run_all(self._align, [(target, *overlap, source) for source in sources])
        for alone, shifted in aligned:
            error = alone
            if guide_errors is not None:
                error += float(self._at_places(guide_errors, target, shifted[None])[0])
            cost = (0 if target.masked is None else int(target.masked[tuple(shifted)]), error)
            if best is None or cost < best_cost:
                best, best_cost = shifted, cost
            if not target.at.any():
                self.origin = shifted.astype(np.float64)
                break
        assert best is not None
        self._paste(target, best)

    def _best_anywhere(self, target: _Place) -> np.ndarray:
        """The source corner that matches the neighbours best, of all little used ones that do not continue one.

        No rows with a lattice of two dimensions, or without a synthesised region.
        """
        nowhere = np.zeros((0, 2), np.int64)
        if self.search is None or min(target.size) < self.square:
            return nowhere
        filled = square_means(self.filled, target.top, target.size, self.square) == 1
        guide_errors = self._guide_errors(target)
        if filled.any():
            errors = differences(
                *self.search, square_means(self.canvas, target.top, target.size, self.square), filled
            )
        elif guide_errors is not None:
            errors = np.zeros_like(guide_errors)
        else:
            return nowhere
        rows, columns = (
            np.minimum(np.arange(count) * self.square + first, last)
            for count, first, last in zip(errors.shape, target.before, target.high, strict=True)
        )
        permitted = self._away_from_continuations(target, rows, columns) & self._in_phase(target, rows, columns)
        if target.masked is not None:
            masked = target.masked[np.ix_(rows, columns)]
            permitted &= masked == masked[permitted].min(initial=masked.max())
        if not permitted.any():
            return nowhere
        if guide_errors is not None:
            errors = errors + guide_errors
            permitted &= guide_errors <= np.quantile(guide_errors[permitted], _GUIDE_SHARE)
        uses = self._uses_of(rows[:, None], columns[None, :], target.side)
        permitted &= uses <= np.quantile(uses[permitted], _LEAST_USED)
        row, column = divmod(int(np.argmin(np.where(permitted, errors, np.inf))), errors.shape[1])
        return np.array([[rows[row], columns[column]]])

    def _guide_errors(self, target: _Place) -> np.ndarray | None:
        """Mean squared difference of the guides at the places of the global search; none without a guide."""
        if self.guide_search is None or self.target_guide is None or min(target.size) < self.square:
            return None
        wanted = plane_means(self.target_guide, target.top, target.size, self.square)
        asked = ~np.isnan(wanted[..., 0])
        if not asked.any():
            return None
        return np.asarray(self.guide_search.errors(wanted, asked))

    def _at_places(self, errors: np.ndarray, target: _Place, corners: np.ndarray) -> np.ndarray:
        """The errors of the global search at the places nearest to source corners."""
        places = np.minimum((corners - target.before) // self.square, np.array(errors.shape) - 1)
        return np.asarray(errors[tuple(places.T)])

    def _away_from_continuations(self, target: _Place, rows: np.ndarray, columns: np.ndarray) -> np.ndarray:
        """False near the source corners at which the block would continue a neighbour's copy."""
        permitted = np.ones((len(rows), len(columns)), bool)
        height, width = _MIN_DISPLACEMENT * target.side
        for step in (np.array([-1, 0]), np.array([0, -1])):
            if (target.at + step >= 0).all():
                row, column = self.match[tuple(target.at + step)].astype(np.int64) - step
                permitted[np.ix_(np.abs(rows - row) < height, np.abs(columns - column) < width)] = False
        return permitted

    def _in_phase(self, target: _Place, rows: np.ndarray, columns: np.ndarray) -> np.ndarray:
        """False at the source corners from which courses would not continue those of the first block."""
        if not len(self.generators):
            return np.ones((len(rows), len(columns)), bool)
        corners = np.stack(np.meshgrid(rows, columns, indexing="ij"), axis=-1)
        away = np.hypot(*np.moveaxis(self._off_course(target, corners), -1, 0))
        return np.asarray(away <= 0.5 * self.square + 0.5)

    def _off_course(self, target: _Place, corners: np.ndarray) -> np.ndarray:
        """From the nearest place in phase with the first block's courses to each source corner, px."""
        period = self.generators[0]
        steps = matrix_product(corners - self.origin - target.at, period) / matrix_product(period, period)
        return np.asarray((steps - np.rint(steps))[..., None] * period)

    def _uses_of(self, rows: np.ndarray, columns: np.ndarray, side: np.ndarray) -> np.ndarray:
        """Sum of the use counts of the squares of blocks with these corners."""
        import cv2

        total = cv2.integral(self.uses)
        block = np.minimum(np.maximum(1, side // self.square), self.uses.shape)
        row, column = (
            np.minimum(corner // self.square, length - count)
            for corner, length, count in zip((rows, columns), self.uses.shape, block, strict=True)
        )
        down, across = row + block[0], column + block[1]
        return np.asarray(total[down, across] - total[row, across] - total[down, column] + total[row, column])

    def _candidates(self, target: _Place) -> np.ndarray:
        """Source corners with fewest masked pixels and least use: lattice positions, or random ones if none."""
        corners = self._lattice_positions(target)
        if not len(corners):
            corners = self.rng.integers(target.before, target.high + 1, (16 * self.tries, 2))
            if len(self.generators) and target.at.any():
                shifted = np.rint(corners - self._off_course(target, corners)).astype(np.int64)
                corners = np.clip(shifted, target.before, target.high)
        corners = self.rng.permutation(corners)
        guide_errors = self._guide_errors(target)
        if guide_errors is not None:
            order = np.argsort(self._at_places(guide_errors, target, corners), kind="stable")
            corners = corners[order[: _GUIDE_TRIES * self.tries]]
        uses = self._uses_of(corners[:, 0], corners[:, 1], self.sides)
        if target.masked is not None:
            return corners[np.lexsort((uses, target.masked[tuple(corners.T)]))[: self.tries]]
        return corners[np.argsort(uses, kind="stable")[: self.tries]]

    def _lattice_positions(self, target: _Place) -> np.ndarray:
        """Source corners displaced by whole lattice steps from where the first block would continue."""
        if not (len(self.generators) == 2 and target.at.any()):
            return np.zeros((0, 2), np.int64)
        low, high = target.before, target.high
        start = self.origin + target.at
        middle = np.rint(solve(self.generators.T, (low + high) / 2 - start))
        lengths = np.hypot(*self.generators[::-1].T)
        spacing = abs(determinant(self.generators)) / lengths  # px between lattice lines
        reach = np.minimum(np.hypot(*self.shape) / 2 / spacing + 1, _MAX_LATTICE_STEPS).astype(int)
        i, j = (np.arange(-n, n + 1) for n in reach)
        steps = middle + np.stack(np.meshgrid(i, j, indexing="ij"), axis=-1).reshape(-1, 2)
        corners = np.rint(start + matrix_product(steps, self.generators)).astype(np.int64)
        return np.asarray(corners[((corners >= low) & (corners <= high)).all(axis=1)])

    def _overlap(self, target: _Place) -> tuple[np.ndarray, np.ndarray] | None:
        """What is synthesised where a block is to lie, and true where it is; none where nothing is."""
        if not (target.before.any() or target.after.any()):
            return None
        filled = square_means(self.filled, target.top, target.size, self.alignment_square) == 1
        if not filled.any():
            return None
        return square_means(self.canvas, target.top, target.size, self.alignment_square), filled

    def _align(
        self, target: _Place, template: np.ndarray, filled: np.ndarray, source: np.ndarray
    ) -> tuple[float, np.ndarray]:
        """Mean squared difference to the synthesised region at the best shift of ``source``, and it shifted."""
        square = self.alignment_square
        # Shifts are multiples of the square from `source`, so that one of them is 0.
        first = source - np.minimum(self.max_shift, source - target.before) // square * square
        last = source + np.minimum(self.max_shift, target.high - source) // square * square
        errors = differences(*self._window(first - target.before, target.size + last - first), template, filled)
        if target.masked is not None:
            rows, columns = (
                np.minimum(first[axis] + np.arange(errors.shape[axis]) * square, target.masked.shape[axis] - 1)
                for axis in (0, 1)
            )
            masked = target.masked[np.ix_(rows, columns)]
            errors[masked > masked.min()] = np.inf
        shift = np.array(np.unravel_index(int(np.argmin(errors)), errors.shape))
        return float(errors.min()), first + shift * square

    def _window(self, corner: np.ndarray, size: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Part of the exemplar, reduced, and the sums over the channels of its squares."""
        return with_squares(square_means(self.features, corner, size, self.alignment_square))

    def _paste(self, target: _Place, source: np.ndarray) -> None:
        """Lay the block inside the minimum cut through its overlaps above and to the left."""
        first, size = source - target.before, target.side + target.before
        into = tuple(slice(low, low + count) for low, count in zip(target.top, size, strict=True))
        own = tuple(slice(low, low + count) for low, count in zip(first, size, strict=True))
        filled = self.filled[into] == 1
        new = np.ones(tuple(size), bool)
        if filled.any():
            existing = self.match[into]
            slope = self.slopes[own] + self.slopes[existing[..., 0], existing[..., 1]]
            errors = seam_errors(self.features[own] - self.canvas[into], slope, filled)
            new, _ = enclosed(errors, Strips(top=int(target.before[0]), left=int(target.before[1])))
        rows, columns = (np.arange(low, low + count) for low, count in zip(first, size, strict=True))
        match = self.match[into]
        np.copyto(match[..., 0], rows[:, None], where=new, casting="unsafe")
        np.copyto(match[..., 1], columns, where=new, casting="unsafe")
        np.copyto(self.canvas[into], self.features[own], where=new[..., None])
        np.copyto(self.filled[into], 1, where=new)
        begin, end = source // self.square, -(-(source + target.side) // self.square)
        squares = np.s_[begin[0] : end[0], begin[1] : end[1]]
        self.uses[squares] += self.use[squares]
