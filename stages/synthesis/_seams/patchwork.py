"""Patches of adaptive size, whose overlaps are cut or made anew pixel by pixel: hybrid synthesis and its kin."""

import dataclasses
import itertools
from collections.abc import Mapping
from typing import Any

import numpy as np
from jaxtyping import Bool, Float32, Int32, Int64
from pydantic import Field

from texloom.stages.arrays import Correspondence, Image
from texloom.stages.common.maps import check_weights
from texloom.stages.common.sizes import check_side
from texloom.stages.declare import InputError, OddSize, Params
from texloom.stages.masks import nearest_valid
from texloom.stages.normals import with_unit_normals
from texloom.stages.progress import Progress, report
from texloom.stages.sizes import Size
from texloom.stages.synthesis._seams.cuts import Strips, enclosed
from texloom.stages.synthesis._seams.exemplar import Exemplar, Weights
from texloom.stages.synthesis._seams.overlap import OverlapSearch, compared, pick
from texloom.stages.synthesis._seams.similar_places import SimilarPlaces

_LEAST = 16  # px of an exemplar's shorter side
_NARROWEST = 3  # px of an overlap after splits
_BLENDED = 16  # steps over which neighbours are blended at most


class PatchworkParams(Params):
    """How large the result is, from what patches it is made, and when they are split and repaired."""

    size: Size = (512, 512)
    """height and width of the result, px"""
    tileable: bool = False
    """the result continues across its borders"""
    patch: int | None = Field(None, ge=8, le=1024)
    """side of a patch before splits, px, near that of the largest feature: larger keeps more features whole, but
    what is split fits worse; null: the power of two within a quarter of the exemplar's shorter side, but 32 where
    that fits"""
    smallest: int = Field(8, ge=4)
    """patches are not split below this side, px"""
    overlap: float = Field(0.2, gt=0, le=0.5)
    """how far a patch reaches over its neighbours, as a share of its side; halved by a split, but not below 3 px"""
    patch_tolerance: float = Field(0.04, ge=0, le=1)
    """mean squared difference to the neighbours above which a patch is split; black and white differ by 1.
    0.02 to 0.04 suit most exemplars"""
    pixel_tolerance: float = Field(0.02, ge=0, le=1)
    """squared difference above which a pixel of an overlap is made anew; 1 makes none"""
    neighbourhood: OddSize = Field(5, ge=3, le=15)
    """side of what is compared when a pixel is made anew, px"""
    similar: int = Field(5, ge=1, le=20)
    """places that each neighbour of such a pixel proposes, its own source among them"""
    soften: bool = True
    """neighbours of a pixel made anew are averaged with what continues it"""
    weights: Weights = Field({})
    """how much a map besides colour counts, by the name of the map or of one of its channels; 1 if not given: all
    maps together then count as much as colour"""


def patch_and_overlap(exemplar: tuple[int, int], params: PatchworkParams) -> tuple[int, int]:
    """Sides of the first patches, and how far they reach over their neighbours, px."""
    side = params.patch or max(32, 2 ** int(np.log2(min(exemplar) / 4)))
    while params.patch is None and side + 2 * _reach(side, params) > min(exemplar):
        side //= 2
    return side, _reach(side, params)


def _reach(side: int, params: PatchworkParams) -> int:
    return max(_NARROWEST, int(np.ceil(side * params.overlap)))


def check_exemplar(params: PatchworkParams, known: Mapping[str, Any]) -> None:
    """The exemplar must hold a patch with its overlaps, and a neighbourhood."""
    image = known.get("image")
    if image is None:
        return
    check_weights(params.weights, image.channels)
    check_side(image, _LEAST)
    side, reach = patch_and_overlap((image.height, image.width), params)
    if side + 2 * reach > min(image.height, image.width):
        raise InputError(
            f"patch: {side} px and overlaps of {reach} px are more than the image has, "
            f"{image.height}x{image.width} px"
        )


@dataclasses.dataclass
class Tally:
    """What was done."""

    patches: int = 0
    """laid, after splits"""
    quilted: int = 0
    """of these, how many were cut along their overlaps"""
    resynthesised: int = 0
    """pixels made anew"""


@dataclasses.dataclass(frozen=True)
class _Cell:
    """The pixels that a patch fills: rows ``top`` to ``bottom``, columns ``left`` to ``right``."""

    top: int
    bottom: int
    left: int
    right: int

    @property
    def side(self) -> int:
        return min(self.bottom - self.top, self.right - self.left)

    def quarters(self) -> "list[_Cell]":
        row, column = (self.top + self.bottom) // 2, (self.left + self.right) // 2
        return [
            _Cell(*rows, *columns)
            for rows in ((self.top, row), (row, self.bottom))
            for columns in ((self.left, column), (column, self.right))
        ]


@dataclasses.dataclass(frozen=True)
class _Laid:
    """A patch chosen for a cell, with what stands around it. All planes are of the cell with its overlaps."""

    at: tuple[np.ndarray, ...]  # where it lies in the result
    inside: Bool[np.ndarray, "m n"]  # the cell
    strips: Strips  # the overlaps
    source: tuple[slice, slice]  # where it lies in the exemplar
    stands: Bool[np.ndarray, "m n"]
    errors: Float32[np.ndarray, "m n"]  # squared differences, 0 where nothing stands

    @property
    def mean_error(self) -> float:
        return float(self.errors.sum(dtype=np.float64)) / max(1, int(self.stands.sum()))


class Patchwork:
    """A result being made.

    Parameters
    ----------
    quilted_below : patches whose error is below this share of the tolerance are cut along their overlaps, the
        others repaired.
    """

    def __init__(self, image: Image, params: PatchworkParams, quilted_below: float, rng: np.random.Generator):
        self.params = params
        self.rng = rng
        self.quilted_error = quilted_below * params.patch_tolerance
        self.exemplar = Exemplar(image, compared, 1.0, params.weights)
        self.source = np.ascontiguousarray(self.exemplar.image.pixels)
        self.features = self.exemplar.features
        self.search = OverlapSearch(self.features)
        self.canvas = np.zeros((*params.size, self.features.shape[2]), np.float32)
        self.pixels = np.zeros((*params.size, self.source.shape[2]), np.float32)
        self.match = np.zeros((*params.size, 2), np.int32)
        self.valid = np.zeros(params.size, bool)
        self.tally = Tally()
        self.home = whole_neighbourhoods(self.exemplar, params.neighbourhood)
        self._similar: SimilarPlaces | None = None

    def run(self) -> None:
        """Make it whole."""
        side, overlap = self._first_patch()
        rows, columns = (list(itertools.pairwise(_edges(length, side))) for length in self.params.size)
        for number, (top, bottom) in enumerate(rows):
            for left, right in columns:
                self._fill(_Cell(top, bottom, left, right), overlap)
            report(Progress((number + 1) / len(rows)))

    @property
    def image(self) -> Image:
        """The result, with all maps of the exemplar."""
        channels = self.exemplar.image.channels
        return Image(with_unit_normals(self.pixels, channels), channels)

    def correspondence(self) -> Correspondence:
        """For every pixel the exemplar pixel that it comes from, mostly."""
        return self.match.astype(np.uint32)

    def _first_patch(self) -> tuple[int, int]:
        """Side and overlap of the first patches; less than the default where masks leave no larger one."""
        whole, _ = patch_and_overlap(self.exemplar.shape, self.params)
        sides = [whole]
        while self.params.patch is None and sides[-1] >= 2 * self.params.smallest:
            sides.append(sides[-1] // 2)
        grown = [side + 2 * _reach(side, self.params) for side in sides]
        side = sides[self.exemplar.first_that_fits(grown, "patch", "patch")]
        return side, _reach(side, self.params)

    def _fill(self, cell: _Cell, overlap: int) -> None:
        laid = self._choose(cell, overlap)
        error = laid.mean_error
        if error > self.params.patch_tolerance and cell.side >= 2 * self.params.smallest:
            for quarter in cell.quarters():
                self._fill(quarter, max(_NARROWEST, -(-overlap // 2)))
            return
        self.tally.patches += 1
        if error < self.quilted_error or not laid.stands.any():
            self.tally.quilted += 1
            self._cut(laid)
        else:
            self._repair(laid, overlap)

    def _choose(self, cell: _Cell, overlap: int) -> _Laid:
        """The place of the exemplar that agrees best with what stands around the cell."""
        rows, top, bottom = self._grown(cell.top, cell.bottom, overlap, 0)
        columns, left, right = self._grown(cell.left, cell.right, overlap, 1)
        at = np.ix_(rows, columns)
        inside = np.zeros((rows.size, columns.size), bool)
        inside[top : rows.size - bottom, left : columns.size - right] = True
        stands = self.valid[at]
        before = self.canvas[at]
        if stands.any():
            errors = self.search.errors(before, stands)
            errors = np.where(self.exemplar.open_places(*stands.shape), errors, np.float32(np.inf))
            first = pick(errors, 0.0, self.search.noise(before, stands), self.rng)
        else:
            first = self.exemplar.anywhere(*inside.shape, self.rng)
        source = (slice(first[0], first[0] + rows.size), slice(first[1], first[1] + columns.size))
        difference = ((self.features[source] - before) ** 2).sum(axis=2)
        return _Laid(
            at=at,
            inside=inside,
            strips=Strips(top, left, bottom, right),
            source=source,
            stands=stands,
            errors=np.where(stands, difference, np.float32(0)),
        )

    def _grown(self, first: int, last: int, overlap: int, axis: int) -> tuple[np.ndarray, int, int]:
        """Rows or columns from ``overlap`` before ``first`` to ``overlap`` after ``last``, and how many of each."""
        length = self.params.size[axis]
        if self.params.tileable:
            overlap = min(overlap, (length - (last - first)) // 2)
            return np.arange(first - overlap, last + overlap) % length, overlap, overlap
        before, after = min(overlap, first), min(overlap, length - last)
        return np.arange(first - before, last + after), before, after

    def _put(self, laid: _Laid, weight: Float32[np.ndarray, "m n"]) -> None:
        """Blend the patch in; a pixel comes from where the larger part of it comes from."""
        share = weight[..., None]
        for canvas, source in ((self.canvas, self.features), (self.pixels, self.source)):
            before = canvas[laid.at]
            blended = before + share * (source[laid.source] - before)
            canvas[laid.at] = np.where(share == 1, source[laid.source], blended)
        places = np.mgrid[laid.source].transpose(1, 2, 0)
        self.match[laid.at] = np.where(share > 0.5, places, self.match[laid.at])
        self.valid[laid.at] |= weight > 0

    def _cut(self, laid: _Laid) -> None:
        """Lay the patch within the cheapest cut through its overlaps; nothing is blended."""
        strips, (height, width) = laid.strips, laid.stands.shape
        # A side counts where something stands beside the cell itself; corners alone are left as they are.
        across = slice(strips.left, width - strips.right)
        down = slice(strips.top, height - strips.bottom)
        top = strips.top if laid.stands[: strips.top, across].any() else 0
        left = strips.left if laid.stands[down, : strips.left].any() else 0
        bottom = strips.bottom if laid.stands[height - strips.bottom :, across].any() else 0
        right = strips.right if laid.stands[down, width - strips.right :].any() else 0
        reached = (
            slice(strips.top - top, height - strips.bottom + bottom),
            slice(strips.left - left, width - strips.right + right),
        )
        new = np.zeros((height, width), bool)
        # Of cubes, so that a cut rather passes many small differences than one that is larger.
        errors = laid.errors[reached] * np.sqrt(laid.errors[reached])
        new[reached], _ = enclosed(errors, Strips(top, left, bottom, right))
        self._put(laid, (new & (laid.stands | laid.inside)).astype(np.float32))

    def _repair(self, laid: _Laid, overlap: int) -> None:
        """Blend the patch in where it fits, and make anew what does not."""
        fits = laid.stands & (laid.errors <= self.params.pixel_tolerance)
        kept = laid.inside | fits
        torn = laid.stands & ~kept
        self._put(laid, np.where(kept, feather(laid.stands.shape, laid.strips, overlap), np.float32(0)))
        if not torn.any():
            return
        order = dilation_order(kept, torn)
        rows, columns = (line.ravel() for line in laid.at)
        self.valid[rows[order[:, 0]], columns[order[:, 1]]] = False
        self.tally.resynthesised += len(order)
        self._make(np.stack([rows[order[:, 0]], columns[order[:, 1]]], axis=1))

    def _make(self, order: Int64[np.ndarray, "n 2"]) -> None:
        """Make pixels anew, each from where its neighbours come from."""
        from texloom.stages.kernels.kcoherence.coherent_pixels import resynthesise

        params = self.params
        if self._similar is None:
            self._similar = SimilarPlaces(self.features, params.similar - 1)
        exemplar = (self.features, self.source, self._similar.places, self.home)
        result = (self.canvas, self.pixels, self.match, self.valid)
        done = 0
        while done < len(order):
            done, row, column = resynthesise(
                order, done, params.neighbourhood // 2, params.tileable, params.soften, *exemplar, *result
            )
            if done < len(order):
                self._similar.look_up(row, column)


def whole_neighbourhoods(exemplar: Exemplar, size: int) -> Int32[np.ndarray, "h w 2"]:
    """For each pixel the nearest whose neighbourhood lies inside the exemplar and holds no masked pixel.

    Raises
    ------
    InputError
        there is none.
    """
    if exemplar.usable is None:
        lines = [np.clip(np.arange(side), size // 2, side - 1 - size // 2) for side in exemplar.shape]
        return np.stack(np.meshgrid(*lines, indexing="ij"), axis=2).astype(np.int32)
    inside = np.zeros(exemplar.shape, bool)
    places = exemplar.open_places(size, size)
    inside[size // 2 :, size // 2 :][: places.shape[0], : places.shape[1]] = places
    if not inside.any():
        raise InputError(
            f"image: its mask leaves no whole neighbourhood of {size} px; lower neighbourhood or mask less"
        )
    return np.ascontiguousarray(np.moveaxis(nearest_valid(inside), 0, 2))


def patchwork(image: Image, params: PatchworkParams, quilted_below: float, rng: np.random.Generator) -> Patchwork:
    """Check the exemplar and make a whole result; see `Patchwork`."""
    check_exemplar(params, {"image": image})
    work = Patchwork(image, params, quilted_below, rng)
    work.run()
    return work


def _edges(length: int, side: int) -> list[int]:
    """Borders of the cells along a side of the result: at least two of even size, none longer than ``side``."""
    count = max(2, -(-length // side))
    return [length * index // count for index in range(count + 1)]


def feather(shape: tuple[int, int], strips: Strips, overlap: int) -> Float32[np.ndarray, "m n"]:
    """1 in the cell, falling evenly with the steps from the cell, eight neighbours each, to what would be 0 beyond.

    In a wide overlap it falls around the middle, within 16 steps: wider blends lose contrast.
    """
    away = []
    for length, before, after in ((shape[0], strips.top, strips.bottom), (shape[1], strips.left, strips.right)):
        line = np.arange(length)
        away.append(np.maximum(np.maximum(before - line, line - (length - after - 1)), 0))
    steps = np.maximum(away[0][:, None], away[1][None, :])
    beyond = steps - (overlap + 1) / 2
    return np.asarray(np.clip(0.5 - beyond / min(overlap + 1, _BLENDED), 0, 1), np.float32)


def dilation_order(kept: Bool[np.ndarray, "m n"], torn: Bool[np.ndarray, "m n"]) -> Int64[np.ndarray, "t 2"]:
    """Rows and columns of the torn pixels as ``kept`` grows over them by direct neighbours.

    Each ring is in scan order; what growth does not reach comes last.
    """
    reached, left = kept.copy(), torn.copy()
    rings = []
    while left.any():
        near = np.zeros_like(reached)
        near[1:] |= reached[:-1]
        near[:-1] |= reached[1:]
        near[:, 1:] |= reached[:, :-1]
        near[:, :-1] |= reached[:, 1:]
        ring = near & left
        if not ring.any():
            ring = left.copy()
        rings.append(np.argwhere(ring))
        reached |= ring
        left &= ~ring
    return np.concatenate(rings) if rings else np.zeros((0, 2), np.int64)
