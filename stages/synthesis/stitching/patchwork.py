"""Patches of adaptive size with overlaps that are cut or resynthesised: hybrid and adaptive synthesis."""

import dataclasses
import itertools
from collections.abc import Mapping
from typing import Annotated, Any

import numpy as np
from jaxtyping import Bool, Float32, Int32, Int64
from pydantic import Field

from texloom.stages.kernels.core.elementary_functions import log2
from texloom.stages.kernels.core.loading import loaded
from texloom.stages.kernels.seams.window_state import ABSENT, FILLED, FREE, KEPT
from texloom.stages.synthesis.stitching.cuts import Strips, enclosed
from texloom.stages.synthesis.stitching.exemplar import Exemplar, StitchingParams, check_exemplar
from texloom.stages.synthesis.stitching.overlap import OverlapSearch, compared, pick
from texloom.stages.synthesis.stitching.painted_blocks import painted_blocks
from texloom.stages.synthesis.stitching.seams import SeamCosts, cheapest_cut
from texloom.stages.synthesis.stitching.similar_places import SimilarPlaces
from texloom.stages.vocabulary.arrays import Correspondence, Image
from texloom.stages.vocabulary.declare import InputError, OddSize
from texloom.stages.vocabulary.masks import nearest_valid
from texloom.stages.vocabulary.normals import with_unit_normals
from texloom.stages.vocabulary.progress import Progress, report
from texloom.stages.vocabulary.sizes import SIDES, format_size

_MIN_SIDE = 16  # px of an exemplar's shorter side
_DEFAULT_PATCH = 32  # px, at least
_MIN_OVERLAP = 3  # px
_MAX_BLEND = 16  # px over which neighbours are blended

_PatchSide = Annotated[int, Field(ge=8, le=1024)]


class PatchworkParams(StitchingParams):
    """Size of the result, patches, and the tolerances of splitting and resynthesis."""

    patch: Annotated[tuple[_PatchSide, _PatchSide], SIDES] | None = None
    """size of a patch before splits, px, as 32 or 64x32 (width x height), near that of the largest feature: larger
    ones preserve more features, but their splits fit worse; null: the largest power of two within a quarter of the
    exemplar's shorter side, at least 32 if that fits"""
    smallest: int = Field(8, ge=1)
    """patches are not split below this side, px; with 1 and `patch_tolerance` 0 every patch is a pixel"""
    overlap: float = Field(0.2, gt=0, le=0.5)
    """width of the overlap with each neighbour, as a share of a patch's side; halved by a split, at least 3 px"""
    patch_tolerance: float = Field(0.4, ge=0, le=1e4)
    """mean squared difference to the neighbours above which a patch is split, as a share of the exemplar's
    variance: 0.2 splits most patches, 0.6 few"""
    pixel_tolerance: float = Field(0.3, ge=0, le=1e4)
    """squared difference above which a pixel of an overlap is resynthesised, as a share of the exemplar's variance;
    100 resynthesises hardly any"""
    neighbourhood: OddSize = Field(5, ge=3, le=15)
    """side of the neighbourhoods that are compared to resynthesise a pixel, px"""
    similar: int = Field(5, ge=1, le=20)
    """candidates from each neighbour of such a pixel, including the neighbour's own source"""
    soften: bool = True
    """neighbours of a resynthesised pixel are averaged with the pixels beside its source"""


def patch_and_overlap(exemplar: tuple[int, int], params: PatchworkParams) -> tuple[tuple[int, int], int]:
    """Height and width of the first patches, and the width of their overlaps, px."""
    if params.patch is not None:
        return params.patch, _overlap(params.patch, params)
    side = max(_DEFAULT_PATCH, 2 ** int(log2(min(exemplar) / 4)))
    while side + 2 * _overlap((side, side), params) > min(exemplar):
        side //= 2
    return (side, side), _overlap((side, side), params)


def _overlap(sides: tuple[int, int], params: PatchworkParams) -> int:
    return max(_MIN_OVERLAP, int(np.ceil(min(sides) * params.overlap)))


def check_patch(params: PatchworkParams, known: Mapping[str, Any]) -> None:
    """The exemplar must hold a patch with its overlaps."""
    check_exemplar(params, known, _MIN_SIDE)
    image, layout = known.get("image"), known.get("layout")
    if layout is not None and (layout.height, layout.width) != params.size:
        raise InputError(f"layout: {format_size(layout)} for a result of {format_size(params.size)}")
    if image is None or layout is not None:
        return
    (height, width), overlap = patch_and_overlap((image.height, image.width), params)
    if height + 2 * overlap > image.height or width + 2 * overlap > image.width:
        raise InputError(
            f"patch: {format_size((height, width))} and overlaps of {overlap} px are more than the image has, "
            f"{format_size(image)}"
        )


@dataclasses.dataclass(frozen=True)
class _PatchRegion:
    """The pixels that a patch fills: rows ``top`` to ``bottom``, columns ``left`` to ``right``."""

    top: int
    bottom: int
    left: int
    right: int
    shape: Bool[np.ndarray, "m n"] | None = None  # the pixels of these that belong to it; None: all

    def parts(self, smallest: int) -> "list[_PatchRegion]":
        """Four quarters, or two halves where only one side can be halved; itself if none can."""
        rows, columns = (
            [first, (first + last) // 2, last] if last - first >= 2 * smallest else [first, last]
            for first, last in ((self.top, self.bottom), (self.left, self.right))
        )
        cells = []
        for down, across in itertools.product(itertools.pairwise(rows), itertools.pairwise(columns)):
            shape = self.shape
            if shape is not None:
                (top, bottom), (left, right) = down, across
                shape = shape[top - self.top : bottom - self.top, left - self.left : right - self.left]
            if shape is None or shape.any():
                cells.append(_PatchRegion(*down, *across, shape))
        return cells


@dataclasses.dataclass(frozen=True)
class _Patch:
    """A patch chosen for a cell. All planes are of the cell with its overlaps."""

    at: tuple[np.ndarray, ...]  # rows and columns in the result
    inside: Bool[np.ndarray, "m n"]  # the cell
    strips: Strips  # the overlaps
    source: tuple[slice, slice]  # rows and columns in the exemplar
    filled: Bool[np.ndarray, "m n"]  # the already synthesised region
    errors: Float32[np.ndarray, "m n"]  # squared differences, 0 outside that region
    distance: Int32[np.ndarray, "m n"]  # from the cell
    rectangular: bool

    @property
    def mean_error(self) -> float:
        return float(self.errors.sum(dtype=np.float64)) / max(1, int(self.filled.sum()))


class Patchwork:
    """The result during synthesis.

    Parameters
    ----------
    quilted_below : patches whose error is below this share of the tolerance are cut along their overlaps; overlaps
        of the others are resynthesised.
    layout : a picture of the result's size in which connected areas of a colour are the first patches.
    """

    def __init__(
        self,
        image: Image,
        params: PatchworkParams,
        quilted_below: float,
        rng: np.random.Generator,
        layout: Image | None = None,
    ):
        self.params = params
        self.layout = layout
        self.rng = rng
        self.exemplar = Exemplar(image, compared, 1.0, params.weights)
        self.source = np.ascontiguousarray(self.exemplar.image.pixels)
        self.features = self.exemplar.features
        usable = self.exemplar.usable
        known = self.features.reshape(-1, self.features.shape[2]) if usable is None else self.features[usable]
        variance = float(known.var(axis=0, dtype=np.float64).sum())
        self.patch_error, self.pixel_error = params.patch_tolerance * variance, params.pixel_tolerance * variance
        self.quilted_error = quilted_below * self.patch_error
        self.search = OverlapSearch(self.features)
        self.canvas = np.zeros((*params.size, self.features.shape[2]), np.float32)
        self.pixels = np.zeros((*params.size, self.source.shape[2]), np.float32)
        self.match = np.zeros((*params.size, 2), np.int32)
        self.valid = np.zeros(params.size, bool)
        self.patches = self.quilted = self.resynthesised = 0
        self.nearest_valid = whole_neighbourhoods(self.exemplar, params.neighbourhood)
        self._similar: SimilarPlaces | None = None

    def run(self) -> None:
        """Fill the result cell by cell."""
        if self.layout is not None:
            self._run_layout(self.layout)
            return
        sides, overlap = self._first_patch()
        rows, columns = (
            list(itertools.pairwise(_edges(length, side)))
            for length, side in zip(self.params.size, sides, strict=True)
        )
        for number, (top, bottom) in enumerate(rows):
            for left, right in columns:
                self._fill(_PatchRegion(top, bottom, left, right), overlap)
            report(Progress((number + 1) / len(rows)))

    def _run_layout(self, layout: Image) -> None:
        blocks = painted_blocks(layout)
        for number, ((rows, columns), shape) in enumerate(blocks):
            overlap = _overlap((shape.shape[0], shape.shape[1]), self.params)
            most = [side - 2 * overlap for side in self.exemplar.shape]
            if any(side > limit for side, limit in zip(shape.shape, most, strict=True)):
                raise InputError(
                    f"layout: a block of {format_size(shape.shape)} and overlaps of {overlap} px are "
                    f"more than the image has, {format_size(self.exemplar.shape)}"
                )
            self._fill(_PatchRegion(rows.start, rows.stop, columns.start, columns.stop, shape), overlap)
            report(Progress((number + 1) / len(blocks)))

    @property
    def image(self) -> Image:
        """The result, with all maps of the exemplar."""
        own = self.exemplar.image
        return own.elsewhere(with_unit_normals(self.pixels, own.channels))

    def correspondence(self) -> Correspondence:
        """For every pixel its source in the exemplar, of blended ones the one of larger weight."""
        return self.match.astype(np.uint32)

    def _first_patch(self) -> tuple[tuple[int, int], int]:
        """Sides and overlap of the first patches; smaller than the default where the mask leaves no larger one."""
        default, _ = patch_and_overlap(self.exemplar.shape, self.params)
        patches = [default]
        while self.params.patch is None and min(patches[-1]) >= 2 * max(self.params.smallest, _MIN_OVERLAP):
            patches.append((patches[-1][0] // 2, patches[-1][1] // 2))
        grown = [max(sides) + 2 * _overlap(sides, self.params) for sides in patches]
        sides = patches[self.exemplar.first_that_fits(grown, "patch", "patch")]
        return sides, _overlap(sides, self.params)

    def _fill(self, cell: _PatchRegion, overlap: int) -> None:
        patch = self._choose(cell, overlap)
        error = patch.mean_error
        parts = cell.parts(self.params.smallest) if error > self.patch_error else [cell]
        if len(parts) > 1:
            for part in parts:
                self._fill(part, max(_MIN_OVERLAP, -(-overlap // 2)))
            return
        self.patches += 1
        if error < self.quilted_error or not patch.filled.any():
            self.quilted += 1
            self._cut(patch)
        else:
            self._repair(patch, overlap)

    def _choose(self, cell: _PatchRegion, overlap: int) -> _Patch:
        """The place of the exemplar that matches the synthesised region around the cell best."""
        ndimage = loaded("scipy.ndimage")
        rows, top, bottom = self._grown(cell.top, cell.bottom, overlap, 0)
        columns, left, right = self._grown(cell.left, cell.right, overlap, 1)
        at = np.ix_(rows, columns)
        inside = np.zeros((rows.size, columns.size), bool)
        inside[top : rows.size - bottom, left : columns.size - right] = True if cell.shape is None else cell.shape
        filled = self.valid[at]
        if cell.shape is None:
            distance = chessboard(inside.shape, Strips(top, left, bottom, right))
        else:
            distance = ndimage.distance_transform_cdt(~inside, "chessboard")
            filled = filled & (distance <= overlap)
        existing = self.canvas[at]
        if filled.any():
            errors = self.search.errors(existing, filled)
            errors = np.where(self.exemplar.open_places(*filled.shape), errors, np.float32(np.inf))
            first = pick(errors, 0.0, self.search.noise(existing, filled), self.rng)
        else:
            first = self.exemplar.anywhere(*inside.shape, self.rng)
        source = (slice(first[0], first[0] + rows.size), slice(first[1], first[1] + columns.size))
        difference = ((self.features[source] - existing) ** 2).sum(axis=2)
        return _Patch(
            at=at,
            inside=inside,
            strips=Strips(top, left, bottom, right),
            source=source,
            filled=filled,
            errors=np.where(filled, difference, np.float32(0)),
            distance=distance,
            rectangular=cell.shape is None,
        )

    def _grown(self, first: int, last: int, overlap: int, axis: int) -> tuple[np.ndarray, int, int]:
        """Rows or columns of a cell and its overlaps, and the widths of the overlaps before and after."""
        length = self.params.size[axis]
        if self.params.tileable[axis]:
            overlap = min(overlap, (length - (last - first)) // 2)
            return np.arange(first - overlap, last + overlap) % length, overlap, overlap
        before, after = min(overlap, first), min(overlap, length - last)
        return np.arange(first - before, last + after), before, after

    def _put(self, patch: _Patch, weight: Float32[np.ndarray, "m n"]) -> None:
        """Blend the patch into the result; the source of a pixel is the one of larger weight."""
        share = weight[..., None]
        for canvas, source in ((self.canvas, self.features), (self.pixels, self.source)):
            existing = canvas[patch.at]
            blended = existing + share * (source[patch.source] - existing)
            canvas[patch.at] = np.where(share == 1, source[patch.source], blended)
        places = np.mgrid[patch.source].transpose(1, 2, 0)
        self.match[patch.at] = np.where(share > 0.5, places, self.match[patch.at])
        self.valid[patch.at] |= weight > 0

    def _cut(self, patch: _Patch) -> None:
        """Lay the patch inside the minimum cut through its overlaps, without blending."""
        strips, (height, width) = patch.strips, patch.filled.shape
        if not patch.rectangular:
            border = patch.distance == patch.distance[patch.filled].max(initial=0)
            state = np.where(patch.inside, FILLED, np.where(border, KEPT, FREE)).astype(np.int8)
            state[~(patch.filled | patch.inside)] = ABSENT
            places = np.mgrid[patch.source].transpose(1, 2, 0).astype(np.int32)
            costs = SeamCosts(self.features, gradients=False, squared=True)
            self._put(patch, cheapest_cut(costs, self.match[patch.at], places, state)[0].astype(np.float32))
            return
        # A side is cut where pixels beside the cell itself are filled; corners alone stay unchanged.
        across = slice(strips.left, width - strips.right)
        down = slice(strips.top, height - strips.bottom)
        top = strips.top if patch.filled[: strips.top, across].any() else 0
        left = strips.left if patch.filled[down, : strips.left].any() else 0
        bottom = strips.bottom if patch.filled[height - strips.bottom :, across].any() else 0
        right = strips.right if patch.filled[down, width - strips.right :].any() else 0
        reached = (
            slice(strips.top - top, height - strips.bottom + bottom),
            slice(strips.left - left, width - strips.right + right),
        )
        new = np.zeros((height, width), bool)
        # Cubes, so that many small differences cost less than a large one.
        errors = patch.errors[reached] * np.sqrt(patch.errors[reached])
        new[reached], _ = enclosed(errors, Strips(top, left, bottom, right))
        self._put(patch, (new & (patch.filled | patch.inside)).astype(np.float32))

    def _repair(self, patch: _Patch, overlap: int) -> None:
        """Blend the patch in where it fits, and resynthesise the pixels of the overlaps that do not."""
        fits = patch.filled & (patch.errors <= self.pixel_error)
        kept = patch.inside | fits
        rejected = patch.filled & ~kept
        self._put(patch, np.where(kept, feather(patch.distance, overlap), np.float32(0)))
        if not rejected.any():
            return
        order = dilation_order(kept, rejected)
        rows, columns = (line.ravel() for line in patch.at)
        self.valid[rows[order[:, 0]], columns[order[:, 1]]] = False
        self.resynthesised += len(order)
        self._resynthesise(np.stack([rows[order[:, 0]], columns[order[:, 1]]], axis=1))

    def _resynthesise(self, order: Int64[np.ndarray, "n 2"]) -> None:
        """Resynthesise pixels one by one from the sources of their neighbours and similar places."""
        from texloom.stages.kernels.kcoherence.coherent_pixels import CopySource, PartialResult, resynthesise

        params = self.params
        if self._similar is None:
            self._similar = SimilarPlaces(self.features, params.similar - 1)
        exemplar = CopySource(self.features, self.source, self._similar.places, self.nearest_valid)
        result = PartialResult(self.canvas, self.pixels, self.match, self.valid)
        done = 0
        while done < len(order):
            done, row, column = resynthesise(
                order, done, params.neighbourhood // 2, params.tileable, params.soften, exemplar, result
            )
            if done < len(order):
                self._similar.look_up(row, column)


def whole_neighbourhoods(exemplar: Exemplar, size: int) -> Int32[np.ndarray, "h w 2"]:
    """For each pixel the nearest one whose neighbourhood lies in the exemplar and contains no masked pixel.

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


def patchwork(
    image: Image,
    params: PatchworkParams,
    quilted_below: float,
    rng: np.random.Generator,
    layout: Image | None = None,
) -> Patchwork:
    """Synthesise a result; see `Patchwork`."""
    work = Patchwork(image, params, quilted_below, rng, layout)
    work.run()
    return work


def _edges(length: int, side: int) -> list[int]:
    """Borders of at least two equal cells along a side of the result, none longer than ``side``."""
    count = max(2, -(-length // side))
    return [length * index // count for index in range(count + 1)]


def chessboard(shape: tuple[int, int], strips: Strips) -> Int32[np.ndarray, "m n"]:
    """Distance of the pixels of a rectangle from the part between its strips."""
    distances = []
    for length, before, after in ((shape[0], strips.top, strips.bottom), (shape[1], strips.left, strips.right)):
        line = np.arange(length, dtype=np.int32)
        distances.append(np.maximum(np.maximum(before - line, line - (length - after - 1)), 0))
    return np.asarray(np.maximum(distances[0][:, None], distances[1][None, :]))


def feather(distance: Int32[np.ndarray, "m n"], overlap: int) -> Float32[np.ndarray, "m n"]:
    """Weight of a patch: 1 in the cell, falling linearly with the distance to 0 beyond the overlap.

    In wide overlaps it falls within 16 px around the middle, since wider blends lose contrast.
    """
    from_middle = distance - (overlap + 1) / 2
    return np.asarray(np.clip(0.5 - from_middle / min(overlap + 1, _MAX_BLEND), 0, 1), np.float32)


def dilation_order(kept: Bool[np.ndarray, "m n"], rejected: Bool[np.ndarray, "m n"]) -> Int64[np.ndarray, "t 2"]:
    """Rows and columns of the rejected pixels in the order in which ``kept`` dilates over them, by four neighbours.

    Each ring is in scan order; pixels that the dilation does not reach come last.
    """
    ndimage = loaded("scipy.ndimage")
    reached, remaining = kept.copy(), rejected.copy()
    rings = []
    while remaining.any():
        ring = ndimage.binary_dilation(reached) & remaining
        if not ring.any():
            ring = remaining.copy()
        rings.append(np.argwhere(ring))
        reached |= ring
        remaining &= ~ring
    return np.concatenate(rings) if rings else np.zeros((0, 2), np.int64)
