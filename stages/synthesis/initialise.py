"""The start of the optimisation: blocks of the exemplar, in step with its lattice where it has one."""

import dataclasses
from collections.abc import Mapping
from typing import Any, Literal

import numpy as np
from pydantic import Field

from texloom.stages.arrays import Correspondence, Image, Mask, Vectors
from texloom.stages.color import lab_from_linear
from texloom.stages.common.sizes import check_side
from texloom.stages.declare import Params, stage
from texloom.stages.masks import count_excluded, fill_excluded, nearest_valid, valid_pixels, without_usable
from texloom.stages.progress import Progress, report
from texloom.stages.sizes import Size
from texloom.stages.synthesis._seams.cuts import Strips, enclosed
from texloom.stages.synthesis._seams.overlap import OverlapSearch
from texloom.stages.synthesis._seams.seam_map import seam_errors, slopes

_LEAST = 10  # px of an exemplar's shorter side
_SMALLEST_SIDE = 20  # px of a block: twice the usual patch
_SHARE = 8  # blocks of a regular exemplar are at least its shorter side over this
_FARTHEST = 64  # lattice steps from the exemplar's middle
_SEARCHED = 128  # squares along the exemplar's shorter side, by whose means a block is looked for everywhere
_LITTLE = 0.25  # share of all places, the least used, where it is looked for
_APART = 0.25  # of a block's sides, by which it keeps off the place where a neighbour goes on in the exemplar
_MARGIN = 25  # px, least width of what blocks have in common
_FINE = 256  # px of the shorter side up to which blocks are aligned at full size, beyond it at half


class InitialiseParams(Params):
    """How large the result is, and from what it starts."""

    size: Size = (1024, 1024)
    """height and width of the result, px"""
    method: Literal["lattice", "blocks", "pixels"] = "lattice"
    """`lattice`: blocks displaced by whole lattice cells, or `blocks` where there is no lattice; `blocks`: blocks
    from random places; `pixels`: random pixels, for comparison"""
    block: int | None = Field(None, ge=8)
    """least side of a block, px; null: an eighth of the exemplar's shorter side with a lattice, else a quarter"""
    tries: int = Field(10, ge=1, le=100)
    """blocks tried for each place with a lattice; the one that continues its neighbours best is taken"""
    margin: int | None = Field(None, ge=0, le=256)
    """how far a block reaches over its neighbours, is compared with them, and may be shifted to continue them, px;
    never more than half its side; null: a quarter of its shorter side, 25 at least"""


@dataclasses.dataclass(frozen=True)
class Initialised:
    """The start."""

    match: Correspondence
    """for every pixel of the result the exemplar pixel that it starts from"""
    image: Image
    """the exemplar's pixels at ``match``"""


def check_exemplar(params: InitialiseParams, known: Mapping[str, Any]) -> None:  # noqa: ARG001
    """The exemplar must be large enough to cut blocks from."""
    image = known.get("image")
    if image is not None:
        check_side(image, _LEAST)


def _block_sides(exemplar: tuple[int, int], generators: Vectors, params: InitialiseParams) -> tuple[int, int]:
    """Height and width of a block: a box of whole lattice cells, at most a third of the exemplar."""
    shorter = min(exemplar)
    if len(generators):
        least = max(_SMALLEST_SIDE, params.block or shorter // _SHARE)
        corners = np.vstack([np.zeros(2), generators])
        box = np.maximum(1, np.ceil(np.ptp(corners, axis=0)))
        sides = box * np.ceil(least / box)
    else:
        sides = np.full(2, max(_SMALLEST_SIDE, params.block or shorter // 4))
    return tuple(int(np.clip(side, 2, max(2, whole // 3))) for side, whole in zip(sides, exemplar, strict=True))  # type: ignore[return-value]


class _Blocks:
    """Places blocks in scan order, each where it continues what is placed best.

    Parameters
    ----------
    features : what neighbours are compared by, exemplar at full size.
    usable : pixels that blocks may hold, as far as there are such blocks; none allows all.
    """

    def __init__(
        self,
        features: np.ndarray,
        generators: Vectors,
        sides: tuple[int, int],
        params: InitialiseParams,
        rng: np.random.Generator,
        usable: Mask | None = None,
    ):
        self.usable = usable
        self.shape = np.array(features.shape[:2])
        self.half = 2 if self.shape.min() > _FINE else 1
        self.features = features
        self.slopes = slopes(features)
        self.generators = generators.astype(np.float64)
        self.sides = np.array(sides)
        self.tries = params.tries
        self.rng = rng
        margin = max(_MARGIN, min(sides) // 4) if params.margin is None else params.margin
        self.margin = min(margin, *(int(side) // 2 for side in sides))
        # px, over which means are taken to look everywhere, and which sum up how often blocks were used
        self.square = max(1, min(int(self.shape.min()) // _SEARCHED, self.margin // 4))
        self.uses = np.zeros(tuple(self.shape // self.square), np.float32)
        self.search = None
        self.slack = self.square
        if len(generators):
            # A shift beyond a quarter of a cell would lose the lattice.
            self.slack = int(min(self.margin, _MARGIN, np.hypot(*generators.T).min() // 4))
        else:
            self.search = OverlapSearch(self._means(features, np.zeros(2, np.int64), self.shape, self.square))
        self.origin = np.zeros(2)
        self.match = np.zeros((*params.size, 2), np.uint32)
        self.canvas = np.zeros((*params.size, features.shape[2]), np.float32)
        self.placed = np.zeros(params.size, np.float32)

    def run(self) -> np.ndarray:
        rows = range(0, self.match.shape[0], int(self.sides[0]))
        columns = range(0, self.match.shape[1], int(self.sides[1]))
        for number, row in enumerate(rows):
            for column in columns:
                self._place(np.array([row, column]))
            report(Progress((number + 1) / len(rows)))
        return self.match

    def _place(self, at: np.ndarray) -> None:
        side = np.minimum(self.sides, np.array(self.match.shape[:2]) - at)
        before = np.minimum(self.margin, at)  # the band of neighbours above and to the left
        beyond = self.match.shape[1] - at[1] - side[1]
        after = np.array([0, min(self.margin, beyond) if at[0] else 0])  # and above to the right
        low, high = before, self.shape - side - after
        best, least = None, (0, np.inf)
        masked = None if self.usable is None else count_excluded(self.usable, int(side[0]), int(side[1]))
        sources = self._fitting(at, side, before, after, high, masked)
        if not len(sources):
            sources = self._candidates(at, low, high, masked)
        for source in sources:
            error, shifted = self._align(at, side, before, after, source, low, high, masked)
            cost = (0 if masked is None else int(masked[tuple(shifted)]), error)
            if best is None or cost < least:
                best, least = shifted, cost
            if not at.any():
                self.origin = shifted.astype(np.float64)
                break
        assert best is not None
        self._paste(at, side, before, best)

    def _fitting(
        self,
        at: np.ndarray,
        side: np.ndarray,
        before: np.ndarray,
        after: np.ndarray,
        high: np.ndarray,
        masked: np.ndarray | None,
    ) -> np.ndarray:
        """The source corner, of all little used ones, that continues the neighbours best, but not one of them.

        No rows with a lattice, or where nothing stands.
        """
        top, size = at - before, before + side + after
        none = np.zeros((0, 2), np.int64)
        if self.search is None or min(size) < self.square:
            return none
        stands = self._means(self.placed, top, size, self.square) == 1
        if not stands.any():
            return none
        errors = self.search.errors(self._means(self.canvas, top, size, self.square), stands)
        rows, columns = (
            np.minimum(np.arange(count) * self.square + first, last)
            for count, first, last in zip(errors.shape, before, high, strict=True)
        )
        open_places = np.ones(errors.shape, bool)
        for step in (np.array([-1, 0]), np.array([0, -1])):
            if (at + step >= 0).all():
                row, column = self.match[tuple(at + step)].astype(np.int64) - step
                near = np.ix_(np.abs(rows - row) < _APART * side[0], np.abs(columns - column) < _APART * side[1])
                open_places[near] = False
        if masked is not None:
            holds = masked[np.ix_(rows, columns)]
            open_places &= holds == holds[open_places].min(initial=holds.max())
        if not open_places.any():
            return none
        uses = self._uses_of(rows[:, None], columns[None, :], side)
        open_places &= uses <= np.quantile(uses[open_places], _LITTLE)
        best = np.argmin(np.where(open_places, errors, np.inf))
        row, column = divmod(int(best), errors.shape[1])
        return np.array([[rows[row], columns[column]]])

    def _uses_of(self, rows: np.ndarray, columns: np.ndarray, side: np.ndarray) -> np.ndarray:
        """How often the squares of blocks with these corners were used, all together."""
        import cv2

        total = cv2.integral(self.uses)
        block = np.minimum(np.maximum(1, side // self.square), self.uses.shape)
        row, column = (
            np.minimum(corner // self.square, most - count)
            for corner, most, count in zip((rows, columns), self.uses.shape, block, strict=True)
        )
        down, across = row + block[0], column + block[1]
        return np.asarray(total[down, across] - total[row, across] - total[down, column] + total[row, column])

    def _candidates(
        self, at: np.ndarray, low: np.ndarray, high: np.ndarray, masked: np.ndarray | None
    ) -> np.ndarray:
        """Source corners, those first that hold fewest masked pixels, then the least used: random ones, or all that
        keep the lattice.
        """
        if len(self.generators) and at.any():
            start = self.origin + at
            # whole steps along the generators that lead from `start` into the exemplar
            middle = np.rint(np.linalg.solve(self.generators.T, (low + high) / 2 - start))
            lines = abs(np.linalg.det(self.generators)) / np.hypot(
                *self.generators[::-1].T
            )  # px between lattice lines
            reach = np.minimum(np.hypot(*self.shape) / 2 / lines + 1, _FARTHEST).astype(int)
            i, j = (np.arange(-n, n + 1) for n in reach)
            steps = middle + np.stack(np.meshgrid(i, j, indexing="ij"), axis=-1).reshape(-1, 2)
            found = np.rint(start + steps @ self.generators).astype(np.int64)
            found = found[((found >= low) & (found <= high)).all(axis=1)]
        else:
            found = np.zeros((0, 2), np.int64)
        if not len(found):
            found = self.rng.integers(low, high + 1, (16 * self.tries, 2))
        found = self.rng.permutation(found)
        uses = self._uses_of(found[:, 0], found[:, 1], self.sides)
        if masked is not None:
            return found[np.lexsort((uses, masked[tuple(found.T)]))[: self.tries]]
        return found[np.argsort(uses, kind="stable")[: self.tries]]

    def _align(
        self,
        at: np.ndarray,
        side: np.ndarray,
        before: np.ndarray,
        after: np.ndarray,
        source: np.ndarray,
        low: np.ndarray,
        high: np.ndarray,
        masked: np.ndarray | None,
    ) -> tuple[float, np.ndarray]:
        """Mean squared difference to what is placed at the best shift of ``source``, and the source shifted."""
        import cv2

        if not (before.any() or after.any()):
            return 0.0, source
        top, size = at - before, before + side + after
        mask = self._means(self.placed, top, size, self.half) == 1
        if not mask.any():
            return 0.0, source
        template = self._means(self.canvas, top, size, self.half)
        # Shifts go by whole squares from `source`, so that no shift at all is one of them.
        first = source - np.minimum(self.slack, source - low) // self.half * self.half
        last = source + np.minimum(self.slack, high - source) // self.half * self.half
        window = self._means(self.features, first - before, size + last - first, self.half)
        weights = np.repeat(mask[..., None], template.shape[2], axis=2).astype(np.float32)
        errors = cv2.matchTemplate(window, template, cv2.TM_SQDIFF, mask=weights)
        if masked is not None:
            rows, columns = (
                np.minimum(first[axis] + np.arange(errors.shape[axis]) * self.half, masked.shape[axis] - 1)
                for axis in (0, 1)
            )
            holds = masked[np.ix_(rows, columns)]
            errors[holds > holds.min()] = np.inf
        shift = np.array(np.unravel_index(int(np.argmin(errors)), errors.shape))
        return float(errors.min()) / float(mask.sum()), first + shift * self.half

    @staticmethod
    def _means(planes: np.ndarray, corner: np.ndarray, size: np.ndarray, square: int) -> np.ndarray:
        """Means over squares of ``square`` px, counted from ``corner``, that fit into ``size``."""
        import cv2

        height, width = (int(side) // square for side in size)
        region = planes[corner[0] :, corner[1] :][: height * square, : width * square]
        return np.asarray(cv2.resize(region, (width, height), interpolation=cv2.INTER_AREA))

    def _paste(self, at: np.ndarray, side: np.ndarray, before: np.ndarray, source: np.ndarray) -> None:
        """Lay the block within the cheapest cut through what it has in common with those above and to the left."""
        first, size = source - before, side + before
        into = tuple(slice(low, low + count) for low, count in zip(at - before, size, strict=True))
        own = tuple(slice(low, low + count) for low, count in zip(first, size, strict=True))
        stands = self.placed[into] == 1
        new = np.ones(tuple(size), bool)
        if stands.any():
            there = self.match[into]
            slope = self.slopes[own] + self.slopes[there[..., 0], there[..., 1]]
            errors = seam_errors(self.features[own] - self.canvas[into], slope, stands)
            new, _ = enclosed(errors, Strips(top=int(before[0]), left=int(before[1])))
        self.match[into][new] = first + np.argwhere(new)
        self.canvas[into][new] = self.features[own][new]
        self.placed[into][new] = 1
        begin, end = source // self.square, -(-(source + side) // self.square)
        self.uses[begin[0] : end[0], begin[1] : end[1]] += 1


@stage(version=2, check=check_exemplar)
def initialise(
    image: Image,
    params: InitialiseParams,
    rng: np.random.Generator,
    mask: Mask | None = None,
    generators: Vectors | None = None,
) -> Initialised:
    """Cover the result with blocks of the exemplar.

    Blocks are laid in scan order. With a lattice every block is displaced by whole steps of the generators from
    where the first block would continue to, so that cells stay in step across the whole result; little used parts
    of the exemplar are tried first, and shifted a little. Without one it comes from that place, of all the little
    used ones, that best continues in colour and contours what lies above and to the left. It then replaces of its
    neighbours what lies within the cheapest cut, which passes between objects where it can. Blocks keep off masked
    pixels; where none does, the nearest usable pixel stands in for each of them.

    Parameters
    ----------
    mask : features, whose continuation matters most; none leaves colour alone.
    generators : the lattice, (2, 2) px; none or no rows where the exemplar has no lattice.

    Raises
    ------
    InputError
        the exemplar is smaller than 10x10 px.

    References
    ----------
    [Kaspar2015]_ section 4.2. The paper cuts blocks at multiples of a box around the generators, which keeps a
    lattice only if it is aligned with the axes; we displace by lattice steps instead, and compare by masked squared
    differences where its authors' code correlates. Cuts are those of [Kwatra2003]_; that blocks are cut, and looked
    for everywhere where there is no lattice, is ours: what a start tears, the coarsest scale blurs and no later one
    mends.
    """
    check_exemplar(params, {"image": image})
    usable = valid_pixels(image)
    shape = (image.height, image.width)
    if params.method == "pixels":
        match = rng.integers(0, shape, (*params.size, 2), dtype=np.int64).astype(np.uint32)
    else:
        colors = lab_from_linear(fill_excluded(image).color)
        contours = np.zeros(shape, np.float32) if mask is None else mask.astype(np.float32) * 100
        lattice = np.zeros((0, 2), np.float32)
        if generators is not None and params.method == "lattice":
            lattice = generators
        sides = _block_sides(shape, lattice, params)
        match = _Blocks(
            np.concatenate([colors, contours[..., None]], axis=2), lattice, sides, params, rng, usable
        ).run()
    if usable is not None:
        match = np.moveaxis(nearest_valid(usable)[:, match[..., 0], match[..., 1]], 0, 2).astype(np.uint32)
    image = without_usable(image)
    return Initialised(match, Image(image.pixels[match[..., 0], match[..., 1]], image.channels))
