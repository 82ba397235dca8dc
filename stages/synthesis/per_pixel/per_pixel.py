"""Per-pixel synthesis: exemplar coordinates, each from its neighbours, in any order, from coarse to fine."""

import dataclasses
import logging
from collections.abc import Mapping
from typing import Annotated, Any, NamedTuple

import numpy as np
from jaxtyping import Bool, Float32, Int16, Int32, UInt32
from pydantic import Field

from texloom.stages.analysis.similarity.appearance_stack import AppearanceStack
from texloom.stages.common.features.control import (
    ControlScale,
    check_aspect,
    check_maps,
    fit_scale,
    matched_target,
)
from texloom.stages.common.geometry.footprints import footprints, resampled
from texloom.stages.common.geometry.jacobians import inverted
from texloom.stages.common.per_pixel.device import levels_on, on_gpu, target_on, wanted_device
from texloom.stages.common.per_pixel.levels import Levels, Rect, Style
from texloom.stages.common.per_pixel.phases import phases_of
from texloom.stages.common.per_pixel.tables import CONTROLS, Tables, make_tables
from texloom.stages.common.regularity.phase_planes import phase_planes
from texloom.stages.common.similarity.appearance import blurred_levels
from texloom.stages.kernels.core.elementary_functions import log2
from texloom.stages.synthesis.control_maps.coarse_level import Guide, TargetGuide, guides_of
from texloom.stages.synthesis.control_maps.comparable_control import comparable
from texloom.stages.synthesis.control_maps.known_control import notes_on_target
from texloom.stages.synthesis.per_pixel.coarse_colours import with_coarse_colours
from texloom.stages.vocabulary.arrays import Channels, Correspondence, Image, Jacobian, Vectors
from texloom.stages.vocabulary.declare import InputError, Outline, Params, stage
from texloom.stages.vocabulary.facts import NOWHERE, Wraps
from texloom.stages.vocabulary.normals import NORMAL, turned, with_unit_normals
from texloom.stages.vocabulary.sizes import Size, format_size, size_value
from texloom.stages.vocabulary.tileable import Tileable

_LOG = logging.getLogger(__name__)

_MAX_ORIGIN = 2**30  # px of the endless texture
_PASSES = (2, 2, 4)  # of correction, finest level first
_COHERENCE_BONUS = 28  # / 256 that each neighbour that agrees takes off the squared distance
_TRIES = 64  # of places for a piece under control
_BLOCK = 6  # px; side of the pieces of the coarsest level
_MAX_STEP = 0.25  # of the coarsest level, as a share of the shortest repetition of distorted texture
_DISTORTED_BLOCK = 10  # of those that continue beyond the region
_REGULAR_BLOCK = 256  # of those that continue without a break
_REGULAR = 0.08  # squared distance of similar neighbourhoods, as a share of that of random ones


class ArrangementParams(Params):
    """How pieces of the exemplar are rearranged; what `Canvas` and `per_pixel` share."""

    jitter: float = Field(0.25, ge=0, le=1)
    """how far pixels are displaced at random before a level is corrected, in steps of the level for the coarsest
    and ever less for finer ones; more breaks repetition and large structures, 0 leaves only the start to chance"""
    block: int | None = Field(None, ge=1, le=256)
    """side of the pieces of the exemplar that the coarsest level starts from, px of that level; larger ones keep
    larger structures whole and repeat more. null: 6, of distorted exemplars 10, or 256 if they are regular and
    have no control"""
    coherence: float = Field(1.0, ge=0, le=1.1)
    """how strongly a candidate is preferred on which several neighbours agree; 0 gives softer seams, and smooth
    places spread"""
    control_weight: float = Field(1.0, gt=0, le=100)
    """variance of control relative to that of the neighbourhoods; 0.3 guides weakly, 10 enforces. Above 1 the
    preference for candidates on which neighbours agree is reduced too"""
    tolerance: float = Field(0.04, ge=0, le=1)
    """deviation from the wanted control that counts as none, as a share of the control's range"""


def style_of(params: ArrangementParams, levels: int, seed: int) -> Style:
    """The params of each of so many levels, and the key of random numbers.

    Parameters
    ----------
    seed : any whole number; its lowest 64 bits count.
    """
    return Style(
        key=seed % 2**64,
        jitter=tuple(params.jitter * level / max(1, levels - 1) for level in range(levels)),
        passes=tuple(_PASSES[min(level, len(_PASSES) - 1)] for level in range(levels)),
        block=params.block or _BLOCK,
        tries=_TRIES,
        coherence_bonus=round(params.coherence * _COHERENCE_BONUS),
        control_bonus=round(params.coherence * _COHERENCE_BONUS / max(1.0, params.control_weight)),
        tolerance=params.tolerance,
    )


def prepare(
    image: Image, stack: AppearanceStack, control: Image | None, jacobian: Jacobian | None, weight: float
) -> tuple[Tables, ControlScale | None]:
    """The exemplar's tables, and how control becomes numbers.

    Raises
    ------
    InputError : control with more planes than can be held.
    ValueError : inputs that do not belong together.
    """
    scale, own = fitted_control(image, control)
    return tables_with(image, stack, own, jacobian, weight), scale


def fitted_control(
    image: Image, control: Image | None, linear: bool = False
) -> tuple[ControlScale | None, Float32[np.ndarray, "h w k"] | None]:
    """How control becomes numbers, and those of the exemplar, 0..1; ``linear`` as in `fit_scale`."""
    if control is None:
        return None, None
    scale = fit_scale(image, control, 1.0, linear)
    if len(scale.control) > CONTROLS:
        raise InputError(f"control: {len(scale.control)} channels that vary are more than {CONTROLS}")
    return scale, scale.of_control(control, image.height, image.width) / np.float32(scale.strength)


def tables_with(
    image: Image,
    stack: AppearanceStack,
    own: Float32[np.ndarray, "h w k"] | None,
    jacobian: Jacobian | None,
    weight: float,
) -> Tables:
    """The exemplar's tables, with its control."""
    levels, height, width = stack.appearance.shape[:3]
    if (height, width) != (image.height, image.width):
        raise ValueError(f"analysis of {format_size((height, width))} for an image of {format_size(image)}")
    planes = None if own is None else blurred_levels(own, levels, stack.toroidal)
    return make_tables(stack.appearance, stack.basis, stack.candidates, stack.toroidal, planes, weight, jacobian)


_OriginSide = Annotated[int, Field(ge=-_MAX_ORIGIN, le=_MAX_ORIGIN)]


class PerPixelParams(ArrangementParams):
    """How large the result is, and how it is arranged."""

    size: Size | None = None
    """size of the result, px; null takes that of the target, of what is fixed or of its Jacobians, or
    512x512 where there are none"""
    tileable: Tileable = NOWHERE
    """the result continues across its borders: x left to right, y top to bottom, both, off; so should the target.
    Its sides must be whole multiples of twice the step of the coarsest level, along x, y or both"""
    origin: tuple[_OriginSide, _OriginSide] = (0, 0)
    """row and column, px, of the result's first pixel in an endless texture: results with the same seed and other
    origins fit together exactly; [0, 0] where the result is tileable"""
    extent: Size | None = None
    """size, px, that the target covers from [0, 0], where the result is only a window of that; null:
    the result's"""


@dataclasses.dataclass(frozen=True)
class PerPixel:
    """The texture."""

    image: Image
    """the exemplar's pixels at ``match``, all channels; where texture is distorted, means under the footprints of
    the result's pixels, whose normals turn with it"""
    match: Correspondence
    """for every pixel of the result the exemplar pixel that it is"""
    positions: Annotated[Float32[np.ndarray, "H W 2"], Channels(("row", "column"))] | None
    """rows and columns in a distorted exemplar, in fractions of a px; null where nothing is distorted"""
    notes: list[str]
    """warnings about the inputs, a sentence each"""


def _size(params: PerPixelParams, target: Any, field: np.ndarray | None = None) -> tuple[int, int]:
    if params.size is not None:
        return params.size
    if target is not None:
        return target.height, target.width
    return (512, 512) if field is None else (field.shape[0], field.shape[1])


def check_sources(params: PerPixelParams, known: Mapping[str, Any]) -> None:
    """Control and target must fit the exemplar, each other, and the result; a requested GPU must exist.

    A tileable result must have whole pixels at every level, as soon as the number of levels is known.
    """
    if wanted_device() == "gpu":
        on_gpu(None)
    check_maps(known)
    target = known.get("target")
    if target is not None:
        name = "extent" if params.extent else "size"
        check_aspect(target, "target", params.extent or _size(params, target), name)
    if params.tileable and params.origin != (0, 0):
        raise InputError(f"origin: {list(params.origin)} for a tileable result, which begins at [0, 0]")
    appearance = known.get("appearance")
    if params.tileable and isinstance(appearance, Outline) and (params.size is not None or target is not None):
        check_divisible(_size(params, target), appearance.levels, params.tileable)


@stage(version=4, check=check_sources)
def per_pixel(
    image: Image,
    appearance: Annotated[Int16[np.ndarray, "levels h w 8"], Channels(tuple(f"c{n}" for n in range(8)))],
    basis: Int16[np.ndarray, "levels 64 8"],
    candidates: Int32[np.ndarray, "levels h w k"],
    toroidal: bool,
    params: PerPixelParams,
    rng: np.random.Generator,
    control: Image | None = None,
    target: Image | None = None,
    jacobian: Jacobian | None = None,
    target_jacobian: Float32[np.ndarray, "rows columns 4"] | None = None,
    fixed: Bool[np.ndarray, "H W"] | None = None,
    fixed_match: UInt32[np.ndarray, "H W 2"] | None = None,
    generators: Vectors | None = None,
    chart: Float32[np.ndarray, "h w 2"] | None = None,
    target_chart: Float32[np.ndarray, "H W 2"] | None = None,
    source: UInt32[np.ndarray, "h w 2"] | None = None,
    exemplar_guide: Guide | None = None,
    target_guide: TargetGuide | None = None,
) -> PerPixel:
    """Make a texture of exemplar coordinates, every pixel from the 3x3 pixels around it.

    The coarsest level is covered with square pieces of the exemplar. Each level that follows takes over coordinates
    from the one before it, four children a pixel, displaces them a little at random, and corrects them in a few
    passes: a pixel's neighbours predict the places that continue theirs, and those that continue similar ones, and
    it takes the one whose neighbourhood is most similar to the pixel's own. So a pixel depends on
    the seed, its position and its neighbours alone, and any window of an endless texture can be made by itself.

    Under control, neighbourhoods are compared together with the control at their place, which must be like the
    target's. Distorted textures differ in one thing only: an offset between pixels is carried from the result to
    the texture and from there to the exemplar by the Jacobians.

    Parameters
    ----------
    image : the exemplar; all channels are copied.
    appearance, basis, candidates, toroidal : its analysis, see `appearance_stack`.
    control : the exemplar's control map, of any number of channels up to 8 and of any size of its aspect ratio.
    target : the control map of the result, with the same channels; beyond it the texture goes on as at its border.
        If it is smooth and ``control`` is not, ``control`` is blurred.
    jacobian : how the texture is distorted in the exemplar; the one that the analysis was made with.
    target_jacobian : how it is to be distorted in the result.
    fixed : pixels of the result that stay as ``fixed_match`` says.
    fixed_match : exemplar pixels, of those that are fixed.
    generators : the two displacements by which the texture repeats, px of flat texture, if it does; see
        `lattice_selection`. Pieces of the coarsest level are then laid in step; of a distorted exemplar that is the
        coarsest whose step is a quarter of a repetition or less.
    chart : where in the flat texture pixels of a distorted exemplar are, see `unroll`; needed with ``generators``.
    target_chart : the same of the result's pixels, if that is distorted; without it pieces are not in step there.
    source : for a compaction, where its pixels come from in the texture that repeats by ``generators``.
    exemplar_guide, target_guide : under control, colours of a coarse level at the exemplar's pixels, and in the
        result, at any size; see `coarse_level`. Places are then also compared by them, as by planes of control.

    Raises
    ------
    InputError
        the maps do not fit the exemplar or each other, a value is not finite, a tileable result has sides that its
        levels do not divide, or ``target_jacobian`` has a pixel without area.
    ValueError
        inputs that do not belong together.

    References
    ----------
    [LefebvreHoppe2005]_ sections 3 and 4: upsampling, jitter, correction in sub-passes, windows;
    [LefebvreHoppe2006]_ section 3, appearance vectors, and section 5, distorted results; [Wei2008]_ section 5,
    control as channels that are read only; [Eisenacher2008]_ section 3.3, distorted exemplars, and the level of
    the exemplar that suits each pixel. Unlike there, the appearances of all eight neighbours are compared, each
    where it stands; a candidate on which several neighbours agree is preferred; and the coarsest level starts from
    pieces of the exemplar.
    """
    target = matched_target(control, target)
    if (fixed is None) != (fixed_match is None):
        raise ValueError("fixed and fixed_match: one is missing")
    size = _size(params, target, target_jacobian if fixed is None else fixed)
    if jacobian is None and target_jacobian is not None:
        jacobian = flat((image.height, image.width))
    guides = guides_of((image.height, image.width), exemplar_guide, target_guide)
    compared = _compared(image, control, target, toroidal, params, size, guides)
    for note in compared.notes:
        _LOG.warning(note)
    stack = AppearanceStack(appearance, basis, candidates, toroidal)
    repetition = None
    if generators is not None and len(generators) and (target_jacobian is None or target_chart is not None):
        if jacobian is None:
            repetition, compared = _in_step(generators, source, compared, params.tileable)
        elif chart is None:
            raise ValueError("chart: missing, though the exemplar is distorted and repeats")
        else:
            repetition, stack = _ExemplarPeriod(generators, chart), _showing(stack, generators)
    tables = tables_with(image, stack, compared.own, jacobian, compared.weight)
    levels = _levels(params, tables, size, int(rng.integers(2**63)), repetition is not None)
    if jacobian is not None:
        levels.bend(_bent(target_jacobian))
    if repetition is not None:
        phases = phases_of(repetition.generators, tables.shape, tables.margin, repetition.chart)
        levels.repeat(phases, target_chart)
    if fixed is not None and fixed_match is not None:
        levels.pin(fixed, _fixed_places(tables, fixed, fixed_match))
    if compared.wanted is not None:
        target_on(levels, compared.wanted)
    levels.run()
    rows, columns = tables.pixels_of(levels.finest())
    match = np.stack([rows, columns], axis=2).astype(np.uint32)
    if jacobian is None:
        positions = None
        # for rows this short several times as fast as indexing
        pixels = image.pixels.reshape(-1, len(image.channels)).take(rows * np.int32(image.width) + columns, axis=0)
    else:
        positions = np.stack(levels.positions(), axis=2)
        pixels = _means(image, jacobian, positions, _bent(target_jacobian), params.origin)
    return PerPixel(image.elsewhere(pixels).wrapping(params.tileable), match, positions, compared.notes)


@dataclasses.dataclass(frozen=True)
class _Compared:
    """Planes that are compared together with neighbourhoods, 0..1; None without control."""

    own: Float32[np.ndarray, "h w k"] | None
    """of the exemplar"""
    wanted: Float32[np.ndarray, "H W k"] | None
    """of the result"""
    weight: float
    """variance relative to that of the neighbourhoods"""
    notes: list[str]
    """warnings about the target, a sentence each"""


def _compared(
    image: Image,
    control: Image | None,
    target: Image | None,
    toroidal: bool,
    params: PerPixelParams,
    size: tuple[int, int],
    guides: tuple[Guide, TargetGuide] | None,
) -> _Compared:
    """Control of the exemplar and of a result of ``size`` px, made comparable."""
    scale, own = fitted_control(image, control)
    if target is None or scale is None or own is None:
        return _Compared(None, None, params.control_weight, [])
    wanted = scale.of_control(target, *(params.extent or size)) / np.float32(scale.strength)
    own, _, wanted, rare = comparable(own, wanted, 1.0, toroidal, evenly=guides is None)
    weight = params.control_weight
    if guides is not None:
        own, wanted, weight = with_coarse_colours(own, wanted, weight, image, guides)
    return _Compared(own, wanted, weight, notes_on_target(scale.beyond(target), rare))


class _ExemplarPeriod(NamedTuple):
    """By what the texture repeats, and where in it the exemplar's pixels are."""

    generators: Vectors
    chart: Float32[np.ndarray, "h w 2"] | None
    """px of flat texture; None if that is the exemplar"""


def _in_step(
    generators: Vectors, source: UInt32[np.ndarray, "h w 2"] | None, compared: _Compared, wrap: Wraps
) -> tuple[_ExemplarPeriod | None, _Compared]:
    """The repetition of flat texture; under control compared too, or None if control repeats differently."""
    own, wanted = compared.own, compared.wanted
    if own is None or wanted is None:
        return _ExemplarPeriod(generators, None if source is None else source.astype(np.float32)), compared
    phases = phase_planes(generators, source, own, wanted, wrap)
    if phases is None:
        return None, compared
    if own.shape[2] + phases.own.shape[2] <= CONTROLS:
        own, wanted = phases.after(own, wanted)
        weight = 2 * compared.weight  # that of control remains
        compared = dataclasses.replace(compared, own=own, wanted=wanted, weight=weight)
    return _ExemplarPeriod(generators, phases.places), compared


def _showing(stack: AppearanceStack, generators: Vectors) -> AppearanceStack:
    """The levels that show a repetition; corrections of coarser ones would lose the phase."""
    most = 1 + max(0, int(log2(np.hypot(*generators.T).min() * _MAX_STEP)))
    return AppearanceStack(stack.appearance[:most], stack.basis[:most], stack.candidates[:most], stack.toroidal)


def _fixed_places(
    tables: Tables, fixed: Bool[np.ndarray, "H W"], match: UInt32[np.ndarray, "H W 2"]
) -> Int32[np.ndarray, "H W"]:
    """The places of exemplar pixels; those of ``fixed`` pixels must exist."""
    if (match[fixed] >= tables.shape).any():
        raise ValueError(f"fixed_match goes beyond an exemplar of {tables.shape}")
    return tables.places_of(*np.moveaxis(match.astype(np.int64), 2, 0))


def _means(
    image: Image,
    jacobian: Jacobian,
    positions: Float32[np.ndarray, "H W 2"],
    target: Float32[np.ndarray, "rows columns 4"],
    origin: tuple[int, int],
) -> Float32[np.ndarray, "H W c"]:
    """The exemplar's means under the footprints of the result's pixels."""
    places = positions.reshape(-1, 2).astype(np.float64)
    near = np.ix_(
        *(
            np.clip(np.arange(side) + first, 0, last - 1)
            for side, first, last in zip(positions.shape[:2], origin, target.shape[:2], strict=True)
        )
    )
    size = positions.shape[:2]
    feet = footprints(jacobian, places, target[near].reshape(-1, 4))
    usable = np.ones(jacobian.shape[:2], np.bool_)
    pixels = resampled(image.pixels, usable, places, feet).reshape(*size, -1)
    if set(NORMAL) <= set(image.channels):
        to_result = inverted(feet.reshape(*size, 4)).astype(np.float32)
        pixels = with_unit_normals(turned(pixels, image.channels, to_result), image.channels)
    return pixels


def _continues(tables: Tables) -> bool:
    """Whether an exemplar is regular: neighbourhoods of the coarsest level recur elsewhere almost as they are."""
    own = np.arange(tables.places)
    values, candidates = tables.values[-tables.places :, :8], tables.candidates[-tables.places :]
    whole = own[candidates[:, 0] == own]
    if candidates.shape[1] < 2:
        return False
    similar = np.square(values[whole].astype(np.float64) - values[candidates[whole, 1]]).sum(axis=1).mean()
    return bool(similar < _REGULAR * 2 * values[whole].astype(np.float64).var(axis=0).sum())


def _levels(params: PerPixelParams, tables: Tables, size: tuple[int, int], seed: int, repeats: bool) -> Levels:
    """The levels of a result; a distorted exemplar has larger pieces.

    Those of one that is regular but not in step go on without a break, unless control chooses them.
    """
    if params.tileable:
        check_divisible(size, tables.levels, params.tileable)
    if tables.jacobian is not None and params.block is None:
        whole = not repeats and not tables.strengths and _continues(tables)
        params = params.model_copy(update={"block": _REGULAR_BLOCK if whole else _DISTORTED_BLOCK})
    row, column = params.origin
    window = Rect(row, row + size[0], column, column + size[1])
    return levels_on(None, tables, style_of(params, tables.levels, seed), window, params.tileable)


def _bent(jacobian: Jacobian | None) -> Jacobian:
    """That of the result, which must have an area everywhere; flat if there is none."""
    field = flat((1, 1)) if jacobian is None else jacobian
    if not (np.abs(field[..., 0] * field[..., 3] - field[..., 1] * field[..., 2]) > 0).all():
        raise InputError("target_jacobian: a pixel has no area")
    return field


def flat(shape: tuple[int, int]) -> Jacobian:
    """The Jacobian of a texture that is not distorted."""
    return np.broadcast_to(np.array([1, 0, 0, 1], np.float32), (*shape, 4))


def check_divisible(size: tuple[int, int], levels: int, wrap: Wraps) -> None:
    """`InputError` where a result of ``size`` px that wraps has no whole, even number of pixels at every level."""
    unit = 2**levels
    near = [
        max(unit, round(side / unit) * unit) if around else side for side, around in zip(size, wrap, strict=True)
    ]
    if any(side % unit for side, around in zip(size, wrap, strict=True) if around):
        raise InputError(
            f"size: {format_size(size)} cannot be tileable with {levels} levels, which takes multiples of "
            f"{unit}; {size_value(near)} can"
        )
