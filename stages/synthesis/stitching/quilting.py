"""Image quilting: blocks of the exemplar, joined along minimum boundary cuts."""

import dataclasses
import itertools
from collections.abc import Mapping
from typing import Any

import numpy as np
from jaxtyping import Bool, Float32, Int64
from pydantic import Field

from texloom.stages.synthesis.stitching.cuts import Strips, enclosed
from texloom.stages.synthesis.stitching.exemplar import Exemplar, Stitched, StitchingParams, check_exemplar, lab_of
from texloom.stages.synthesis.stitching.overlap import OverlapSearch, ReducedSearch, good_enough
from texloom.stages.synthesis.stitching.seam_map import SeamMap, seam_errors, slopes
from texloom.stages.vocabulary.arrays import Image
from texloom.stages.vocabulary.declare import InputError, stage
from texloom.stages.vocabulary.progress import Progress, report
from texloom.stages.vocabulary.sizes import Size, format_size

_MIN_SIDE = 8  # px of an exemplar's shorter side
_MIN_DEFAULT_BLOCK = 24  # px
_USE_SQUARE = 16  # px of the squares of the exemplar whose use is counted
_REUSE_WEIGHT = 3.0  # factor 1 + this on the cost of a block that was used as often as the average
_SEPARATION = 2  # px between candidate blocks
_REFINEMENT_SCALES = (2 / 3, 1 / 3)  # sides of refinement blocks relative to the first ones
_MIN_REFINEMENT_SIDE = 6  # px
_REFINEMENT_GRID = 128  # squares along a side of the exemplar on which refinement blocks are searched


class QuiltingParams(StitchingParams):
    """Size of the result, blocks and their choice."""

    size: Size = (1024, 1024)
    block: int | None = Field(None, ge=6)
    """side of a block, px, about twice that of the largest feature; null: three eighths of the exemplar's shorter
    side, at least 24"""
    overlap: float = Field(1 / 3, gt=0, le=1 / 3)
    """width of the overlap with each neighbour, as a share of a block's side; at least 2 px"""
    tolerance: float = Field(0.1, ge=0, le=10)
    """candidates are drawn from the blocks whose squared difference to their neighbours is at most 1 + this
    times the minimum; 0 takes the best block only, which repeats more"""
    tries: int = Field(8, ge=1, le=256)
    """candidate blocks, of which the one with the least cost of cut and reuse is laid; 1 as in the paper"""
    seam_refinement: float = Field(1.0, ge=0, le=100)
    """number of further blocks tried over the most visible seams, for each of the first; 0 as in the paper"""


def _block(exemplar: Exemplar, params: QuiltingParams) -> int:
    """Side of a block; smaller than the default where the mask leaves no larger one."""
    default = min(*exemplar.shape, max(_MIN_DEFAULT_BLOCK, 3 * min(exemplar.shape) // 8))
    smaller = [default >> halvings for halvings in range(8) if default >> halvings >= _MIN_SIDE]
    sides = [params.block] if params.block else smaller
    return sides[exemplar.first_that_fits(sides, "block", "block")]


def check_block(params: QuiltingParams, known: Mapping[str, Any]) -> None:
    """The exemplar must hold a block."""
    check_exemplar(params, known, _MIN_SIDE)
    image = known.get("image")
    if image is not None and params.block is not None and params.block > min(image.height, image.width):
        raise InputError(f"block: {params.block} px is more than the image has, {format_size(image)}")


def _edges(length: int, block: int, overlap: int, wraps: bool) -> list[int]:
    """First pixels of equal blocks that cover a side, and of the block after the last.

    Each block ends ``overlap`` px beyond the first pixel of the next.
    """
    free = length if wraps else length - overlap
    count = max(2 if wraps else 1, -(-free // (block - overlap)))
    return [free * index // count for index in range(count + 1)]


@dataclasses.dataclass(frozen=True)
class _BlockTarget:
    """A rectangle of the result over which a block is laid."""

    at: tuple[np.ndarray, ...]
    """its rows and columns"""
    strips: Strips
    """overlaps with the already synthesised region"""
    filled: Bool[np.ndarray, "m n"]
    """true in the overlaps"""
    features: Float32[np.ndarray, "m n c"]
    """of the synthesised region"""
    slope: Float32[np.ndarray, "m n"]


class _Quilt:
    """The result during synthesis."""

    def __init__(self, image: Image, params: QuiltingParams, rng: np.random.Generator):
        self.params = params
        self.rng = rng
        self.exemplar = Exemplar(image, lab_of, 100.0, params.weights)
        self.features = self.exemplar.features
        self.slopes = slopes(self.features)
        self.size = np.array(params.size)
        self.match = np.zeros((*params.size, 2), np.uint32)
        self.uses = np.zeros([-(-side // _USE_SQUARE) for side in self.exemplar.shape], np.int64)
        self.block = _block(self.exemplar, params)

    def fill(self) -> None:
        """Fill the result with blocks in scan order."""
        height, width = self.params.size
        # The opposite overlaps of a tileable result's last blocks must not meet.
        limit = min(self.block // 3, min(height, width) // 4)
        overlap = min(max(2, round(self.block * self.params.overlap)), limit)
        wrap = self.params.tileable
        rows = list(itertools.pairwise(_edges(height, self.block, overlap, wrap.down)))
        columns = list(itertools.pairwise(_edges(width, self.block, overlap, wrap.across)))
        search = OverlapSearch(self.features)
        for i, (top, bottom) in enumerate(rows):
            for j, (left, right) in enumerate(columns):
                strips = Strips(
                    top=overlap if i else 0,
                    left=overlap if j else 0,
                    bottom=overlap if wrap.down and i == len(rows) - 1 else 0,
                    right=overlap if wrap.across and j == len(columns) - 1 else 0,
                )
                sides = (bottom - top + overlap, right - left + overlap)
                target = self._target(np.array([top, left]), sides, strips)
                if target.filled.any():
                    source, new = self._best_block(target, search)
                else:
                    source, new = self.exemplar.anywhere(*sides, self.rng), np.ones(sides, bool)
                self._put(target, source, new)
            report(Progress((i + 1) / len(rows) / (2 if self.params.seam_refinement else 1)))

    def refine_seams(self) -> None:
        """Lay further blocks over the most visible seams, where that lowers the cost of all seams."""
        passes = int(
            np.ceil(self.params.seam_refinement * self.size.prod() / (self.block * (1 - self.params.overlap)) ** 2)
        )
        if not passes:
            return
        limit = int(self.size.min()) - 1
        sides = [min(max(_MIN_REFINEMENT_SIDE, round(self.block * scale)), limit) for scale in _REFINEMENT_SCALES]
        seams = SeamMap(self.features, self.slopes, self.match, self.params.tileable)
        search = ReducedSearch(self.features, _REFINEMENT_GRID)
        for number in range(passes):
            side = sides[number % len(sides)]
            if seams.costs.any():
                self._refine_window(seams, search, seams.worst(side), side)
            report(Progress(0.5 + (number + 1) / passes / 2))

    def _target(self, top: Int64[np.ndarray, "2"], sides: tuple[int, int], strips: Strips) -> _BlockTarget:
        """A rectangle of the result, around it where it wraps, given its top-left pixel."""
        lines = (
            (first + np.arange(side)) % length for first, side, length in zip(top, sides, self.size, strict=True)
        )
        at = np.ix_(*lines)
        match = self.match[at]
        source = (match[..., 0], match[..., 1])
        return _BlockTarget(at, strips, strips.mask(sides), self.features[source], self.slopes[source])

    def _best_block(
        self, target: _BlockTarget, search: OverlapSearch
    ) -> tuple[Int64[np.ndarray, "2"], Bool[np.ndarray, "m n"]]:
        """Of several good blocks the one with the least cost of cut and reuse, and the pixels inside the cut."""
        errors = search.errors(target.features, target.filled)
        errors[~self.exemplar.open_places(*target.filled.shape)] = np.inf
        good = good_enough(errors, self.params.tolerance, search.noise(target.features, target.filled))
        best_cost, best = np.inf, (np.zeros(2, np.int64), target.filled)
        for _ in range(self.params.tries):
            remaining = np.flatnonzero(good)
            if not remaining.size:
                break
            row, column = divmod(int(remaining[self.rng.integers(remaining.size)]), good.shape[1])
            rows, columns = (slice(max(0, at - _SEPARATION), at + _SEPARATION + 1) for at in (row, column))
            good[rows, columns] = False
            source = np.array([row, column])
            factor = self._reuse_factor(source, target.filled.shape)
            new, cost = self._cut(target, source, best_cost / factor)
            if cost * factor < best_cost:
                best_cost, best = cost * factor, (source, new)
        return best

    def _refine_window(self, seams: SeamMap, search: ReducedSearch, top: Int64[np.ndarray, "2"], side: int) -> None:
        """Lay the block over a window that saves most seam cost, weighted by reuse, if any saves some."""
        before, after = (
            np.where(beyond | np.array(self.params.tileable), side // 3, 0)
            for beyond in (top > 0, top + side < self.size)
        )
        target = self._target(top, (side, side), Strips(*(int(width) for width in (*before, *after))))
        free = self.exemplar.open_places(side, side)
        places = search.best(target.features, target.filled, free, self.params.tries, _SEPARATION)
        total = seams.total(top, side)
        best_saving, best = 0.0, None
        for source in places:
            factor = self._reuse_factor(source, target.filled.shape)
            # A block saves at most the cost of the seams in the window, less that of its cut.
            new, cost = self._cut(target, source, total - best_saving * factor)
            saving = -seams.cost_increase(top, new, source) / factor if cost < np.inf else 0.0
            if saving > best_saving:
                best_saving, best = saving, (source, new)
        if best is not None:
            self._put(target, *best)
            seams.changed(top, side)

    def _cut(
        self, target: _BlockTarget, source: Int64[np.ndarray, "2"], limit: float
    ) -> tuple[Bool[np.ndarray, "m n"], float]:
        """Pixels inside the minimum cut of a block over ``target``, and the cut's cost if below ``limit``."""
        height, width = target.filled.shape
        at = (slice(source[0], source[0] + height), slice(source[1], source[1] + width))
        errors = seam_errors(self.features[at] - target.features, self.slopes[at] + target.slope, target.filled)
        return enclosed(errors, target.strips, limit)

    def _put(self, target: _BlockTarget, source: Int64[np.ndarray, "2"], new: Bool[np.ndarray, "m n"]) -> None:
        self._uses_of(source, new.shape)[...] += 1
        inside = np.argwhere(new)
        rows, columns = (line.ravel() for line in target.at)
        self.match[rows[inside[:, 0]], columns[inside[:, 1]]] = source + inside

    def _reuse_factor(self, source: Int64[np.ndarray, "2"], shape: tuple[int, ...]) -> float:
        """Factor on the cost of a block for its use so far."""
        return 1 + _REUSE_WEIGHT * float(self._uses_of(source, shape).mean()) / float(self.uses.mean())

    def _uses_of(self, source: Int64[np.ndarray, "2"], shape: tuple[int, ...]) -> Int64[np.ndarray, "p q"]:
        """Use counts of all squares of the exemplar that a block touches; a view."""
        first, last = source // _USE_SQUARE, (source + shape - 1) // _USE_SQUARE + 1
        return self.uses[first[0] : last[0], first[1] : last[1]]


@stage(version=1, check=check_block, exemplar_bytes=65, result_bytes=45)
def quilting(image: Image, params: QuiltingParams, rng: np.random.Generator) -> Stitched:
    """Quilt a texture from square blocks of the exemplar.

    Blocks are laid in scan order. Candidates are drawn from the blocks that match the already synthesised
    region best; the one with the least cost of its boundary cut and of reuse is laid. Then smaller blocks are
    laid over the most visible seams, wherever that lowers the cost of all seams. Nothing is blended: every
    pixel is copied. Blocks are compared by all maps and contain no masked pixel; see `usable`.

    Parameters
    ----------
    image : the exemplar; all channels are copied together.

    Raises
    ------
    InputError
        the exemplar is smaller than 8 x 8 px or than a block, or holds values that are not finite; its mask leaves
        no whole block; ``weights`` names a map that it lacks.

    References
    ----------
    [Efros2001]_ section 2. Blocks are equal, of about ``block`` px, so that none is cropped, with wider overlaps
    than the paper's, and are compared in CIELAB. The paper draws one block and cuts each side separately; choosing
    among several by the cost of cut and reuse is ours. One cut through all overlaps and the refinement of seams are
    those of [Kwatra2003]_ sections 3 and 4. Tileable results are not in the paper: the last blocks are also cut
    along the first ones.

    Examples
    --------
    >>> import skimage.data, texloom
    >>> made = texloom.stages.quilting(skimage.data.brick()[:64, :64], size=(64, 96), seed=3)
    >>> made.image.shape, made.match.max() < 64
    ((64, 96, 1), np.True_)
    """
    quilt = _Quilt(image, params, rng)
    quilt.fill()
    quilt.refine_seams()
    exemplar, match = quilt.exemplar.image, quilt.match
    made = exemplar.elsewhere(exemplar.pixels[match[..., 0], match[..., 1]])
    return Stitched(made.wrapping(params.tileable), match)
