"""Patch-based sampling: square patches in scan order that match their neighbours, blended where they overlap."""

import dataclasses
from collections.abc import Mapping
from typing import Any

import numpy as np
from pydantic import Field

from texloom.stages.synthesis.stitching.boundaries import Boundaries, zone_mask
from texloom.stages.synthesis.stitching.exemplar import Exemplar, Stitched, StitchingParams, check_exemplar, lab_of
from texloom.stages.vocabulary.arrays import Image
from texloom.stages.vocabulary.declare import InputError, stage
from texloom.stages.vocabulary.facts import NOWHERE
from texloom.stages.vocabulary.normals import with_unit_normals
from texloom.stages.vocabulary.progress import Progress, report
from texloom.stages.vocabulary.sizes import format_size
from texloom.stages.vocabulary.tileable import Tileable

_CANDIDATES = 64  # nearest places that patches are drawn from
_MIN_PATCH = 8  # px


class PatchBasedParams(StitchingParams):
    """Size of the result, patches and their choice."""

    tileable: Tileable = NOWHERE
    """the result continues across its borders; patches are then a little smaller, so that they fill it evenly"""
    patch: int | None = Field(None, ge=_MIN_PATCH, le=1024)
    """side of a patch, px, a little more than the texture's elements; null: a quarter of the exemplar's shorter
    side"""
    zone: int | None = Field(None, ge=1)
    """width of the boundary zone in which neighbours overlap, px, at most half a patch; null: a sixth of it"""
    blend: int = Field(8, ge=1)
    """width of the band in the middle of the zone across which neighbours are blended, px, at most the zone: wider
    bands lose contrast, narrower ones show differences"""
    tolerance: float = Field(0.2, ge=0, le=1)
    """maximum distance of a patch to its neighbours in the boundary zone, relative to the zone's root mean square
    colour; 0 takes the best patch, 0.2 is the paper's"""
    variance: float = Field(0.97, gt=0, le=1)
    """share of the boundary zones' variance that the index keeps"""
    slack: float = Field(0.5, ge=0, le=10)
    """relative error allowed in the approximate nearest neighbour search; 0 is exact"""


@dataclasses.dataclass(frozen=True)
class _PatchRow:
    """Patches along one axis."""

    starts: np.ndarray
    side: int
    """of a patch, px"""
    length: int
    """of the canvas, px"""


def _sides(shape: tuple[int, int], params: PatchBasedParams) -> tuple[int, int]:
    """Side of a patch and width of its boundary zone."""
    patch = params.patch or max(_MIN_PATCH, min(shape) // 4)
    patch = min(patch, *params.size)
    return patch, params.zone or max(1, patch // 6)


def check_sides(params: PatchBasedParams, known: Mapping[str, Any]) -> None:
    """A patch must fit into the exemplar, and its boundary zones into a patch."""
    check_exemplar(params, known, _MIN_PATCH)
    image = known.get("image")
    if image is not None:
        shape = (image.height, image.width)
        patch, zone = _sides(shape, params)
        if patch > min(shape):
            raise InputError(f"patch: {patch} px does not fit into an exemplar of {format_size(shape)}")
        if 2 * zone > patch:
            raise InputError(f"zone: {zone} px is more than half a patch, {patch} px")


def _layout(length: int, patch: int, zone: int, wraps: bool) -> _PatchRow:
    """As many patches as cover ``length`` px, each overlapping the one before by ``zone`` or more."""
    if wraps:
        # Steps differ by at most 1 px; the last is the longest, after which the zone shared with the first begins.
        count = max(2, -(-length // (patch - zone)))
        starts = np.arange(count) * length // count
        return _PatchRow(starts, length - int(starts[-1]) + zone, length)
    count = max(1, -(-(length - zone) // (patch - zone)))
    starts = np.arange(count) * (patch - zone)
    return _PatchRow(starts, patch, int(starts[-1]) + patch)


class _Sampler:
    """The exemplar and the canvas that is filled from it."""

    def __init__(self, image: Image, params: PatchBasedParams, rng: np.random.Generator):
        self.params = params
        self.rng = rng
        self.exemplar = Exemplar(image, lab_of, 100.0, params.weights)
        self.pixels = self.exemplar.image.pixels
        self.features = self.exemplar.features
        patch, self.zone = self._largest_that_fits()
        self.layouts = [
            _layout(length, patch, self.zone, wraps)
            for length, wraps in zip(params.size, params.tileable, strict=True)
        ]
        self.sides = (self.layouts[0].side, self.layouts[1].side)
        canvas = tuple(layout.length for layout in self.layouts)
        self.result = np.zeros((*canvas, self.pixels.shape[2]), np.float32)
        self.placed = np.zeros((*canvas, self.features.shape[2]), np.float32)  # the result's features
        self.match = np.zeros((*canvas, 2), np.uint32)
        self.indices: dict[tuple[tuple[bool, bool], tuple[bool, bool]], Boundaries] = {}

    def _largest_that_fits(self) -> tuple[int, int]:
        """Side of a patch and width of its zone; smaller than the default where the mask leaves no larger one."""
        patch, zone = _sides(self.exemplar.shape, self.params)
        sides = [patch]
        while not self.params.patch and sides[-1] // 2 >= max(_MIN_PATCH, 2 * (self.params.zone or 1)):
            sides.append(sides[-1] // 2)
        side = sides[self.exemplar.first_that_fits(sides, "patch", "patch")]
        return side, zone if side == patch else self.params.zone or max(1, side // 6)

    def run(self) -> None:
        rows, columns = (layout.starts for layout in self.layouts)
        for i, row in enumerate(rows):
            for j, column in enumerate(columns):
                last = (i + 1 == len(rows), j + 1 == len(columns))
                after = (self.params.tileable.down and last[0], self.params.tileable.across and last[1])
                self._place((int(row), int(column)), (i > 0, j > 0), after)
            report(Progress((i + 1) / len(rows)))

    def _place(self, corner: tuple[int, int], before: tuple[bool, bool], after: tuple[bool, bool]) -> None:
        lines = [
            (start + np.arange(layout.side)) % layout.length
            for start, layout in zip(corner, self.layouts, strict=True)
        ]
        into = np.ix_(*lines)
        source = self._choose(self.placed[into], before, after)
        cut = (slice(source[0], source[0] + self.sides[0]), slice(source[1], source[1] + self.sides[1]))

        ramps = [self._ramp(axis, before[axis], after[axis]) for axis in (0, 1)]
        weight = np.minimum(ramps[0][:, None], ramps[1])[..., None]
        for canvas, exemplar in ((self.result, self.pixels), (self.placed, self.features)):
            old = canvas[into]
            canvas[into] = np.where(weight == 1, exemplar[cut], old + weight * (exemplar[cut] - old))
        places = np.stack(np.meshgrid(*(np.arange(s.start, s.stop) for s in cut), indexing="ij"), axis=-1)
        self.match[into] = np.where(weight >= 0.5, places, self.match[into])

    def _choose(self, window: np.ndarray, before: tuple[bool, bool], after: tuple[bool, bool]) -> np.ndarray:
        """Top-left pixel of a random patch that matches ``window`` within the tolerance, else of the best."""
        if not any(before + after):
            return np.asarray(self.exemplar.anywhere(*self.sides, self.rng))
        key = (before, after)
        if key not in self.indices:
            mask = zone_mask(self.sides, self.zone, before, after)
            places = self.exemplar.open_places(*self.sides)
            self.indices[key] = Boundaries.of(self.features, places, mask, self.zone, self.params.variance)
        index = self.indices[key]
        places = index.nearest(window, _CANDIDATES, self.params.slack)
        distances = index.distances(window, places)
        limit = self.params.tolerance * float(np.sqrt((window[index.mask] ** 2).sum(axis=1).mean()))
        order = np.argsort(distances, kind="stable")
        good = _spread(places[order][distances[order] <= limit], self.zone)
        place = good[self.rng.integers(len(good))] if len(good) else places[order[0]]
        return self._refined(index, window, place)

    def _refined(self, index: Boundaries, window: np.ndarray, place: np.ndarray) -> np.ndarray:
        """The best place around ``place`` that a strided index omits."""
        if index.stride == 1:
            return place
        steps = np.arange(1 - index.stride, index.stride)
        around = place + np.stack(np.meshgrid(steps, steps, indexing="ij"), axis=-1).reshape(-1, 2)
        room = np.array(self.features.shape[:2]) - self.sides
        around = around[((around >= 0) & (around <= room)).all(axis=1)]
        around = around[self.exemplar.open_places(*self.sides)[tuple(around.T)]]
        return np.asarray(around[index.distances(window, around).argmin()])

    def _ramp(self, axis: int, before: bool, after: bool) -> np.ndarray:
        """Weight of a new patch along one axis: from 0 at its border to 1 where the zone ends."""
        ramp = np.ones(self.sides[axis], np.float32)
        from_middle = np.arange(self.zone, dtype=np.float32) + np.float32(0.5 - self.zone / 2)
        rising = np.clip(from_middle / np.float32(min(self.params.blend, self.zone)) + np.float32(0.5), 0, 1)
        if before:
            ramp[: self.zone] = rising
        if after:
            ramp[ramp.size - self.zone :] = rising[::-1]
        return ramp


def _spread(places: np.ndarray, min_separation: int) -> np.ndarray:
    """Subset of ``places``, best first, at least ``min_separation`` px apart."""
    kept: list[np.ndarray] = []
    for place in places:
        if all(np.abs(place - other).max() >= min_separation for other in kept):
            kept.append(place)
    return np.array(kept)


@stage(version=1, check=check_sides, exemplar_bytes=45, result_bytes=45)
def patch_based(image: Image, params: PatchBasedParams, rng: np.random.Generator) -> Stitched:
    """Lay square patches of the exemplar in scan order and blend them where they overlap.

    Every patch is drawn from those whose boundary zone is similar to the already synthesised region, found by
    approximate nearest neighbours among principal components. Neighbours are blended linearly across the middle of
    the zone in all maps; normals keep unit length. Zones are compared by all maps, and patches contain no masked
    pixel; see `usable`.

    Parameters
    ----------
    image : the exemplar; all channels are copied together.

    Raises
    ------
    InputError
        a patch does not fit into the exemplar, or the boundary zone is more than half a patch; the exemplar holds
        values that are not finite, or its mask leaves no whole patch; ``weights`` names a map that it lacks.

    References
    ----------
    [Liang2001]_; [Lin2004]_ section 2.3. The paper compares RGB, draws from all patches within the tolerance and
    blends across the whole zone, which blurs wide ones. We compare CIELAB and draw from the nearest 64, of which
    only one in a zone's width counts. The search is that of [Arya1998]_ on SciPy's tree, without the paper's
    quadtree.
    """
    sampler = _Sampler(image, params, rng)
    sampler.run()
    height, width = params.size
    own = sampler.exemplar.image
    pixels = np.ascontiguousarray(sampler.result[:height, :width])
    result = own.elsewhere(with_unit_normals(pixels, own.channels))
    return Stitched(result.wrapping(params.tileable), np.ascontiguousarray(sampler.match[:height, :width]))
