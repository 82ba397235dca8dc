"""Refinement: the worst places of a texture are revised, and what is better is kept."""

import dataclasses
from collections.abc import Iterator, Mapping
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Bool, Float64
from pydantic import Field

from texloom.stages.common.similarity.patch_distance import SIDE, Places
from texloom.stages.common.source_maps.exemplar_use import use_of_exemplar
from texloom.stages.common.source_maps.source_joints import (
    NoPatchError,
    PatchRatios,
    cell_side,
    joint_contrast,
    steps_for,
    worst_of_cells,
)
from texloom.stages.synthesis.edits.region_windows import windows
from texloom.stages.synthesis.edits.revise import ReviseParams, Revision, exemplar_like
from texloom.stages.synthesis.stitching.cuts import Strips, enclosed
from texloom.stages.vocabulary.arrays import Correspondence, Image, Mask, ScalarMap, Vectors
from texloom.stages.vocabulary.color import lab_from_linear
from texloom.stages.vocabulary.declare import InputError, Outline, stage
from texloom.stages.vocabulary.facts import Wraps
from texloom.stages.vocabulary.masks import FilledExemplar
from texloom.stages.vocabulary.progress import Progress, part, report
from texloom.stages.vocabulary.sizes import format_size
from texloom.stages.vocabulary.tileable import wraps_after

_WORST = 0.1  # share of the joints whose mean is their measure, as in `metrics`
_UNALIKE = 1.0  # ratio of a joint that is as unlike the exemplar as the exemplar's patches are to each other
_MIN_RADIUS, _MAX_RADIUS = 12, 64  # px
_RADIUS = 10  # the exemplar's shorter side is this many times the default radius
_CONTEXT = 32  # px around a place, more than the reach of the largest patches
_MAX_USE = 1.01  # unevenness of the use of the exemplar, relative to that of the texture before
_MAX_UNUSED = 0.002  # of the exemplar that may become unused in all
_WIDTHS = (1.0, 1.6)  # of the squares that blocks are tried for, relative to the radius
_UNUSED = 0.1  # of even use
_STRIP = 0.3  # share of a square's side in which the cut around what replaces it lies
_GRID = 5  # px between the patches whose distance is measured
_MIN_SIDE = 4 * SIDE


class RefineParams(ReviseParams):
    """Parameters of the revisions, and their number."""

    margin: int = Field(32, ge=16, le=1024)
    """px around a place that are compared with the exemplar"""
    smooth: tuple[str, ...] = ()
    """maps that continue those of the surroundings without a step, see `gradient_domain`; `albedo` is colour. By
    default there are no such maps: what is replaced is joined along the cut of least difference"""
    rounds: int = Field(2, ge=0, le=16)
    """times that the worst places are sought; 0 changes nothing"""
    places: int = Field(8, ge=1, le=256)
    """places that are revised in a round, the worst first"""
    tries: int = Field(3, ge=1, le=32)
    """revisions of a place, and blocks for each of two squares, of which the best is kept if it is better than the
    texture"""
    radius: int | None = Field(None, ge=8, le=512)
    """of a place, px; null: a tenth of the exemplar's shorter side, between 12 and 64"""


@dataclasses.dataclass(frozen=True)
class Refined:
    """The refined texture."""

    image: Image
    """bit-identical to the texture but for the places that were improved"""
    match: Correspondence
    """source of each pixel in the exemplar"""
    changed: Mask
    """true in the places that were improved"""
    table: dict[str, Any]
    """``before`` and ``after``: joint measure of the texture, see `metrics`; ``places``: each with ``round``,
    ``row`` and ``column``, px, its joint measure ``before`` and ``after``, and whether it was ``improved``"""


def check_texture(params: RefineParams, known: Mapping[str, Any]) -> None:
    """The texture has the exemplar's channels."""
    texture, exemplar = known.get("image"), known.get("exemplar")
    if texture is None or exemplar is None:
        return
    missing = [name for name in texture.channels if name not in exemplar.channels]
    if missing:
        raise InputError(f"exemplar: lacks the channel {missing[0]} of the texture")
    if params.rounds and min(texture.height, texture.width, exemplar.height, exemplar.width) < _MIN_SIDE:
        raise InputError(f"image: its joints cannot be measured below {_MIN_SIDE} px on a side; set rounds=0")


def outlines(params: RefineParams, known: Mapping[str, Any]) -> dict[str, Outline]:  # noqa: ARG001
    """The image is as the texture."""
    texture = known.get("image")
    return {} if texture is None else {"image": Outline(texture.height, texture.width, texture.channels)}


class _Measured(NamedTuple):
    """What decides whether a place is better."""

    worst: float
    """mean ratio of the worst tenth of the joints in the place"""
    distance: float
    """mean ratio of the patches in the place"""


class _Measures:
    """The measures of textures from one exemplar.

    Parameters
    ----------
    exemplar : with the texture's channels, and perhaps `usable`.
    sides : height and width of the textures, px.
    """

    def __init__(self, exemplar: Image, sides: tuple[int, int]):
        filled = FilledExemplar.of(exemplar)
        self.valid, self.lab = filled.valid, filled.lab
        self.cell = cell_side(sides[0] * sides[1])
        self.ratios = PatchRatios(self.lab, self.valid, steps_for(min(*self.lab.shape[:2], *sides)))

    def joints(self, image: Image, match: Correspondence, wrap: Wraps) -> tuple[Places, Float64[np.ndarray, "*n"]]:
        """The joint of largest contrast in every cell that has one, and its ratio."""
        made = FilledExemplar.of(image)
        places = worst_of_cells(joint_contrast(self.lab, made.lab, match, wrap), self.cell)
        return places, self._mean_ratios(made.lab, places, made.valid, wrap)

    def of_place(
        self, image: Image, match: Correspondence, region: Bool[np.ndarray, "H W"], wrap: Wraps
    ) -> _Measured:
        """The measures of a region of a window."""
        made = FilledExemplar.of(image)
        lab, valid = made.lab, made.valid
        contrast = joint_contrast(self.lab, lab, match, wrap)
        near = _grown(region)
        contrast[~near] = -1
        joints = self._mean_ratios(lab, worst_of_cells(contrast, self.cell), valid, wrap)
        grid = np.zeros(region.shape, bool)
        grid[_GRID // 2 :: _GRID, _GRID // 2 :: _GRID] = True
        patches = self._mean_ratios(lab, np.argwhere(grid & near), valid, wrap)
        return _Measured(_worst(joints), float(patches.mean()) if len(patches) else 0.0)

    def use(self, match: Correspondence) -> Float64[np.ndarray, "2"]:
        """Relative standard deviation of a texture's use of the exemplar, and the share hardly used."""
        uses = use_of_exemplar(match, (self.lab.shape[0], self.lab.shape[1]), self.valid)
        counted = uses if self.valid is None else uses[self.valid]
        return np.array([counted.std(dtype=np.float64), (counted < _UNUSED).mean()])

    def _mean_ratios(
        self, lab: np.ndarray, places: Places, valid: Mask | None, wrap: Wraps
    ) -> Float64[np.ndarray, "*n"]:
        """Mean ratio over the scales; 0 where masked pixels are in all patches."""
        if not len(places):
            return np.zeros(0)
        ratios = self.ratios.at(lab, places, valid, wrap)
        known = np.isfinite(ratios)
        return np.asarray(np.where(known, ratios, 0).sum(axis=1) / np.maximum(known.sum(axis=1), 1))


def _worst(ratios: Float64[np.ndarray, "*n"]) -> float:
    """Mean of the worst tenth; 0 of none."""
    if not len(ratios):
        return 0.0
    return float(np.sort(ratios)[-max(1, round(_WORST * len(ratios))) :].mean())


def _grown(region: Bool[np.ndarray, "H W"]) -> Bool[np.ndarray, "H W"]:
    """The region and the pixels whose patches reach into it."""
    import cv2

    return np.asarray(cv2.dilate(region.astype(np.uint8), np.ones((SIDE, SIDE), np.uint8)) > 0)


def _chosen(
    places: Places, ratios: Float64[np.ndarray, "*n"], count: int, radius: int, done: list[np.ndarray]
) -> list[np.ndarray]:
    """Places of the largest ratios, apart from each other and from those that are ``done``."""
    chosen: list[np.ndarray] = []
    for number in np.argsort(-ratios, kind="stable"):
        if len(chosen) == count or ratios[number] <= _UNALIKE:
            break
        place = places[number]
        near = [np.abs(place - other).max() < 2 * radius for other in chosen]
        near += [np.abs(place - other).max() < radius for other in done]
        if not any(near):
            chosen.append(place)
    return chosen


def _square(place: np.ndarray, radius: int, sides: tuple[int, int], wrap: Wraps) -> Bool[np.ndarray, "H W"]:
    """The pixels within a distance of a place along both axes."""
    near = []
    for at, side, around in zip(place, sides, wrap, strict=True):
        line = np.abs(np.arange(side) - at)
        near.append((np.minimum(line, side - line) if around else line) <= radius)
    return np.asarray(near[0][:, None] & near[1][None, :])


def _joined(old: Image, new: Image, region: Bool[np.ndarray, "H W"]) -> Bool[np.ndarray, "H W"]:
    """The pixels of a square that take the new content: those inside the minimum cut between it and the old one."""
    lines = [np.flatnonzero(region.any(axis=axis)) for axis in (1, 0)]
    box = tuple(slice(int(line[0]), int(line[-1]) + 1) for line in lines)
    difference = lab_from_linear(old.color[box]) - lab_from_linear(new.color[box])
    errors = (difference**2).sum(axis=2)
    height, width = errors.shape
    # At a border of the texture, which ends the window, nothing is joined.
    rows, columns = (max(1, round(_STRIP * side)) for side in (height, width))
    strips = Strips(
        top=rows if box[0].start > 0 else 0,
        left=columns if box[1].start > 0 else 0,
        bottom=rows if box[0].stop < region.shape[0] else 0,
        right=columns if box[1].stop < region.shape[1] else 0,
    )
    taken = np.zeros(region.shape, bool)
    taken[box] = enclosed(errors, strips)[0]
    return taken


class _Refinement:
    """A texture while it is refined."""

    def __init__(
        self, image: Image, match: Correspondence, revision: Revision, measures: _Measures, params: RefineParams
    ):
        self.pixels, self.texture = image.pixels.copy(), image
        self.match = match.copy()
        self.changed = np.zeros(match.shape[:2], bool)
        self.most = measures.use(match) * [_MAX_USE, 1] + [0, _MAX_UNUSED]
        self.revision, self.measures, self.params = revision, measures, params

    @property
    def image(self) -> Image:
        """As it is now."""
        return self.texture.with_pixels(self.pixels)

    def improve(self, place: np.ndarray, radius: int, rng: np.random.Generator) -> dict[str, Any]:
        """Replace a place in several ways, keep the best one if it improves it, and tell what happened."""
        wrap, sides = self.texture.wraps, (self.match.shape[0], self.match.shape[1])
        squares = [_square(place, round(width * radius), sides, wrap) for width in _WIDTHS]
        window, largest = windows(squares[-1], max(_CONTEXT, self.params.margin), wrap)[0]
        view = self.texture.elsewhere(np.ascontiguousarray(self.pixels[window.at]))
        match = np.ascontiguousarray(self.match[window.at])
        before = best = self.measures.of_place(view, match, largest, window.wrap)
        kept, changed = (view, match), np.zeros(largest.shape, bool)
        regions = [np.ascontiguousarray(square[window.at]) for square in squares]
        for region, new, origin in self._replaced(view, match, regions, window.wrap, rng):
            taken = _joined(view, new, region)
            made = view.elsewhere(np.where(taken[..., None], new.pixels, view.pixels))
            sources = np.where(taken[..., None], origin, match)
            after = self.measures.of_place(made, sources, largest, window.wrap)
            if after.worst >= best.worst or after.distance > before.distance:
                continue
            self.match[window.at] = sources
            if (self.measures.use(self.match) <= self.most).all():
                best, kept, changed = after, (made, sources), taken
        self.pixels[window.at], self.match[window.at] = kept[0].pixels, kept[1]
        self.changed[window.at] |= changed
        return {
            "row": int(place[0]), "column": int(place[1]), "before": round(before.worst, 4),
            "after": round(best.worst, 4), "improved": best is not before,
        }  # fmt: skip

    def _replaced(
        self, view: Image, match: Correspondence, regions: list[Mask], wrap: Wraps, rng: np.random.Generator
    ) -> Iterator[tuple[Mask, Image, Correspondence]]:
        """The regions with a block of the exemplar in each, then the first of them revised, by random numbers."""
        tries = self.params.tries
        for random in rng.spawn(tries):
            for region, own in zip(regions, random.spawn(len(regions)), strict=True):
                if not region.all():
                    yield region, *self.revision.covered(view, region, match, wrap, own)
        for number, random in enumerate(rng.spawn(tries)):
            with part(number / tries, (number + 1) / tries):
                revised = self.revision.revised(view, regions[0], match, wrap, random)
            yield regions[0], *revised


@stage(version=1, check=check_texture, outlines=outlines)
def refine(
    image: Image,
    match: Correspondence,
    exemplar: Image,
    params: RefineParams,
    rng: np.random.Generator,
    guidance: ScalarMap | None = None,
    weight: float = 1.0,
    generators: Vectors | None = None,
) -> Refined:
    """Revise the worst joints of a texture, and keep what is better.

    The joints are those of `metrics`. A square about each of the worst ones, and one 1.6 times as wide, are covered
    some times with blocks of the exemplar that match their surroundings, and the square is revised some times, see
    `revise`. Of all these the one with the best joints is kept, provided that they are strictly better than before
    and that the place's patches are not farther from the exemplar. In all, the exemplar's use may become at most
    one per cent more uneven, and .2 per cent more of it unused. A round that does not improve the joints of the
    whole texture is discarded, and ends the refinement, so that it never makes them worse.

    Parameters
    ----------
    image : the texture, with the exemplar's channels.
    match : source of each pixel of the texture in the exemplar.
    exemplar : its masked pixels are never copied.
    guidance, weight, generators : of the exemplar, see `optimise`.

    Raises
    ------
    InputError
        exemplar or texture are too small, or masks leave no patch; the exemplar lacks a channel of the texture.
    ValueError
        ``match`` or ``guidance`` does not fit.

    References
    ----------
    Ours; the revisions are those of `revise`, the patches' distance is the coherence of [Simakov2008]_.

    Examples
    --------
    >>> import skimage.data, texloom
    >>> brick = skimage.data.brick()[:96, :96]
    >>> made = texloom.stages.quilting(brick, size=(128, 128))
    >>> better = texloom.stages.refine(made.image, made.match, brick, rounds=1, places=1, tries=1)
    >>> better.table["after"] <= better.table["before"]
    True
    """
    if match.shape[:2] != (image.height, image.width):
        raise ValueError(f"match of shape {match.shape} for a texture of {format_size(image)}")
    source = exemplar_like(exemplar, image)
    if (match >= (source.height, source.width)).any():
        raise ValueError(f"match points beyond the exemplar of {format_size(source)}")
    wrap = wraps_after(params.tileable, image.wraps)
    image = image.wrapping(wrap)
    table: dict[str, Any] = {"before": 0.0, "after": 0.0, "places": []}
    unchanged = Refined(image, match, np.zeros(match.shape[:2], bool), table)
    if not params.rounds:
        return unchanged
    try:
        measures = _Measures(source, (image.height, image.width))
    except NoPatchError as error:
        raise InputError(f"exemplar: {error}") from None
    revision = Revision(source, guidance, weight, generators, params)
    radius = params.radius or int(np.clip(min(source.height, source.width) // _RADIUS, _MIN_RADIUS, _MAX_RADIUS))
    refinement = _Refinement(image, match, revision, measures, params)
    places, ratios = measures.joints(image, match, wrap)
    table["before"] = value = _worst(ratios)
    done: list[np.ndarray] = []
    for turn, random in enumerate(rng.spawn(params.rounds)):
        state = (refinement.pixels.copy(), refinement.match.copy(), refinement.changed.copy())
        chosen = _chosen(places, ratios, params.places, radius, done)
        tried = []
        for number, (place, own) in enumerate(zip(chosen, random.spawn(len(chosen)), strict=True)):
            first = (turn + number / len(chosen)) / params.rounds
            with part(first, first + 1 / len(chosen) / params.rounds):
                tried.append({"round": turn + 1, **refinement.improve(place, radius, own)})
        done += chosen
        places, ratios = measures.joints(refinement.image, refinement.match, wrap)
        report(Progress((turn + 1) / params.rounds))
        improved = _worst(ratios) < value
        table["places"] += tried if improved else [{**one, "improved": False} for one in tried]
        if not improved:
            refinement.pixels, refinement.match, refinement.changed = state
            break
        value = _worst(ratios)
    table["after"] = value
    return Refined(refinement.image, refinement.match, refinement.changed, table)
