"""A texture under a control map, from an exemplar whose own control map is known."""

import dataclasses
import logging
import math
from collections.abc import Mapping
from functools import partial
from typing import Annotated, Any, Literal

import numpy as np
import pydantic
from jaxtyping import Float32, UInt32
from pydantic import Field

from texloom.stages.arrays import Channels, Correspondence, Image, Jacobian
from texloom.stages.checkpoints import Checkpoints, NoCheckpoints
from texloom.stages.common.control import (
    CONTROL_WEIGHT,
    check_aspect,
    check_channels,
    check_control,
    check_finite,
    fit_scale,
    match_channels,
)
from texloom.stages.common.pyramid import MAX_ROW_VALUES, scale_sizes, scaled
from texloom.stages.common.sizes import check_patch
from texloom.stages.declare import InputError, Params, stage
from texloom.stages.sizes import Size
from texloom.stages.synthesis._kcoherence.correlation import correlation
from texloom.stages.synthesis._kcoherence.solvers import (
    Given,
    Match,
    PatchSolver,
    PixelSolver,
    Solver,
    TurnedSolver,
    nearest,
)
from texloom.stages.synthesis._patchmatch.presets import filled_in
from texloom.stages.synthesis._patchmatch.scale import Scale, improve
from texloom.stages.synthesis._patchmatch.search import Effort

_LOG = logging.getLogger(__name__)

_UNRELATED = 0.05  # share of the texture explained below which control is said to tell nothing
_DISCRETE_RATIO = 1.8  # of scales whose pixels move one by one

PRESETS: dict[str, dict[str, Any]] = {
    "default": {"ratio": 1.5, "first_iterations": 12, "last_iterations": 3, "sweeps": 4, "tolerance": 0.005},
    "fast": {"ratio": 2.0, "first_iterations": 8, "last_iterations": 2, "sweeps": 2, "tolerance": 0.02},
}


class ReconstructParams(Params):
    """How the texture is made. A preset fills in every value that is not given."""

    preset: Literal["default", "fast"] = "default"
    """`default`: as good as it gets; `fast`: fewer scales and rounds"""
    solver: Literal["optimise", "discrete"] = "optimise"
    """`optimise`: patch search and voting in turn; `discrete`: pixels move one by one to what continues their
    neighbours, quick but less whole; only this one follows ``target_jacobian``"""
    size: Size | None = None
    """height and width of the result, px; null takes those of the target or of its Jacobians"""
    control_weight: float = Field(CONTROL_WEIGHT, gt=0, le=100)
    """how much control counts: its variance, all channels together, by that of the texture. 1 lets both count
    alike, 0.25 leads gently, 10 forces; the same scale as in `control_features`"""
    patch_size: int = Field(8, ge=3, le=32)
    """side of a patch, px; of the discrete solver, of the pieces that it begins with"""
    tileable: bool = False
    """the result continues across its borders; so should the target"""
    occurrence: float = Field(20.0, ge=0, le=1e4)
    """what an exemplar patch of average use costs, CIELAB units squared a pixel; 0 lets smooth patches repeat, far
    more keeps control from asking for some places more often than for others"""
    ratio: float = Field(1.5, gt=1.0, le=4.0)
    """size of a scale relative to the one before it, at least"""
    coarsest: int = Field(32, ge=8)
    """exemplar's shorter side at the first scale, px; never below one and a half patches"""
    first_iterations: int = Field(12, ge=1, le=200)
    """rounds of search and vote at the first scale"""
    last_iterations: int = Field(3, ge=1, le=200)
    """rounds at the last scale"""
    sweeps: int = Field(4, ge=1, le=50)
    """scans of patch search a round"""
    random_tries: int = Field(6, ge=0, le=100)
    """random places tried for a patch in the first scan of a round; one fewer in each that follows"""
    tolerance: float = Field(0.005, ge=0, lt=1)
    """a scale ends early when a round changes no more than this share of the patches"""
    last_vote: Literal["copy", "mean"] = "copy"
    """`copy`: each pixel is one of the exemplar pixels that the patches over it propose, sharp; `mean`: it is their
    average, smoother and softer"""

    @property
    def matched(self) -> int:
        """Side of what has one match, px."""
        return self.patch_size if self.solver == "optimise" else 1

    @pydantic.model_validator(mode="before")
    @classmethod
    def _fill_from_preset(cls, given: Any) -> Any:
        return filled_in(given, PRESETS)


@dataclasses.dataclass(frozen=True)
class ReconstructScale:
    """The state after a scale, from which the next one goes on."""

    match: Annotated[UInt32[np.ndarray, "p q 2"], Channels(("row", "column"))]
    """top-left pixel of the exemplar patch of each patch of the result, at this scale"""
    image: Image
    """the result so far"""
    places: Annotated[Float32[np.ndarray, "p q 2"], Channels(("row", "column"))] | None
    """what ``match`` rounds, where the texture turns"""
    scales: list[dict[str, Any]]
    """the scales so far; see `Reconstructed`"""


@dataclasses.dataclass(frozen=True)
class Reconstructed:
    """The texture."""

    image: Image
    """all channels of the exemplar, copied; where the texture turns, interpolated between pixels"""
    match: Correspondence
    """the exemplar pixel under each pixel of the result, or the nearest to it"""
    tileable: bool
    """whether it wraps around"""
    correlation: float
    """share of the exemplar's variance that its control explains beyond chance, 0..1, or ``explained``; 0 without
    control"""
    notes: list[str]
    """what a person should know of the inputs; a sentence each"""
    scales: list[dict[str, Any]]
    """for each scale, coarsest first: the result's height and width, px; the rounds made; the energy a patch,
    CIELAB units squared a pixel in all planes, of it the price for occurrence; the share of patches changed in the
    last round. Of the discrete solver, the energy is that of the pixels that still chose in the last round"""


def check_sizes(params: ReconstructParams, known: Mapping[str, Any]) -> None:
    """Texture, control and target must fit each other and hold more than one patch."""
    image, control, target = (known.get(name) for name in ("image", "control", "target"))
    if image is not None:
        check_patch(image, params.patch_size)
    if image is not None and control is not None:
        check_aspect(control, "control", (image.height, image.width), "image")
    if target is not None and control is not None:
        check_channels(target, control)
    if target is not None:
        size = params.size or (target.height, target.width)
        check_aspect(target, "target", size, "size")
        if min(size) <= params.patch_size:
            raise InputError(
                f"target: a result of {size[0]}x{size[1]} px does not hold more than one patch of "
                f"{params.patch_size} px"
            )


def _plan(exemplar: tuple[int, int], result: tuple[int, int], params: ReconstructParams) -> list[Scale]:
    """The scales, coarsest first."""
    size, wrap = params.matched, params.tileable
    least = 2 * size if wrap else size + 1  # px that hold patches at every scale
    coarsest = max(params.coarsest, math.ceil(1.5 * size), math.ceil(least * min(exemplar) / min(result)))
    ratio = params.ratio if params.solver == "optimise" else max(params.ratio, _DISCRETE_RATIO)
    factors = scale_sizes(*exemplar, coarsest, ratio)
    extra = size - 1
    scales = []
    for level, factor in enumerate(factors, 1):
        way = (level - 1) / (len(factors) - 1) if len(factors) > 1 else 1.0
        sides = [scaled(side, factor) for side in exemplar]
        target = [scaled(side, factor) for side in result]
        across = [side - (0 if wrap else extra) for side in target]
        scales.append(
            Scale(
                level=level,
                factor=factor,
                exemplar=(sides[0], sides[1]),
                places=(sides[0] - extra, sides[1] - extra),
                target=(target[0], target[1]),
                patches=(across[0], across[1]),
                iterations=round(
                    params.first_iterations * (params.last_iterations / params.first_iterations) ** way
                ),
            )
        )
    return scales


@stage(version=3, check=check_sizes)
def reconstruct(
    image: Image,
    params: ReconstructParams,
    rng: np.random.Generator,
    control: Image | None = None,
    target: Image | None = None,
    start: Correspondence | None = None,
    target_jacobian: Float32[np.ndarray, "rows columns 4"] | None = None,
    explained: float | None = None,
    checkpoints: Checkpoints = NoCheckpoints(),  # noqa: B008
) -> Reconstructed:
    """Make a texture that looks like the exemplar wherever the target's control is like the exemplar's.

    With the control map of the texture that a compaction was made from as target, this reconstructs that texture;
    with any other map it makes a new one. The exemplar may be a compaction or a whole texture.

    As in texture optimisation, patch search and voting alternate from coarse to fine; patches are compared by
    texture and control together, and the control of the result is the target's at all times. In the end every
    pixel becomes that exemplar pixel, of those that the patches over it propose, whose surroundings are most like
    the mean vote; so it is a copy of all channels, and as sharp as the exemplar.

    Parameters
    ----------
    image : the exemplar; all its channels are compared, colour in CIELAB.
    control : its control map, of any number of channels; a map of another size is resampled. None for a texture
        that is the same all over: then no target is given, but ``params.size`` or ``target_jacobian``.
    target : the control map of the result, with the same channels; values beyond those of ``control`` count as its
        least or greatest.
    start : exemplar pixel of every pixel of the result, to begin with; none begins with blocks whose control fits.
    target_jacobian : how the texture is to turn in the result, as in `per_pixel`; see `compact_oriented`.
        Neighbourhoods of the result are read along it, and so is what continues a pixel's neighbours. For the
        discrete solver.
    explained : of a compaction, what control explains of the texture that it was made from; see `control_features`.
        Of so few pixels it cannot be told.

    Raises
    ------
    InputError
        the maps do not fit the exemplar or each other, a value is not finite, a patch does not fit, or
        ``target_jacobian`` is given to the other solver or has a pixel without area.
    ValueError
        ``start`` does not fit the exemplar or the result.

    References
    ----------
    [Wei2008]_ section 5, and equation 1 for neighbourhoods read along directions; [Kwatra2005]_ for the
    optimisation; [Barnes2009]_ for the search.
    """
    check_sizes(params, {"image": image, "control": control, "target": target})
    check_finite(image, "image")
    if control is not None and target is not None:
        check_control(control, "control")
        check_finite(target, "target")
        target = match_channels(target, control)
    elif control is not None or target is not None:
        raise InputError("reconstruct: control and target go together; give both or neither")
    if target_jacobian is not None and params.solver != "discrete":
        raise InputError(f"target_jacobian: only the discrete solver follows it; solver is {params.solver}")
    shape = (image.height, image.width)
    size = _size(params, target, target_jacobian)
    if start is not None and (start.shape[:2] != size or (start.max(axis=(0, 1)) >= shape).any()):
        raise ValueError(f"start of shape {start.shape[:2]} for a result of {size} from an exemplar of {shape}")
    scale = fit_scale(image, control, params.control_weight)
    if scale.planes * params.patch_size > MAX_ROW_VALUES:
        raise InputError(
            f"image and control: {scale.planes} channels do not fit patches of {params.patch_size} px; "
            f"at most {MAX_ROW_VALUES // params.patch_size} do"
        )
    found, notes = 0.0, []
    if control is not None and target is not None:
        found = correlation(image, control, scale) if explained is None else explained
        notes = _notes(found, scale.beyond(target))
    for note in notes:
        _LOG.warning(note)

    scales = _plan(shape, size, params)
    solver = _solver(Given.of(image, control, target, scale, size), scales, params, target_jacobian)
    first_random, *randoms = rng.spawn(len(scales) + 1)
    match: Match | None = None
    done: list[dict[str, Any]] = []
    first = 0
    resumed = checkpoints.latest(ReconstructScale)
    if resumed is not None:
        first, state = resumed
        held = state.match.astype(np.int32) if state.places is None else state.places
        match, done = np.ascontiguousarray(np.moveaxis(held, 2, 0)), list(state.scales)
    for level, random in list(zip(scales, randoms, strict=True))[first:]:
        if match is not None:
            match = solver.finer(match, level, level.factor / scales[level.level - 2].factor)
        elif start is not None:
            match = solver.from_pixels(start, level)
        else:
            match = solver.from_blocks(level, first_random)
        rounds = solver.rounds(match, level, random)
        done.append(improve(rounds, level, scales, params.tolerance, partial(_preview, solver, match, level)))
        if level.level < len(scales):
            state = ReconstructScale(
                nearest(match), _preview(solver, match, level), solver.places(match), list(done)
            )
            checkpoints.save(level.level, state)
    assert match is not None
    picture, source = solver.picture(match, scales[-1])
    return Reconstructed(
        image=picture,
        match=source,
        tileable=params.tileable,
        correlation=found,
        notes=notes,
        scales=done,
    )


def _solver(given: Given, scales: list[Scale], params: ReconstructParams, jacobian: Jacobian | None) -> Solver:
    """The one that the params ask for; the discrete one for a texture that turns if ``jacobian`` is given."""
    size, wrap, occurrence = params.patch_size, params.tileable, params.occurrence
    if params.solver == "optimise":
        effort = Effort(params.sweeps, params.random_tries, 0, params.tolerance)
        return PatchSolver(given, size, wrap, occurrence, effort, params.last_vote)
    if jacobian is None:
        return PixelSolver(given, size, wrap, occurrence, params.random_tries, scales)
    return TurnedSolver(given, size, wrap, occurrence, params.random_tries, scales, jacobian)


def _preview(solver: Solver, match: Match, scale: Scale) -> Image:
    return solver.picture(match, scale)[0]


def _size(params: ReconstructParams, target: Image | None, jacobian: np.ndarray | None) -> tuple[int, int]:
    """Height and width of the result."""
    if params.size is not None:
        return params.size
    if target is not None:
        return target.height, target.width
    if jacobian is None:
        raise InputError("reconstruct: without a target, size says how large the result is; it is not given")
    return jacobian.shape[0], jacobian.shape[1]


def _notes(correlation: float, beyond: float) -> list[str]:
    """Sentences on inputs that cannot give what they promise."""
    notes = []
    if correlation < _UNRELATED:
        notes.append(
            f"The control map explains {correlation:.1%} of the texture beyond chance: nothing can follow it."
        )
    if beyond > 0.01:
        notes.append(f"{beyond:.1%} of the target is beyond the control map's values and takes the nearest.")
    return notes
