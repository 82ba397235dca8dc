"""Image quilting: blocks of the exemplar, each cut along the line where it differs least from its neighbours."""

import dataclasses
import itertools
from collections.abc import Mapping
from typing import Any

import numpy as np
from jaxtyping import Bool, Float32, Int64
from pydantic import Field

from texloom.stages.arrays import Correspondence, Image
from texloom.stages.common.maps import check_weights
from texloom.stages.common.sizes import check_side
from texloom.stages.declare import InputError, Params, stage
from texloom.stages.progress import Progress, report
from texloom.stages.sizes import Size
from texloom.stages.synthesis._seams.cuts import Strips, enclosed
from texloom.stages.synthesis._seams.exemplar import Exemplar, Weights, lab_of
from texloom.stages.synthesis._seams.overlap import OverlapSearch, ReducedSearch, good_enough
from texloom.stages.synthesis._seams.seam_map import SeamMap, seam_errors, slopes

_LEAST = 8  # px of an exemplar's shorter side
_SQUARE = 16  # px of the squares of the exemplar whose use is counted
_REUSE = 3.0  # by how many times its cuts a block that was used as often as others counts as dearer
_APART = 2  # px between blocks that are tried
_SCALES = (2 / 3, 1 / 3)  # sides of blocks that are laid over seams, as shares of the others'
_NARROWEST = 6  # px of these
_SEARCHED = 128  # squares along a side of the exemplar among which these are looked for


class QuiltingParams(Params):
    """How large the result is, and what it is sewn from."""

    size: Size = (1024, 1024)
    """height and width of the result, px"""
    tileable: bool = False
    """the result continues across its borders"""
    block: int | None = Field(None, ge=6)
    """side of a block, px, about twice that of the largest feature; null: three eighths of the exemplar's shorter
    side, 24 at least"""
    overlap: float = Field(1 / 3, gt=0, le=1 / 3)
    """how much of a block lies over each of its neighbours, as a share of its side; 2 px at least"""
    tolerance: float = Field(0.1, ge=0, le=10)
    """blocks whose squared difference to their neighbours is at most 1 + this times the least are as likely to be
    tried; 0 tries the best alone, which varies less"""
    tries: int = Field(8, ge=1, le=256)
    """blocks that are tried, of which that with the cheapest cut and little use is laid; 1 as in the paper"""
    seam_refinement: float = Field(1.0, ge=0, le=100)
    """further blocks that are tried over the seams that show most, for each of the first; 0 as in the paper"""
    weights: Weights = Field({})
    """how much a map besides colour counts, by the name of the map or of one of its channels; 1 if not given: all
    maps together then count as much as colour"""


@dataclasses.dataclass(frozen=True)
class Quilted:
    """The texture."""

    image: Image
    """the exemplar's pixels at ``match``, all maps"""
    match: Correspondence
    """for every pixel of the result the exemplar pixel that it is"""
    tileable: bool
    """whether it wraps around"""


def _block(exemplar: Exemplar, params: QuiltingParams) -> int:
    """Side of a block; less than the default where masks leave no larger one."""
    whole = min(*exemplar.shape, max(24, 3 * min(exemplar.shape) // 8))
    smaller = [whole >> halvings for halvings in range(8) if whole >> halvings >= _LEAST]
    sides = [params.block] if params.block else smaller
    return sides[exemplar.first_that_fits(sides, "block", "block")]


def check_exemplar(params: QuiltingParams, known: Mapping[str, Any]) -> None:
    """The exemplar must hold a block."""
    image = known.get("image")
    if image is None:
        return
    check_weights(params.weights, image.channels)
    check_side(image, _LEAST)
    if params.block is not None and params.block > min(image.height, image.width):
        raise InputError(f"block: {params.block} px is more than the image has, {image.height}x{image.width} px")


def _edges(length: int, block: int, overlap: int, tileable: bool) -> list[int]:
    """Where blocks begin along a side, and where the one after the last would.

    Blocks are as many as it takes and of even size; each ends ``overlap`` px beyond the beginning of the next.
    """
    free = length if tileable else length - overlap
    count = max(2 if tileable else 1, -(-free // (block - overlap)))
    return [free * index // count for index in range(count + 1)]


@dataclasses.dataclass(frozen=True)
class _Piece:
    """A rectangle of the result over which a block is laid."""

    at: tuple[np.ndarray, ...]
    """its rows and columns"""
    strips: Strips
    """where it overlaps what stands"""
    stands: Bool[np.ndarray, "m n"]
    before: Float32[np.ndarray, "m n c"]
    """features of what stands"""
    slope: Float32[np.ndarray, "m n"]


class _Quilt:
    """A result being laid."""

    def __init__(self, image: Image, params: QuiltingParams, rng: np.random.Generator):
        self.params = params
        self.rng = rng
        self.exemplar = Exemplar(image, lab_of, 100.0, params.weights)
        self.features = self.exemplar.features
        self.slopes = slopes(self.features)
        self.size = np.array(params.size)
        self.match = np.zeros((*params.size, 2), np.uint32)
        self.uses = np.zeros([-(-side // _SQUARE) for side in self.exemplar.shape], np.int64)
        self.block = _block(self.exemplar, params)

    def lay(self) -> None:
        """Fill the result with blocks."""
        height, width = self.params.size
        # The opposite overlaps of a tileable result's last blocks must not meet.
        most = min(self.block // 3, min(height, width) // 4)
        overlap = min(max(2, round(self.block * self.params.overlap)), most)
        tileable = self.params.tileable
        rows = list(itertools.pairwise(_edges(height, self.block, overlap, tileable)))
        columns = list(itertools.pairwise(_edges(width, self.block, overlap, tileable)))
        search = OverlapSearch(self.features)
        for i, (top, bottom) in enumerate(rows):
            for j, (left, right) in enumerate(columns):
                strips = Strips(
                    top=overlap if i else 0,
                    left=overlap if j else 0,
                    bottom=overlap if tileable and i == len(rows) - 1 else 0,
                    right=overlap if tileable and j == len(columns) - 1 else 0,
                )
                sides = (bottom - top + overlap, right - left + overlap)
                piece = self._piece(np.array([top, left]), sides, strips)
                if piece.stands.any():
                    source, new = self._cheapest(piece, search)
                else:
                    source, new = self.exemplar.anywhere(*sides, self.rng), np.ones(sides, bool)
                self._put(piece, source, new)
            report(Progress((i + 1) / len(rows) / (2 if self.params.seam_refinement else 1)))

    def mend(self) -> None:
        """Lay further blocks over the seams that show most, where all seams together then show less."""
        passes = int(
            np.ceil(self.params.seam_refinement * self.size.prod() / (self.block * (1 - self.params.overlap)) ** 2)
        )
        if not passes:
            return
        sides = [min(max(_NARROWEST, round(self.block * share)), int(self.size.min()) - 1) for share in _SCALES]
        seams = SeamMap(self.features, self.slopes, self.match, self.params.tileable)
        search = ReducedSearch(self.features, _SEARCHED)
        for number in range(passes):
            side = sides[number % len(sides)]
            if seams.prices.any():
                self._cover(seams, search, seams.worst(side), side)
            report(Progress(0.5 + (number + 1) / passes / 2))

    def _piece(self, top: Int64[np.ndarray, "2"], sides: tuple[int, int], strips: Strips) -> _Piece:
        """A rectangle of the result, on its torus, from its top-left pixel on."""
        lines = (
            (first + np.arange(side)) % length for first, side, length in zip(top, sides, self.size, strict=True)
        )
        at = np.ix_(*lines)
        match = self.match[at]
        from_there = (match[..., 0], match[..., 1])
        return _Piece(at, strips, strips.mask(sides), self.features[from_there], self.slopes[from_there])

    def _cheapest(
        self, piece: _Piece, search: OverlapSearch
    ) -> tuple[Int64[np.ndarray, "2"], Bool[np.ndarray, "m n"]]:
        """Of some good places that whose cut costs least, dearer where it was used, and what is within."""
        errors = search.errors(piece.before, piece.stands)
        errors[~self.exemplar.open_places(*piece.stands.shape)] = np.inf
        enough = good_enough(errors, self.params.tolerance, search.noise(piece.before, piece.stands))
        least, best = np.inf, (np.zeros(2, np.int64), piece.stands)
        for _ in range(self.params.tries):
            left = np.flatnonzero(enough)
            if not left.size:
                break
            row, column = divmod(int(left[self.rng.integers(left.size)]), enough.shape[1])
            enough[max(0, row - _APART) : row + _APART + 1, max(0, column - _APART) : column + _APART + 1] = False
            source = np.array([row, column])
            factor = self._dearer(source, piece.stands.shape)
            new, cost = self._cut(piece, source, least / factor)
            if cost * factor < least:
                least, best = cost * factor, (source, new)
        return best

    def _cover(self, seams: SeamMap, search: ReducedSearch, top: Int64[np.ndarray, "2"], side: int) -> None:
        """Lay the block over a window that spares most, which counts less where it was used, if any does."""
        before, after = (
            np.where(beyond | self.params.tileable, side // 3, 0) for beyond in (top > 0, top + side < self.size)
        )
        piece = self._piece(top, (side, side), Strips(*(int(width) for width in (*before, *after))))
        places = search.best(
            piece.before, piece.stands, self.exemplar.open_places(side, side), self.params.tries, _APART
        )
        worth = seams.total(top, side)
        most, best = 0.0, None
        for source in places:
            factor = self._dearer(source, piece.stands.shape)
            # What is spared is no more than what the seams in the window cost, less the cut.
            new, cost = self._cut(piece, source, worth - most * factor)
            spared = -seams.dearer_by(top, new, source) / factor if cost < np.inf else 0.0
            if spared > most:
                most, best = spared, (source, new)
        if best is not None:
            self._put(piece, *best)
            seams.changed(top, side)

    def _cut(
        self, piece: _Piece, source: Int64[np.ndarray, "2"], limit: float
    ) -> tuple[Bool[np.ndarray, "m n"], float]:
        """What is within the cheapest cut of a block over ``piece``, and the cut's cost if below ``limit``."""
        height, width = piece.stands.shape
        at = (slice(source[0], source[0] + height), slice(source[1], source[1] + width))
        errors = seam_errors(self.features[at] - piece.before, self.slopes[at] + piece.slope, piece.stands)
        return enclosed(errors, piece.strips, limit)

    def _put(self, piece: _Piece, source: Int64[np.ndarray, "2"], new: Bool[np.ndarray, "m n"]) -> None:
        self._uses_of(source, new.shape)[...] += 1
        inside = np.argwhere(new)
        rows, columns = (line.ravel() for line in piece.at)
        self.match[rows[inside[:, 0]], columns[inside[:, 1]]] = source + inside

    def _dearer(self, source: Int64[np.ndarray, "2"], shape: tuple[int, ...]) -> float:
        """By how many times the cost of a block counts since it was used."""
        return 1 + _REUSE * float(self._uses_of(source, shape).mean()) / float(self.uses.mean())

    def _uses_of(self, source: Int64[np.ndarray, "2"], shape: tuple[int, ...]) -> Int64[np.ndarray, "p q"]:
        """How often each square of the exemplar that a block reaches into was laid; a view."""
        first, last = source // _SQUARE, (source + shape - 1) // _SQUARE + 1
        return self.uses[first[0] : last[0], first[1] : last[1]]


@stage(version=1, check=check_exemplar)
def quilting(image: Image, params: QuiltingParams, rng: np.random.Generator) -> Quilted:
    """Sew a texture from square blocks of the exemplar.

    Blocks are laid in scan order. Some are drawn from those that agree best with what they overlap; the one whose
    cut through the overlaps is cheapest, and which was used little, is laid within it. Then smaller blocks are laid
    over the seams that show most, wherever that makes all seams together show less. Nothing is blended: every pixel
    is one of the exemplar's. Blocks are compared by all maps and hold no masked pixel; see `usable`.

    Raises
    ------
    InputError
        the exemplar is smaller than 8x8 px or than a block, or holds values that are not finite; its mask leaves no
        whole block; there is no map that is weighed.

    References
    ----------
    [Efros2001]_ section 2. Blocks are of even size, as near to ``block`` as the result allows, and not cropped at
    its end, and wider in their overlaps than the paper's. Colours are CIELAB. The paper draws one block and cuts
    every side of it by itself, always onwards; that several are cut, and compared by what their cuts and their
    repetition show, is ours. One cut through all overlaps, and laying more over seams, are from [Kwatra2003]_
    sections 3 and 4. A tileable result is not in the paper: its last blocks overlap, and are cut along, the first
    ones too.

    Examples
    --------
    >>> import skimage.data, texloom
    >>> made = texloom.stages.quilting(skimage.data.brick()[:64, :64], size=(64, 96), seed=3)
    >>> made.image.shape, made.match.max() < 64
    ((64, 96, 1), np.True_)
    """
    check_exemplar(params, {"image": image})
    quilt = _Quilt(image, params, rng)
    quilt.lay()
    quilt.mend()
    source, match = quilt.exemplar.image, quilt.match
    return Quilted(Image(source.pixels[match[..., 0], match[..., 1]], source.channels), match, params.tileable)
