"""Texture synthesis under a control map, from an exemplar with its own control map."""

import dataclasses
import logging
import math
from collections.abc import Mapping
from typing import Annotated, Any, ClassVar, Literal

import numpy as np
import pydantic
from jaxtyping import Float32, UInt32
from pydantic import Field

from texloom.stages.common.features.control import (
    CONTROL_WEIGHT,
    check_aspect,
    check_maps,
    fit_scale,
    matched_target,
)
from texloom.stages.common.grids.pyramid import MAX_ROW_VALUES, scale_sizes, scaled
from texloom.stages.common.grids.size_checks import check_patch
from texloom.stages.synthesis.control_maps.coarse_level import Guide, TargetGuide, guides_of
from texloom.stages.synthesis.control_maps.correlation import correlation
from texloom.stages.synthesis.control_maps.known_control import notes_on_target
from texloom.stages.synthesis.optimisation.coarse_to_fine import ScaleMethod, coarse_to_fine, coarsest_side
from texloom.stages.synthesis.optimisation.match_search import Effort
from texloom.stages.synthesis.optimisation.presets import with_preset
from texloom.stages.synthesis.optimisation.scale import Rounds, Scale
from texloom.stages.synthesis.reconstruction.solvers import (
    ColorGuides,
    ControlledRepetition,
    Match,
    OrientedSolver,
    PatchSolver,
    PixelSolver,
    Solver,
    SolverInputs,
    nearest,
)
from texloom.stages.vocabulary.arrays import Channels, Correspondence, Image, Jacobian, ScalarMap, Vectors
from texloom.stages.vocabulary.checkpoints import Checkpoints, NoCheckpoints
from texloom.stages.vocabulary.declare import InputError, Params, stage
from texloom.stages.vocabulary.facts import NOWHERE
from texloom.stages.vocabulary.sizes import Size, format_size
from texloom.stages.vocabulary.tileable import Tileable

_LOG = logging.getLogger(__name__)

_MIN_CORRELATION = 0.05  # share of the texture explained, below which a note is given
_DISCRETE_RATIO = 1.8  # minimum ratio of scales of the discrete solver
_PATCHES_UP_TO = 0.5  # of full size, the scales at which the mixed solver lays patches

PRESETS: dict[str, dict[str, Any]] = {
    "default": {"ratio": 1.5, "first_iterations": 12, "last_iterations": 3, "sweeps": 4, "tolerance": 0.005},
    "fast": {"ratio": 2.0, "first_iterations": 8, "last_iterations": 2, "sweeps": 2, "tolerance": 0.02},
}


class ReconstructParams(Params):
    """Parameters of the synthesis. A preset provides every value that is not given."""

    preset: Literal["default", "fast"] = "default"
    """`default`: best quality; `fast`: fewer scales and iterations"""
    solver: Literal["optimise", "discrete", "mixed"] = "optimise"
    """`optimise`: patch search and voting alternate; `discrete`: pixels are replaced one by one by candidates that
    continue their neighbours, less coherent, but thin lines stay whole and detail sharp, and the only one that
    supports ``target_jacobian``; `mixed`: patches up to half of full size, for structure, then pixels; so does
    `discrete` where ``generators`` are given"""
    size: Size | None = None
    """size of the result, px; null: that of the target or of its Jacobians"""
    control_weight: float = Field(CONTROL_WEIGHT, gt=0, le=100)
    """variance of control, all channels together, relative to that of the texture: 1 weighs both alike, 0.25 guides
    weakly, 10 enforces; the same scale as in `control_features`"""
    patch_size: int = Field(8, ge=3, le=32)
    """side of a patch, px; with `discrete`, of the blocks of its start"""
    tileable: Tileable = NOWHERE
    """the result continues across its borders: x left to right, y top to bottom, both, off; as the target should"""
    occurrence: float = Field(0.5, ge=0, le=1e3)
    """occurrence penalty of an exemplar patch of average use, relative to the variance within such patches; 0 lets
    smooth patches repeat, 1 prefers even use to continuous detail"""
    ratio: float = Field(1.5, gt=1.0, le=4.0)
    """size of a scale relative to the one before it, at least"""
    coarsest: int = Field(32, ge=8)
    """exemplar's shorter side at the first scale, px; never below one and a half patches"""
    first_iterations: int = Field(12, ge=1, le=200)
    """iterations of search and vote at the first scale"""
    last_iterations: int = Field(3, ge=1, le=200)
    """iterations at the last scale"""
    sweeps: int = Field(4, ge=1, le=50)
    """sweeps of patch search per iteration"""
    random_tries: int = Field(6, ge=0, le=100)
    """random places tried for a patch in the first sweep of an iteration; one fewer in each that follows"""
    tolerance: float = Field(0.005, ge=0, lt=1)
    """a scale ends early when an iteration changes no more than this share of the patches"""
    last_vote: Literal["copy", "mean"] = "copy"
    """`copy`: each pixel is one of the exemplar pixels that the patches over it vote for, sharp; `mean`: it is
    their average, smoother"""

    @pydantic.model_validator(mode="before")
    @classmethod
    def _fill_from_preset(cls, values: Any) -> Any:
        return with_preset(values, PRESETS)


@dataclasses.dataclass(frozen=True)
class ReconstructScale:
    """The state after a scale, from which a run resumes."""

    match: Annotated[UInt32[np.ndarray, "p q 2"], Channels(("row", "column"))]
    """top-left pixel of the exemplar patch of each patch of the result, at this scale, in the exemplar with its
    margins if that is toroidal"""
    image: Image
    """the result so far"""
    places: Annotated[Float32[np.ndarray, "p q 2"], Channels(("row", "column"))] | None
    """``match`` before rounding, with ``target_jacobian``"""
    scales: list[dict[str, Any]]
    """the scales so far; see `Reconstructed`"""


@dataclasses.dataclass(frozen=True)
class Reconstructed:
    """The texture."""

    image: Image
    """all channels of the exemplar, copied; with ``target_jacobian`` interpolated"""
    match: Correspondence
    """source of each pixel of the result in the exemplar, rounded"""
    correlation: float
    """share of the exemplar's variance that its control explains beyond chance, 0..1, or ``explained``; 0 without
    control"""
    notes: list[str]
    """warnings about the inputs, a sentence each"""
    scales: list[dict[str, Any]]
    """for each scale, coarsest first: height and width of the result, px; number of iterations; energy per patch,
    squared CIELAB units per pixel in all planes, and the occurrence penalty in it; share of patches changed in the
    last iteration. The discrete solver's energy is that of the pixels that were updated in the last iteration"""


def check_sizes(params: ReconstructParams, known: Mapping[str, Any]) -> None:
    """Texture, control and target must fit each other and contain more than one patch."""
    image, target = known.get("image"), known.get("target")
    if image is not None:
        check_patch(image, params.patch_size)
    check_maps(known)
    if target is not None:
        size = params.size or (target.height, target.width)
        check_aspect(target, "target", size, "size")
        if min(size) <= params.patch_size:
            raise InputError(
                f"target: a result of {format_size(size)} does not hold more than one patch of "
                f"{params.patch_size} px"
            )


def _plan(
    exemplar: tuple[int, int], result: tuple[int, int], params: ReconstructParams, regular: bool
) -> list[Scale]:
    """The scales, coarsest first."""
    patches, pixels = (_scales(exemplar, result, params, whole) for whole in (True, False))
    if params.solver == "optimise":
        return patches
    if params.solver == "discrete" and not regular:
        return pixels
    coarse = [scale for scale in patches if scale.factor <= _PATCHES_UP_TO] or patches[:1]
    fine = [scale for scale in pixels if scale.factor > coarse[-1].factor]
    return [dataclasses.replace(scale, level=level) for level, scale in enumerate(coarse + fine, 1)]


def _scales(
    exemplar: tuple[int, int], result: tuple[int, int], params: ReconstructParams, patches: bool
) -> list[Scale]:
    """The scales of a solver of patches or of pixels."""
    size = params.patch_size if patches else 1  # px that have one match together
    coarsest = max(
        params.coarsest, math.ceil(1.5 * size), coarsest_side(min(exemplar), result, size, params.tileable)
    )
    ratio = params.ratio if patches else max(params.ratio, _DISCRETE_RATIO)
    factors = scale_sizes(*exemplar, coarsest, ratio)
    extra = size - 1
    lost = params.tileable.where_open(extra)
    decrease = params.last_iterations / params.first_iterations
    scales = []
    for level, factor in enumerate(factors, 1):
        progress = (level - 1) / (len(factors) - 1) if len(factors) > 1 else 1.0
        height, width, down, across = (scaled(side, factor) for side in (*exemplar, *result))
        scales.append(
            Scale(
                level=level,
                factor=factor,
                exemplar=(height, width),
                places=(height - extra, width - extra),
                target=(down, across),
                patches=(down - lost[0], across - lost[1]),
                iterations=round(params.first_iterations * decrease**progress),
            )
        )
    return scales


@stage(version=5, check=check_sizes)
def reconstruct(
    image: Image,
    params: ReconstructParams,
    rng: np.random.Generator,
    control: Image | None = None,
    target: Image | None = None,
    start: Correspondence | None = None,
    target_jacobian: Float32[np.ndarray, "rows columns 4"] | None = None,
    explained: float | None = None,
    use: ScalarMap | None = None,
    generators: Vectors | None = None,
    source: UInt32[np.ndarray, "h w 2"] | None = None,
    exemplar_guide: Guide | None = None,
    target_guide: TargetGuide | None = None,
    checkpoints: Checkpoints = NoCheckpoints(),  # noqa: B008
) -> Reconstructed:
    """Synthesise a texture that resembles the exemplar wherever the target's control resembles the exemplar's.

    With the control map of the texture that a compaction was made from as target, this reconstructs that texture;
    with any other map it synthesises a new one. The exemplar may be a compaction or a whole texture.

    As in texture optimisation, patch search and voting alternate from coarse to fine; patches are compared by
    texture and control together, and the control of the result is always the target's. Finally every pixel
    becomes the exemplar pixel, of those that the patches over it vote for, whose surroundings are most similar
    to the mean vote: a copy of all channels, as sharp as the exemplar. For other solvers see ``params``.

    Parameters
    ----------
    image : the exemplar; all its channels are compared, colour in CIELAB.
    control : its control map, of any number of channels; resampled to the exemplar's size. None for a stationary
        texture; then there is no target, but ``params.size`` or ``target_jacobian``.
    target : control map of the result, with the same channels; values outside the range of ``control`` are clipped.
        If it is smooth and ``control`` is not, ``control`` is blurred.
    start : source of every pixel of the result in the exemplar, to start from; none starts from blocks with similar
        control.
    target_jacobian : orientation of the texture in the result, as in `per_pixel`; see `compact_oriented`.
        Neighbourhoods of the result, and the continuation of neighbours, follow it. For the discrete solver.
    explained : for a compaction, share of the original texture that control explains; see `control_features`. A
        compaction has too few pixels to estimate it.
    use : for a compaction, how often each of its pixels stands for the original texture; see `compact`. Among
        places of the same control each is then used as often as in the original; none uses all evenly.
    generators : the two displacements by which a regular texture repeats, px, so that its pieces are in step under
        control; see `lattice_selection`.
    source : for a compaction, where its pixels come from in the texture that repeats by ``generators``.
    exemplar_guide, target_guide : colours of a coarse level at the exemplar's pixels, and in the result, at any
        size; see `coarse_level`. Places are then also compared by them, and values of the target are not moved
        towards those that the exemplar has more of.

    Raises
    ------
    InputError
        the maps do not fit the exemplar or each other; only one of control and target is given; there is no size; a
        value is not finite; a patch does not fit, or has too many channels; ``target_jacobian`` is given to the
        other solver or has a pixel without area.
    ValueError
        ``start`` does not fit the exemplar or the result.

    References
    ----------
    [Wei2008]_ section 5, and equation 1 for neighbourhoods read along directions; [Kwatra2005]_ for the
    optimisation; [Barnes2009]_ for the search.
    """
    target = matched_target(control, target)
    if target_jacobian is not None and params.solver != "discrete":
        raise InputError(f"target_jacobian: only the discrete solver follows it; solver is {params.solver}")
    shape = (image.height, image.width)
    size = _size(params, target, target_jacobian)
    if start is not None and (start.shape[:2] != size or (start.max(axis=(0, 1)) >= shape).any()):
        raise ValueError(f"start of shape {start.shape[:2]} for a result of {size} from an exemplar of {shape}")
    scale = fit_scale(image, control, params.control_weight)
    repetition = None
    if generators is not None and len(generators) == 2 and control is not None and target_jacobian is None:
        repetition = ControlledRepetition(generators, source, params.tileable)
    planes = scale.planes + (0 if exemplar_guide is None else exemplar_guide.shape[2])
    if planes * params.patch_size > MAX_ROW_VALUES:
        raise InputError(
            f"image and control: {planes} channels do not fit patches of {params.patch_size} px; "
            f"at most {MAX_ROW_VALUES // params.patch_size} do"
        )
    pair = guides_of(shape, exemplar_guide, target_guide)
    guides = None if pair is None else ColorGuides(*pair)
    if use is not None and use.shape != shape:
        raise ValueError(f"use of shape {use.shape} for an exemplar of {shape}")
    inputs = SolverInputs.of(image, control, target, scale, size, use, image.wraps.both, repetition, guides)
    share = 0.0
    notes: list[str] = []
    if control is not None and target is not None:
        if explained is None:
            explained = correlation(scale.of_texture(image), scale.of_control(control, *shape))
        share = explained
        if share < _MIN_CORRELATION:
            notes.append(
                f"The control map explains {share:.1%} of the texture beyond chance: nothing can follow it."
            )
        notes += notes_on_target(scale.beyond(target), inputs.rare)
    for note in notes:
        _LOG.warning(note)

    picture, source, done = solved(inputs, params, rng, start, target_jacobian, checkpoints)
    return Reconstructed(picture, source, share, notes, done)


def solved(
    inputs: SolverInputs,
    params: ReconstructParams,
    rng: np.random.Generator,
    start: Correspondence | None = None,
    jacobian: Jacobian | None = None,
    checkpoints: Checkpoints = NoCheckpoints(),  # noqa: B008
) -> tuple[Image, Correspondence, list[dict[str, Any]]]:
    """The result, where its pixels come from in the exemplar, and the scales; see `reconstruct`."""
    size = inputs.target.shape[0], inputs.target.shape[1]
    scales = _plan((inputs.image.height, inputs.image.width), size, params, inputs.regular)
    if start is not None:
        start = start + np.uint32(inputs.margin)
    solvers = _solvers(inputs, scales, params, jacobian)
    first_random, *randoms = rng.spawn(len(scales) + 1)
    method: ScaleMethod[Match, Scale] = _Reconstruction(solvers, scales, start, first_random)
    match, done = coarse_to_fine(method, scales, randoms, params.tolerance, checkpoints)
    picture, source = solvers[-1].picture(match, scales[-1])
    shape = inputs.image.height - inputs.margin * 2, inputs.image.width - inputs.margin * 2
    source = ((source.astype(np.int64) - inputs.margin) % shape).astype(np.uint32)
    return picture.wrapping(params.tileable), source, done


@dataclasses.dataclass(frozen=True)
class _Reconstruction:
    """Each scale by its solver."""

    solvers: list[Solver]
    scales: list[Scale]
    start: Correspondence | None
    random: np.random.Generator
    """for the blocks of a start"""
    saved: ClassVar = ReconstructScale

    def begun(self, scale: Scale, before: Match | None, random: np.random.Generator) -> Match:  # noqa: ARG002
        """The match with which a scale begins."""
        solver = self.solvers[scale.level - 1]
        if before is not None:
            coarser, last = self.solvers[scale.level - 2], self.scales[scale.level - 2]
            if solver is not coarser:
                before = np.moveaxis(coarser.picture(before, last)[1], 2, 0).astype(np.int32)
            return solver.finer(before, scale, scale.factor / last.factor)
        if self.start is not None:
            return solver.from_pixels(self.start, scale)
        return solver.from_blocks(scale, self.random)

    def rounds(self, match: Match, scale: Scale, random: np.random.Generator) -> Rounds:
        """Improve ``match`` in place, round by round."""
        return self.solvers[scale.level - 1].rounds(match, scale, random)

    def picture(self, match: Match, scale: Scale) -> Image:
        """The result at a scale."""
        return self.solvers[scale.level - 1].picture(match, scale)[0]

    def save(self, match: Match, scale: Scale, scales: list[dict[str, Any]]) -> ReconstructScale:
        """A checkpoint."""
        between = np.issubdtype(match.dtype, np.floating)
        places = np.ascontiguousarray(np.moveaxis(match, 0, 2)) if between else None
        return ReconstructScale(nearest(match), self.picture(match, scale), places, scales)

    def restored(self, saved: ReconstructScale) -> Match:
        """The match of a checkpoint."""
        layers = saved.match.astype(np.int32) if saved.places is None else saved.places
        return np.ascontiguousarray(np.moveaxis(layers, 2, 0))


def _solvers(
    inputs: SolverInputs, scales: list[Scale], params: ReconstructParams, jacobian: Jacobian | None
) -> list[Solver]:
    """The solver of each scale; the oriented discrete one if ``jacobian`` is given."""
    shared = (inputs, params.patch_size, params.tileable, params.occurrence)
    effort = Effort(params.sweeps, params.random_tries, 0, params.tolerance)
    patches = PatchSolver(*shared, effort, params.last_vote)
    pixels = PixelSolver(*shared, params.random_tries, scales)
    if jacobian is not None:
        pixels = OrientedSolver(*shared, params.random_tries, scales, jacobian)
    return [pixels if scale.places == scale.exemplar else patches for scale in scales]


def _size(params: ReconstructParams, target: Image | None, jacobian: np.ndarray | None) -> tuple[int, int]:
    """Height and width of the result."""
    if params.size is not None:
        return params.size
    if target is not None:
        return target.height, target.width
    if jacobian is None:
        raise InputError("reconstruct: without a target, give the size of the result")
    return jacobian.shape[0], jacobian.shape[1]
