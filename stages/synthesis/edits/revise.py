"""Revision: a region of a texture is synthesised again, the rest stays as it is."""

import dataclasses
import logging
from collections.abc import Mapping
from typing import Any, ClassVar

import numpy as np
from jaxtyping import Bool, Float32, Int32
from pydantic import Field

from texloom.stages.common.grids.border_steps import fitting_borders
from texloom.stages.common.grids.size_checks import check_same_size
from texloom.stages.numerics.matrices import matrix_product
from texloom.stages.synthesis.edits.block_filling import BlockFilling
from texloom.stages.synthesis.edits.block_guide import BlockGuide
from texloom.stages.synthesis.edits.gradient_domain import GradientDomainParams, gradient_domain
from texloom.stages.synthesis.edits.region_windows import RegionWindow, windows
from texloom.stages.synthesis.edits.tracing import continued, trace
from texloom.stages.synthesis.optimisation.inputs import check_patches
from texloom.stages.synthesis.optimisation.lattice_phase import LatticePhase
from texloom.stages.synthesis.optimisation.optimise import Optimised, optimise
from texloom.stages.synthesis.optimisation.optimise_params import PRESETS, OptimiseParams
from texloom.stages.synthesis.stitching.overlap import Errors, compared
from texloom.stages.vocabulary.arrays import Correspondence, Image, Mask, ScalarMap, Vectors
from texloom.stages.vocabulary.declare import InputError, Outline, stage
from texloom.stages.vocabulary.facts import Wraps
from texloom.stages.vocabulary.masks import (
    EXCLUSION_CHANNELS,
    USABLE,
    count_excluded,
    fill_excluded,
    nearest_valid,
    tell_holes,
    valid_pixels,
    without_usable,
)
from texloom.stages.vocabulary.progress import part
from texloom.stages.vocabulary.sizes import format_size
from texloom.stages.vocabulary.tileable import wraps_after

_LOG = logging.getLogger(__name__)

_MIDDLE_GREY = 0.2140  # linear light of sRGB's 0.5
_MIN_BLOCK, _MAX_BLOCK = 16, 192  # px
_OVERLAP = 12  # px of a block around a region that fits into it
_CHOICES = 6  # places of the exemplar among which a seed chooses
_TOLERANCE = 1.5  # of the error of such a place, relative to the least
_LARGEST_STEP = 2.0  # at the region's border, in standard deviations of a map; larger ones are contours
_MAX_PHASE = 1.5  # px by which a block may be out of phase with the lattice


class ReviseParams(OptimiseParams):
    """Parameters of the optimisation, and the surroundings that it sees."""

    presets: ClassVar = {
        "default": {},
        **{name: {**PRESETS[name], "coarsest": 100} for name in ("fast", "kaspar2015")},
    }

    margin: int = Field(64, ge=16, le=1024)
    """px around the region that are compared with the exemplar; the rest of the texture is not looked at"""
    occurrence: float = Field(0.0, ge=0, le=1e4)
    """weight of spatial uniformity, see `optimise`; a revised region is small, and similarity counts more"""
    smooth: tuple[str, ...] = ("albedo", "height", "normal", "ao")
    """maps that continue those of the surroundings without a step, see `gradient_domain`; `albedo` is colour"""


@dataclasses.dataclass(frozen=True)
class Revised:
    """The revised texture."""

    image: Image
    """outside the region bit-identical to the texture"""
    keep: Mask
    """true outside the region"""
    detail: Image
    """the part of the image around the region, which the synthesis has looked at"""
    detail_keep: Bool[np.ndarray, "m n"]
    """true outside the region, in that part"""
    match: Correspondence | None
    """source of each pixel in the exemplar; None unless that of the texture was given"""


def check_sources(params: ReviseParams, known: Mapping[str, Any]) -> None:
    """The region has the texture's size and marks some of it; the exemplar has the texture's maps."""
    texture, exemplar, region = (known.get(name) for name in ("texture", "exemplar", "region"))
    check_same_size(region, "region", texture, "texture")
    if exemplar is not None:
        check_patches(params, {"image": exemplar})
    if texture is not None and exemplar is not None:
        _common_channels(texture.channels, exemplar.channels)
        if min(texture.height, texture.width) < 2 * params.patch_size:
            raise InputError(
                f"texture: {format_size(texture)} is too small for patches of {params.patch_size} px; "
                f"the minimum is {2 * params.patch_size} px"
            )
    if isinstance(region, Image):
        marked_pixels(region)


def outlines(params: ReviseParams, known: Mapping[str, Any]) -> dict[str, Outline]:  # noqa: ARG001
    """The image is as the texture."""
    texture = known.get("texture")
    return {} if texture is None else {"image": Outline(texture.height, texture.width, texture.channels)}


def marked_pixels(region: Image) -> Mask:
    """The pixels of a picture brighter than middle grey; `InputError` where it marks none or all."""
    if region.channels[0] == "Y":
        marked = region.pixels[..., 0] > _MIDDLE_GREY
    else:
        marked = matrix_product(region.color, np.array([0.2126, 0.7152, 0.0722], np.float32)) > _MIDDLE_GREY
    if not marked.any():
        raise InputError("region: no pixel is white; paint white what is to be synthesised again")
    if marked.all():
        raise InputError(
            "region: all pixels are white, so that nothing of the texture stays; run self_tuning instead"
        )
    return np.asarray(marked)


def _common_channels(texture: tuple[str, ...], exemplar: tuple[str, ...]) -> None:
    """`InputError` unless the exemplar has all maps of the texture."""
    known = {*exemplar, *("RGB" if "Y" in exemplar else ())}
    missing = [name for name in texture if name not in known and name not in EXCLUSION_CHANNELS]
    if "Y" in missing:
        raise InputError(
            "exemplar: is in colour and the texture grey; give a grey exemplar, or the texture in colour"
        )
    if missing:
        raise InputError(f"exemplar: lacks the channel {missing[0]} of the texture; it has {', '.join(exemplar)}")


def exemplar_like(exemplar: Image, texture: Image) -> Image:
    """The exemplar with the channels of the texture, and `usable` where some of it must not be copied."""
    valid = valid_pixels(exemplar)
    planes = []
    if "Y" in exemplar.channels and "R" in texture.channels:
        _LOG.warning("the exemplar is grey, taken as three equal channels, as the texture is in colour")
    for name in texture.channels:
        if name in exemplar.channels:
            planes.append(exemplar.pixels[..., exemplar.channels.index(name)])
        elif name in ("R", "G", "B"):
            planes.append(exemplar.pixels[..., exemplar.channels.index("Y")])
        else:
            planes.append(np.ones((exemplar.height, exemplar.width), np.float32))
    channels = texture.channels
    if valid is not None:
        planes.append(valid.astype(np.float32))
        channels = (*channels, USABLE)
    return exemplar.elsewhere(np.stack(planes, axis=2), channels)


class _RegionBlocks:
    """Places of blocks: random ones among those that match best and are in phase with the lattice.

    Parameters
    ----------
    start : exemplar pixel of every pixel of the target.
    keep : where the target is given; its phase is continued.
    wrap, period : of the target, see `LatticePhase`.
    block : side of a block, px.
    spread : a place costs as much as an average one where earlier blocks contain it all.
    guide : what is wanted where.
    """

    def __init__(
        self,
        generators: Vectors,
        start: Correspondence,
        keep: Mask,
        wrap: Wraps,
        period: tuple[int, int] | None,
        block: int,
        spread: bool,
        rng: np.random.Generator,
        guide: BlockGuide | None = None,
    ):
        self.guide = guide
        self.generators = generators.astype(np.float64)
        self.phase = LatticePhase(generators, start, wrap, keep, period) if len(generators) else None
        self.block, self.apart = block, max(1, block // 4)
        self.spread, self.rng = spread, rng
        self.reused: Float32[np.ndarray, "h w"] | None = None
        """the share of a block at each place that earlier blocks contain, summed over these"""

    def __call__(self, errors: Errors, corner: Int32[np.ndarray, "2"]) -> Int32[np.ndarray, "2"]:
        """The place of a block at ``corner`` of the target."""
        errors = self._in_phase(errors, corner)
        if self.guide is not None:
            self.guide.add_to(errors, corner)
        if self.reused is not None:
            errors += errors[np.isfinite(errors)].mean() * self.reused
        places: list[tuple[int, int]] = []
        limit = np.inf
        while len(places) < _CHOICES:
            row, column = divmod(int(errors.argmin()), errors.shape[1])
            error = float(errors[row, column])
            if places and not error <= limit:
                break
            limit = min(limit, _TOLERANCE * error)
            places.append((row, column))
            near = (slice(max(0, at - self.apart), at + self.apart + 1) for at in (row, column))
            errors[tuple(near)] = np.inf
        place = np.array(places[int(self.rng.integers(len(places)))], np.int32)
        if self.spread:
            self._count(place, errors.shape)
        return place

    def _count(self, place: Int32[np.ndarray, "2"], shape: tuple[int, ...]) -> None:
        """Add a block to `reused`."""
        if self.reused is None:
            self.reused = np.zeros(shape, np.float32)
        near = [
            np.arange(max(0, at - self.block), min(side, at + self.block + 1))
            for side, at in zip(shape, place, strict=True)
        ]
        down, across = (
            1 - np.abs(lines - at).astype(np.float32) / np.float32(self.block)
            for lines, at in zip(near, place, strict=True)
        )
        self.reused[np.ix_(*near)] += down[:, None] * across

    def _in_phase(self, errors: Errors, corner: Int32[np.ndarray, "2"]) -> Errors:
        """A copy of ``errors``, infinite at places out of phase; only a copy where no other place is open."""
        if self.phase is None:
            return errors.copy()
        places = np.moveaxis(np.indices(errors.shape), 0, 2)
        cells = (
            matrix_product(places, self.phase.exemplar)
            - matrix_product(corner, self.phase.target)
            - self.phase.origin
        )
        away = np.hypot(*np.moveaxis(matrix_product(cells - np.rint(cells), self.generators), 2, 0))
        limited = np.where(away <= _MAX_PHASE, errors, np.float32(np.inf))
        return limited if np.isfinite(limited).any() else errors.copy()


def _block_side(exemplar: tuple[int, int], region: Mask) -> int:
    """Side of the blocks that a region is first covered with: one block if the exemplar is twice as large, px."""
    lines = (np.flatnonzero(region.any(axis=axis)) for axis in (0, 1))
    extent = max(int(np.ptp(line)) + 1 for line in lines)
    side = min(extent + 2 * _OVERLAP, min(exemplar) // 2, _MAX_BLOCK, *region.shape)
    return int(max(2, min(side, *exemplar)))


class Revision:
    """Replaces regions of textures.

    Parameters
    ----------
    exemplar : with the channels of the textures, and perhaps `usable`.
    guidance, weight, generators : of the exemplar, see `optimise`.
    exemplar_guide : what lies where in it, see `guide`; targets then have a guide too.
    """

    def __init__(
        self,
        exemplar: Image,
        guidance: ScalarMap | None,
        weight: float,
        generators: Vectors | None,
        params: ReviseParams,
        exemplar_guide: Float32[np.ndarray, "h w k"] | None = None,
    ):
        self.exemplar = exemplar
        self.exemplar_guide = exemplar_guide
        self.usable = valid_pixels(exemplar)
        self.features = compared(fill_excluded(exemplar))
        self.guidance, self.weight = guidance, weight
        self.generators = np.zeros((0, 2), np.float32) if generators is None else generators
        self.params = params

    def revised(
        self, texture: Image, region: Mask, match: Correspondence | None, wrap: Wraps, rng: np.random.Generator
    ) -> tuple[Image, Correspondence]:
        """A texture, or window of one, with a region replaced, and the source of each pixel.

        Parameters
        ----------
        match : source of each pixel of the texture; searched where it is None.
        wrap : where the texture wraps.
        """
        keep = ~region
        tracing, placing, optimising = rng.spawn(3)
        with part(0.0, 0.1):
            start = self.start(texture, region, match, wrap, tracing, placing)
        with part(0.1, 1.0):
            made = self.optimised(texture, start, keep, wrap, optimising)
        smoothed = gradient_domain(
            self.exemplar,
            made.image,
            made.match,
            GradientDomainParams(maps=self.params.smooth, limit=_LARGEST_STEP, border_only=True),
            keep,
        )
        return smoothed.image, made.match

    def covered(
        self, texture: Image, region: Mask, match: Correspondence, wrap: Wraps, rng: np.random.Generator
    ) -> tuple[Image, Correspondence]:
        """As `revised`, but with blocks of the exemplar as they are, joined along cuts."""
        tracing, placing = rng.spawn(2)
        start = self.start(texture, region, match, wrap, tracing, placing)
        if self.usable is not None:
            start = np.moveaxis(nearest_valid(self.usable)[:, start[..., 0], start[..., 1]], 0, 2).astype(np.uint32)
        copied = without_usable(self.exemplar).pixels[start[..., 0], start[..., 1]]
        marked = region[..., None]
        return texture.elsewhere(np.where(marked, copied, texture.pixels)), np.where(marked, start, match)

    def start(
        self,
        texture: Image,
        region: Mask,
        match: Correspondence | None,
        wrap: Wraps,
        tracing: np.random.Generator,
        placing: np.random.Generator,
        filled: Mask | None = None,
        block: int | None = None,
        spread: bool = False,
        target_guide: Float32[np.ndarray, "H W k"] | None = None,
    ) -> Correspondence:
        """Sources of a texture whose region is covered with blocks, see `revised`.

        Parameters
        ----------
        filled : pixels whose content is continued, those of the region only up to where blocks are cut; None for
            those outside of the region. Needs ``match``.
        block : side of the blocks, px, which a mask may make smaller; None: by the region's size.
        spread : parts of the exemplar that blocks have shown are avoided by later ones.
        target_guide : what is wanted where, in the units of the exemplar's.
        """
        keep, shown = ~region, fill_excluded(texture)
        sides = (self.exemplar.height, self.exemplar.width)
        if match is None:
            known = trace(shown, keep, self.exemplar, self.params.patch_size, tracing)
        else:
            known = continued(match, keep if filled is None else filled, sides, 0)
        block = block or _block_side(sides, region)
        usable = np.ones(sides, bool) if self.usable is None else self.usable
        while block > _MIN_BLOCK and (count_excluded(usable, block, block) > 0).all():
            block = max(_MIN_BLOCK, block // 2)
        wanted = None
        if self.exemplar_guide is not None and target_guide is not None:
            wanted = BlockGuide(self.exemplar_guide, target_guide, block, wrap)
        filling = BlockFilling(
            self.features, known.astype(np.int32), keep, keep if filled is None else filled, usable, block, wrap,
            _RegionBlocks(self.generators, known, keep, wrap, self.params.period, block, spread, placing, wanted),
            compared(shown),
        )  # fmt: skip
        filling.run()
        return np.asarray(filling.match.astype(np.uint32))

    def optimised(
        self,
        texture: Image,
        start: Correspondence,
        keep: Mask,
        wrap: Wraps,
        rng: np.random.Generator,
        guiding: Mask | None = None,
        target_guide: Float32[np.ndarray, "H W k"] | None = None,
    ) -> Optimised:
        """The result of the optimisation that keeps the pixels of ``keep`` of a texture, see `optimise`."""
        options = {name: getattr(self.params, name) for name in OptimiseParams.model_fields} | {"tileable": wrap}
        return optimise(
            self.exemplar, start, OptimiseParams(**options), rng, self.guidance, self.weight, self.generators,
            keep, texture, None if target_guide is None else self.exemplar_guide, target_guide, guiding,
        )  # fmt: skip


@stage(version=1, check=check_sources, outlines=outlines)
def revise(
    texture: Image,
    exemplar: Image,
    region: Image,
    params: ReviseParams,
    rng: np.random.Generator,
    guidance: ScalarMap | None = None,
    weight: float = 1.0,
    generators: Vectors | None = None,
    match: Correspondence | None = None,
) -> Revised:
    """Synthesise a region of a texture again, so that it fits its surroundings, which stay bit-identical.

    Each part of the region is replaced within a window of ``margin`` px around it; the rest of the texture is not
    looked at, so that the time depends on the region's size alone. Where the window's pixels come from is searched
    in the exemplar, unless ``match`` tells. Blocks of the exemplar that fit to the surroundings and continue the
    phase of their lattice are laid over the region, and the optimisation goes on from these with the surroundings
    fixed. Another seed gives another result.

    Parameters
    ----------
    texture : with the channels of the exemplar, or some of them; synthesised by any method.
    exemplar : its masked pixels are never copied.
    region : of the texture's size; what is brighter than middle grey is synthesised again.
    guidance, weight, generators : of the exemplar, see `optimise`.
    match : source of each pixel of the texture in the exemplar.

    Raises
    ------
    InputError
        the region has another size, or marks nothing or all; the exemplar lacks a channel of the texture; the
        texture or the exemplar is too small.
    ValueError
        ``guidance`` or ``match`` does not fit.

    References
    ----------
    The optimisation is that of [Kaspar2015]_, in the window as in [Barnes2009]_, who replace regions of pictures.
    Blocks are joined as in [Kwatra2003]_, and colours as in [Perez2003]_.

    Examples
    --------
    >>> import numpy as np, skimage.data, texloom
    >>> brick = skimage.data.brick()
    >>> spot = np.zeros((96, 96), np.uint8)
    >>> spot[40:60, 40:60] = 255
    >>> texloom.stages.revise(brick[:96, :96], brick[96:224, :128], spot, preset="fast").image.shape
    (96, 96, 1)
    """
    marked = marked_pixels(region)
    if match is not None and match.shape[:2] != marked.shape:
        raise ValueError(f"match of shape {match.shape} for a texture of {format_size(texture)}")
    source = exemplar_like(exemplar, texture)
    revision = Revision(source, guidance, weight, generators, params)
    pixels = texture.pixels.copy()
    sources = None if match is None else match.copy()
    wrap = wraps_after(params.tileable, texture.wraps)
    if params.tileable is None and wrap:
        _LOG.warning("keeps tiling (%s), as the texture wraps; --set tileable=off does not", wrap)
    if params.tileable is None and not wrap:
        wrap = fitting_borders(_LOG, texture, marked)
    found = windows(marked, params.margin, wrap)
    for number, ((window, inside), random) in enumerate(zip(found, rng.spawn(len(found)), strict=True)):
        view = texture.elsewhere(np.ascontiguousarray(pixels[window.at]))
        traced = None if sources is None else np.ascontiguousarray(sources[window.at])
        with part(number / len(found), (number + 1) / len(found)):
            replaced, origin = revision.revised(view, inside, traced, window.wrap, random)
        pixels[window.at] = replaced.pixels
        if sources is not None:
            sources[window.at] = origin
    made = texture.with_pixels(pixels).wrapping(wrap)
    tell_holes(_LOG, made)
    box = _around([window for window, _ in found])
    detail = texture.elsewhere(np.ascontiguousarray(pixels[box]))
    return Revised(made, ~marked, detail, np.ascontiguousarray(~marked[box]), sources)


def _around(parts: list[RegionWindow]) -> tuple[slice, slice]:
    """The smallest rectangle that contains all windows."""
    rows, columns = (np.concatenate([getattr(one, axis) for one in parts]) for axis in ("rows", "columns"))
    return slice(int(rows.min()), int(rows.max()) + 1), slice(int(columns.min()), int(columns.max()) + 1)
