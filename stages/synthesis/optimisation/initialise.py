"""Initialisation of the optimisation: blocks of the exemplar, in phase with its lattice or its courses."""

import dataclasses
from collections.abc import Mapping
from typing import Any, Literal

import numpy as np
from jaxtyping import Float32
from pydantic import Field

from texloom.stages.common.grids.size_checks import check_side
from texloom.stages.kernels.core.threads import run_all
from texloom.stages.numerics.matrices import determinant, matrix_product, solve
from texloom.stages.synthesis.optimisation.guides import resize_target
from texloom.stages.synthesis.stitching.cuts import Strips, enclosed
from texloom.stages.synthesis.stitching.overlap import OverlapSearch
from texloom.stages.synthesis.stitching.seam_map import seam_errors, slopes
from texloom.stages.vocabulary.arrays import Correspondence, Image, Mask, ScalarMap, Vectors
from texloom.stages.vocabulary.color import lab_from_linear
from texloom.stages.vocabulary.declare import InputError, Outline, Params, stage
from texloom.stages.vocabulary.masks import (
    count_excluded,
    fill_excluded,
    nearest_valid,
    valid_pixels,
    without_usable,
)
from texloom.stages.vocabulary.progress import Progress, report
from texloom.stages.vocabulary.scratch import bands, empty, release
from texloom.stages.vocabulary.sizes import Size

_MIN_SIDE = 10  # px of an exemplar's shorter side
_MIN_BLOCK = 20  # px: twice the usual patch
_LATTICE_BLOCKS = 8  # blocks of an exemplar with a lattice are at least its shorter side divided by this
_GUIDED_BLOCKS = 8  # the same under a guide, whose regions may be small
_MAX_LATTICE_STEPS = 64  # from the exemplar's middle
_MAX_LATTICE_SHIFT = 4  # share of a cell by which a block may be shifted; more would lose the lattice
_MAX_COURSE_SHIFT = 16  # share of courses' period; all places along them are tried, so that less is needed
_SEARCH_GRID = 128  # squares along the exemplar's shorter side, whose means are compared in the global search
_LEAST_USED = 0.25  # share of the places, the least used ones, that the global search considers
_BESIDE_MASK = 0.75  # share of the usable pixels that lie in blocks without masked ones; else blocks are smaller
_SMALLER = 0.8  # sides of blocks relative to those tried before
_MIN_DISPLACEMENT = 0.25  # of a block's sides, to the place where a neighbour continues in the exemplar
_MIN_MARGIN = 25  # px of the default overlap
_GUIDE_SHARE = 0.05  # of the places, those whose guide is most like the target's, that the global search considers
_GUIDE_TRIES = 4  # times as many candidates under a guide
_MAX_FULL_RESOLUTION = 256  # px of the shorter side; larger exemplars are aligned at half resolution


class InitialiseParams(Params):
    """Size of the result, and what it is initialised from."""

    size: Size | None = (1024, 1024)
    """size of the result, px; null: that of the target's guide, which it needs then"""
    method: Literal["lattice", "blocks", "pixels"] = "lattice"
    """`lattice`: blocks displaced by whole lattice cells, or by whole courses and any distance along them, or
    `blocks` if there are neither; `blocks`: blocks from anywhere; `pixels`: random pixels, for comparison"""
    block: int | None = Field(None, ge=8)
    """minimum side of a block, px; null: an eighth of the exemplar's shorter side with a lattice of two dimensions
    or a guide, else a third, or less where most blocks of that size would contain masked pixels"""
    tries: int = Field(10, ge=1, le=100)
    """candidate blocks for each place with a lattice, of which the one that matches its neighbours best is taken"""
    margin: int | None = Field(None, ge=0, le=256)
    """overlap of a block with its neighbours in which they are compared, and maximum shift of the block, px; at
    most half its side; null: a quarter of its shorter side, at least 25"""


@dataclasses.dataclass(frozen=True)
class Initialised:
    """The initial result."""

    match: Correspondence
    """for every pixel of the result its source in the exemplar"""
    image: Image
    """the exemplar's pixels at ``match``"""


def check_exemplar(params: InitialiseParams, known: Mapping[str, Any]) -> None:  # noqa: ARG001
    """The exemplar must be large enough to cut blocks from."""
    image = known.get("image")
    if image is not None:
        check_side(image, _MIN_SIDE)


def _block_sides(
    exemplar: tuple[int, int], generators: Vectors, params: InitialiseParams, guided: bool
) -> tuple[int, int]:
    """Height and width of a block: a box of whole lattice cells, at most a third of the exemplar."""
    shorter = min(exemplar)
    if len(generators) == 2:
        min_side = max(_MIN_BLOCK, params.block or shorter // _LATTICE_BLOCKS)
        corners = np.vstack([np.zeros(2), generators])
        box = np.maximum(1, np.ceil(np.ptp(corners, axis=0)))
        sides = box * np.ceil(min_side / box)
    else:
        sides = np.full(2, max(_MIN_BLOCK, params.block or shorter // (_GUIDED_BLOCKS if guided else 3)))
    height, width = (int(np.clip(side, 2, max(2, whole // 3))) for side, whole in zip(sides, exemplar, strict=True))
    return height, width


def _margin(sides: tuple[int, int], params: InitialiseParams) -> int:
    margin = max(_MIN_MARGIN, min(sides) // 4) if params.margin is None else params.margin
    return min(margin, *(int(side) // 2 for side in sides))


def _beside_mask(sides: tuple[int, int], usable: Mask, params: InitialiseParams) -> tuple[int, int]:
    """Sides of blocks so small that most of what is usable lies in blocks without masked pixels.

    Larger ones would come from few places, or from a single one, again and again.
    """
    import cv2

    while min(sides) > _MIN_BLOCK:
        margin = _margin(sides, params)
        # Where blocks with their overlaps may be.
        whole = usable[margin:, margin : usable.shape[1] - margin].astype(np.uint8)
        block = np.ones((sides[0] | 1, sides[1] | 1), np.uint8)  # odd, as an opening by even ones is displaced
        covered = cv2.morphologyEx(whole, cv2.MORPH_OPEN, block, borderType=cv2.BORDER_CONSTANT, borderValue=0)
        if covered.sum() >= _BESIDE_MASK * whole.sum():
            break
        sides = max(_MIN_BLOCK, round(_SMALLER * sides[0])), max(_MIN_BLOCK, round(_SMALLER * sides[1]))
    return sides


@dataclasses.dataclass(frozen=True)
class _Target:
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


class _Blocks:
    """Lays blocks in scan order, each where it matches its neighbours best.

    Parameters
    ----------
    features : of the exemplar at full size, (h, w, c).
    size : height and width of the result, px.
    usable : pixels that blocks should be limited to, as far as possible; none for all.
    guides : planes of the exemplar, and of the result, that should be alike; none without.
    share : wanted use of each pixel of the exemplar, relative to even use; none for even use.
    """

    def __init__(
        self,
        features: np.ndarray,
        generators: Vectors,
        sides: tuple[int, int],
        size: tuple[int, int],
        params: InitialiseParams,
        rng: np.random.Generator,
        usable: Mask | None = None,
        guides: tuple[np.ndarray, np.ndarray] | None = None,
        share: ScalarMap | None = None,
    ):
        self.usable = usable
        self.shape = np.array(features.shape[:2])
        self.alignment_square = 2 if self.shape.min() > _MAX_FULL_RESOLUTION else 1
        self.features = features
        self._reduced: dict[tuple[int, int], tuple[np.ndarray, np.ndarray]] = {}
        self.slopes = slopes(features)
        self.generators = generators.astype(np.float64)
        self.sides = np.array(sides)
        self.tries = params.tries
        self.rng = rng
        self.margin = _margin(sides, params)
        # px of the squares of the global search and of use counts
        self.square = max(1, min(int(self.shape.min()) // _SEARCH_GRID, self.margin // 4))
        self.uses = np.zeros(tuple(self.shape // self.square), np.float32)
        self.use = np.ones_like(self.uses)  # that a block adds
        if share is not None:
            self.use /= _means(share, np.zeros(2, np.int64), self.shape, self.square)
        self.search = None
        self.max_shift = self.square
        if len(generators):
            share = _MAX_LATTICE_SHIFT if len(generators) == 2 else _MAX_COURSE_SHIFT
            self.max_shift = int(min(self.margin, _MIN_MARGIN, np.hypot(*generators.T).min() // share))
        if len(generators) < 2:
            self.search = _with_squares(_means(features, np.zeros(2, np.int64), self.shape, self.square))
        self.guide_search, self.target_guide = None, None
        if guides is not None:
            self.guide_search = OverlapSearch(
                _plane_means(guides[0], np.zeros(2, np.int64), self.shape, self.square)
            )
            self.target_guide = guides[1]
        self.origin = np.zeros(2)
        self.match = empty((*size, 2), np.uint32)
        self.canvas = empty((*size, features.shape[2]), np.float32)
        self.filled = empty(size, np.float32)
        for band in bands(size[0], self.match, self.canvas, self.filled):
            self.match[band] = self.canvas[band] = self.filled[band] = 0

    def run(self) -> np.ndarray:
        rows = range(0, self.match.shape[0], int(self.sides[0]))
        columns = range(0, self.match.shape[1], int(self.sides[1]))
        for number, row in enumerate(rows):
            for column in columns:
                self._place(self._target(np.array([row, column])))
            release(self.match, self.canvas, self.filled)
            report(Progress((number + 1) / len(rows)))
        return self.match

    def _target(self, at: np.ndarray) -> _Target:
        side = np.minimum(self.sides, np.array(self.match.shape[:2]) - at)
        to_the_right = self.match.shape[1] - at[1] - side[1]
        after = np.array([0, min(self.margin, to_the_right) if at[0] else 0])
        masked = None if self.usable is None else count_excluded(self.usable, int(side[0]), int(side[1]))
        return _Target(at, side, np.minimum(self.margin, at), after, self.shape - side - after, masked)

    def _place(self, target: _Target) -> None:
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

    def _best_anywhere(self, target: _Target) -> np.ndarray:
        """The source corner that matches the neighbours best, of all little used ones that do not continue one.

        No rows with a lattice of two dimensions, or without a synthesised region.
        """
        nowhere = np.zeros((0, 2), np.int64)
        if self.search is None or min(target.size) < self.square:
            return nowhere
        filled = _means(self.filled, target.top, target.size, self.square) == 1
        guide_errors = self._guide_errors(target)
        if filled.any():
            errors = _differences(*self.search, _means(self.canvas, target.top, target.size, self.square), filled)
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

    def _guide_errors(self, target: _Target) -> np.ndarray | None:
        """Mean squared difference of the guides at the places of the global search; none without a guide."""
        if self.guide_search is None or self.target_guide is None or min(target.size) < self.square:
            return None
        wanted = _plane_means(self.target_guide, target.top, target.size, self.square)
        asked = ~np.isnan(wanted[..., 0])
        if not asked.any():
            return None
        return np.asarray(self.guide_search.errors(wanted, asked))

    def _at_places(self, errors: np.ndarray, target: _Target, corners: np.ndarray) -> np.ndarray:
        """The errors of the global search at the places nearest to source corners."""
        places = np.minimum((corners - target.before) // self.square, np.array(errors.shape) - 1)
        return np.asarray(errors[tuple(places.T)])

    def _away_from_continuations(self, target: _Target, rows: np.ndarray, columns: np.ndarray) -> np.ndarray:
        """False near the source corners at which the block would continue a neighbour's copy."""
        permitted = np.ones((len(rows), len(columns)), bool)
        height, width = _MIN_DISPLACEMENT * target.side
        for step in (np.array([-1, 0]), np.array([0, -1])):
            if (target.at + step >= 0).all():
                row, column = self.match[tuple(target.at + step)].astype(np.int64) - step
                permitted[np.ix_(np.abs(rows - row) < height, np.abs(columns - column) < width)] = False
        return permitted

    def _in_phase(self, target: _Target, rows: np.ndarray, columns: np.ndarray) -> np.ndarray:
        """False at the source corners from which courses would not continue those of the first block."""
        if not len(self.generators):
            return np.ones((len(rows), len(columns)), bool)
        corners = np.stack(np.meshgrid(rows, columns, indexing="ij"), axis=-1)
        away = np.hypot(*np.moveaxis(self._off_course(target, corners), -1, 0))
        return np.asarray(away <= 0.5 * self.square + 0.5)

    def _off_course(self, target: _Target, corners: np.ndarray) -> np.ndarray:
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

    def _candidates(self, target: _Target) -> np.ndarray:
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

    def _lattice_positions(self, target: _Target) -> np.ndarray:
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

    def _overlap(self, target: _Target) -> tuple[np.ndarray, np.ndarray] | None:
        """What is synthesised where a block is to lie, and true where it is; none where nothing is."""
        if not (target.before.any() or target.after.any()):
            return None
        filled = _means(self.filled, target.top, target.size, self.alignment_square) == 1
        if not filled.any():
            return None
        return _means(self.canvas, target.top, target.size, self.alignment_square), filled

    def _align(
        self, target: _Target, template: np.ndarray, filled: np.ndarray, source: np.ndarray
    ) -> tuple[float, np.ndarray]:
        """Mean squared difference to the synthesised region at the best shift of ``source``, and it shifted."""
        square = self.alignment_square
        # Shifts are multiples of the square from `source`, so that one of them is 0.
        first = source - np.minimum(self.max_shift, source - target.before) // square * square
        last = source + np.minimum(self.max_shift, target.high - source) // square * square
        errors = _differences(*self._window(first - target.before, target.size + last - first), template, filled)
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
        """Part of the reduced exemplar, and the sums over the channels of its squares."""
        square = self.alignment_square
        phase = (int(corner[0]) % square, int(corner[1]) % square)
        if phase not in self._reduced:
            self._reduced[phase] = _with_squares(_means(self.features, np.array(phase), self.shape - phase, square))
        (top, left), (height, width) = corner // square, size // square
        place = np.s_[top : top + height, left : left + width]
        means, sums = self._reduced[phase]
        return means[place], sums[place]

    def _paste(self, target: _Target, source: np.ndarray) -> None:
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


def _means(planes: np.ndarray, corner: np.ndarray, size: np.ndarray, square: int) -> np.ndarray:
    """Means over the squares of ``square`` px that fit into ``size``, counted from ``corner``."""
    import cv2

    height, width = (int(side) // square for side in size)
    region = planes[corner[0] :, corner[1] :][: height * square, : width * square]
    return np.asarray(cv2.resize(region, (width, height), interpolation=cv2.INTER_AREA))


def _with_squares(planes: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Planes, and the sums of their squares, as `_differences` takes them."""
    return planes, (planes**2).sum(axis=2)


def _differences(planes: np.ndarray, squares: np.ndarray, template: np.ndarray, filled: np.ndarray) -> np.ndarray:
    """Mean squared difference of a template, where it is ``filled``, at every place of up to four planes."""
    import cv2

    # OpenCV's masked difference correlates the squares of each channel.
    weights = filled.astype(np.float32)
    weighted = template * weights[..., None]
    errors = cv2.matchTemplate(squares, weights, cv2.TM_CCORR)
    errors += (weighted * template).sum() - 2 * cv2.matchTemplate(planes, weighted, cv2.TM_CCORR)
    return np.asarray(errors / weights.sum())


def _plane_means(planes: np.ndarray, corner: np.ndarray, size: np.ndarray, square: int) -> np.ndarray:
    """`_means` of any number of planes, one or more."""
    return np.stack([_means(plane, corner, size, square) for plane in np.moveaxis(planes, 2, 0)], axis=2)


def _size(params: InitialiseParams, target: tuple[int, int] | None) -> tuple[int, int]:
    """Height and width of the result, given those of the target's guide."""
    size = params.size or target
    if size is None:
        raise InputError("size: give the size of the result, or a guide that has it")
    return size


def outlines(params: InitialiseParams, known: Mapping[str, Any]) -> dict[str, Outline]:
    """The correspondence has the size of the result."""
    target = known.get("target_guide")
    size = params.size or (None if target is None else target.shape[:2])
    return {} if size is None else {"match": Outline(*size)}


@stage(version=2, check=check_exemplar, outlines=outlines, in_bands=True, exemplar_bytes=90)
def initialise(
    image: Image,
    params: InitialiseParams,
    rng: np.random.Generator,
    structure: Mask | None = None,
    generators: Vectors | None = None,
    exemplar_guide: Float32[np.ndarray, "h w k"] | None = None,
    target_guide: Float32[np.ndarray, "H W k"] | None = None,
    share: ScalarMap | None = None,
) -> Initialised:
    """Cover the result with blocks of the exemplar.

    Blocks are laid in scan order and joined along minimum cuts. With a lattice every block is displaced by whole
    lattice steps from where the first block would continue, so that cells stay in phase across the whole result;
    little used parts of the exemplar are tried first, with small shifts. Without one it is the place, of all little
    used ones, that matches its neighbours best in colour and structure; with courses, of all those at whole courses
    from where the first block would continue. Under a guide it is one of the places whose guide is most like that
    of the result. Blocks avoid masked pixels, and without a lattice are smaller where few places would allow that;
    where it is impossible, each masked pixel is replaced by the nearest usable one.

    Parameters
    ----------
    image : the exemplar.
    structure : true on features, whose continuation is weighted highest; none compares colour alone.
    generators : the lattice, two rows of px, or one, at right angles to the courses; none or no rows where the
        exemplar has no lattice.
    exemplar_guide, target_guide : what lies where in the exemplar and what is to lie where in the result, CIELAB
        units; see `guide`. The target's is resized to the result, and NaN where it asks for nothing. None without a
        guide.
    share : use of each exemplar pixel that is wanted, relative to even use, above 0; none for even use.

    Raises
    ------
    InputError
        the exemplar is smaller than 10 x 10 px; neither ``size`` nor a guide tells the result's.

    References
    ----------
    [Kaspar2015]_ section 3.3. The paper cuts blocks at multiples of a box around the generators, which preserves
    only lattices aligned with the axes; we displace by lattice steps, and compare by masked squared differences
    where its authors' code correlates. Cuts are those of [Kwatra2003]_. Cutting blocks, and searching everywhere
    without a lattice, are ours: discontinuities of the start are blurred at the coarsest scale and never repaired.
    """
    usable = valid_pixels(image)
    shape = (image.height, image.width)
    size = _size(params, None if target_guide is None else (target_guide.shape[0], target_guide.shape[1]))
    if params.method == "pixels":
        match = rng.integers(0, shape, (*size, 2), dtype=np.int64).astype(np.uint32)
    else:
        contours = np.zeros(shape, np.float32) if structure is None else structure.astype(np.float32) * 100
        lattice = np.zeros((0, 2), np.float32)
        if generators is not None and params.method == "lattice":
            lattice = generators
        guides = None
        if exemplar_guide is not None and target_guide is not None:
            guides = exemplar_guide, resize_target(target_guide, *size)
        sides = _block_sides(shape, lattice, params, guides is not None)
        if usable is not None and len(lattice) < 2 and params.block is None:
            sides = _beside_mask(sides, usable, params)
        features = np.concatenate([lab_from_linear(fill_excluded(image).color), contours[..., None]], axis=2)
        del contours
        match = _Blocks(features, lattice, sides, size, params, rng, usable, guides, share).run()
    nearest = None if usable is None else nearest_valid(usable)
    image = without_usable(image)
    pixels = empty((*size, image.pixels.shape[2]), np.float32)
    for band in bands(size[0], match, pixels):
        if nearest is not None:
            match[band] = np.moveaxis(nearest[:, match[band, :, 0], match[band, :, 1]], 0, 2)
        pixels[band] = image.pixels[match[band, :, 0], match[band, :, 1]]
    return Initialised(match, image.elsewhere(pixels))
