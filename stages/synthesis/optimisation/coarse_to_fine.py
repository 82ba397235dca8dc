"""The loop of patch optimisation from coarse to fine: parameters, scales, start, checkpoints.

A method supplies what it optimises at a scale; see `ScaleMethod`.
"""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from typing import Any, ClassVar, Generic, Protocol, TypeAlias, TypeVar, runtime_checkable

import numpy as np
import pydantic
from jaxtyping import Int32
from pydantic import Field

from texloom.stages.common.features.maps import MapWeights
from texloom.stages.common.grids.pyramid import scale_sizes, scaled
from texloom.stages.synthesis.optimisation import correspondence
from texloom.stages.synthesis.optimisation.allowed import Allowed, allowed_at_scales
from texloom.stages.synthesis.optimisation.correspondence import Patches
from texloom.stages.synthesis.optimisation.match_search import Effort
from texloom.stages.synthesis.optimisation.presets import with_preset
from texloom.stages.synthesis.optimisation.scale import Rounds, Scale, improve_all
from texloom.stages.vocabulary.arrays import Correspondence, Image
from texloom.stages.vocabulary.checkpoints import Checkpoints
from texloom.stages.vocabulary.declare import Params
from texloom.stages.vocabulary.facts import NOWHERE, Wraps
from texloom.stages.vocabulary.masks import valid_pixels
from texloom.stages.vocabulary.tileable import Tileable

CoarserPatches: TypeAlias = Int32[np.ndarray, "2 coarser_p coarser_q"]

_FILL_TRIES = 6  # little used places tried for a patch
_FILL_SHARE = 0.4  # of the scales, coarsest first, at which they are


@dataclass(frozen=True)
class Schedule:
    """What a preset decides besides parameters."""

    coarse_sweeps: int
    """sweeps of patch search per iteration in the coarser half of the scales"""
    fine_sweeps: int
    """the same in the finer half"""
    coarse_tries: int
    """random places tried for a patch in a sweep, as `Effort` says"""
    fine_tries: int = 0
    """the same at the scales after those of ``coarse_share``"""
    coarse_share: float = 1.0
    """share of the scales, coarsest first, at which ``coarse_tries`` places are tried"""
    distance_per_try: float = 0.0
    """see `Effort`; at the scales of ``fine_tries``"""
    narrow: bool = False
    """see `Effort`"""
    fewer_iterations: float | None = None
    """decrease from scale to scale, of ten scales; none decreases to the last scale's number"""
    final_sigma: float | None = 1.0
    """standard deviation of the Gaussian weights of a patch's votes in the last vote, px; none weighs all alike"""


class CoarseToFineParams(Params):
    """Scales and search. A preset replaces some defaults; explicit values override it."""

    presets: ClassVar[Mapping[str, Mapping[str, Any]]]
    """values that differ from the fields' defaults"""
    schedules: ClassVar[Mapping[str, Schedule]]

    preset: str
    patch_size: int = Field(10, ge=3, le=32)
    """side of a patch, px"""
    tileable: Tileable | None
    ratio: float = Field(1.3, gt=1.0, le=4.0)
    """size of a scale relative to the one before it, at least"""
    coarsest: int = Field(35, ge=8)
    """exemplar's shorter side at the first scale, px; never below one and a half patches"""
    first_iterations: int = Field(24, ge=1, le=200)
    """iterations of search and vote at the first scale"""
    last_iterations: int = Field(6, ge=1, le=200)
    """the same at the last scale, and at least at others"""
    tolerance: float = Field(0.002, ge=0, lt=1)
    """a scale ends early when an iteration changes no more than this share of the patches"""
    weights: MapWeights = Field({})

    @pydantic.model_validator(mode="before")
    @classmethod
    def _fill_from_preset(cls, values: Any) -> Any:
        return with_preset(values, cls.presets)

    @property
    def schedule(self) -> Schedule:
        """That of the preset."""
        return self.schedules[self.preset]

    @property
    def beyond(self) -> tuple[int, int]:
        """What is synthesised above and below the result, left and right of it, and cropped, px."""
        return (self.tileable or NOWHERE).where_open(self.patch_size - 1)


@dataclass(frozen=True)
class PatchScale(Scale):
    """A scale of patch search. The target has a margin of `patch_size` - 1 px where it is not tileable."""

    count: int
    """of all scales"""
    growth: float
    """of sides, relative to the scale before"""
    effort: Effort
    allowed: Allowed | None
    """exemplar patches without masked pixels; none for all"""

    @property
    def cost(self) -> float:
        """Relative amount of work."""
        return super().cost * self.effort.sweeps

    @property
    def progress(self) -> float:
        """0 at the coarsest scale, 1 at full size."""
        return _progress(self.level, self.count)

    def within(self, share: float) -> bool:
        """Whether it is among that share of the scales, coarsest first."""
        return self.level <= round(share * self.count)


def _progress(level: int, count: int) -> float:
    return (level - 1) / (count - 1) if count > 1 else 1.0


def full_size(start: Correspondence, margin: tuple[int, int]) -> tuple[int, int]:
    """Height and width of the result with its margin."""
    height, width = (side + 2 * beyond for side, beyond in zip(start.shape[:2], margin, strict=True))
    return height, width


def coarsest_side(exemplar: int, full: tuple[int, int], patch_size: int, wraps: Wraps) -> int:
    """The exemplar's shorter side at least, px, so that a target of ``full`` size holds patches at its scale.

    ``exemplar`` is that side at full size.
    """
    return max(
        math.ceil((2 * patch_size if around else patch_size + 1) * exemplar / side)
        for side, around in zip(full, wraps, strict=True)
    )


def patch_scales(
    image: Image, start: Correspondence, params: CoarseToFineParams, fill: bool = False, least: int = 0
) -> list[PatchScale]:
    """The scales, coarsest first. Coarse ones with too few unmasked patches are omitted.

    Parameters
    ----------
    fill : little used places are tried at the coarse scales.
    least : exemplar's shorter side at the first scale, px.

    Raises
    ------
    InputError : no patch of the exemplar is without masked pixels.
    """
    size, margin, schedule = params.patch_size, params.beyond, params.schedule
    exemplar, full = (image.height, image.width), full_size(start, margin)
    holding = coarsest_side(min(exemplar), full, size, params.tileable or NOWHERE)
    coarsest = max(params.coarsest, math.ceil(1.5 * size), min(least, *exemplar), holding)
    factors = scale_sizes(*exemplar, coarsest, params.ratio)
    alloweds = allowed_at_scales(valid_pixels(image), exemplar, factors, size)
    factors = factors[-len(alloweds) :]
    count = len(factors)
    fewer = params.first_iterations - params.last_iterations
    # The schedule is for ten scales and is stretched to other numbers.
    decrease = fewer if schedule.fewer_iterations is None else schedule.fewer_iterations * 9
    scales = []
    for level, (factor, before) in enumerate(zip(factors, [1.0, *factors], strict=False), 1):
        sides, target = ([scaled(side, factor) for side in whole] for whole in (exemplar, full))
        fine = level > round(schedule.coarse_share * count)
        effort = Effort(
            sweeps=schedule.coarse_sweeps if level <= count / 2 else schedule.fine_sweeps,
            tries=schedule.fine_tries if fine else schedule.coarse_tries,
            fill_tries=_FILL_TRIES if fill and level <= round(_FILL_SHARE * count) else 0,
            tolerance=params.tolerance,
            narrow=schedule.narrow,
            distance_per_try=schedule.distance_per_try if fine else 0.0,
        )
        iterations = round(params.first_iterations - decrease * _progress(level, count))
        scales.append(
            PatchScale(
                level=level,
                factor=factor,
                exemplar=(sides[0], sides[1]),
                places=(sides[0] - size + 1, sides[1] - size + 1),
                target=(target[0], target[1]),
                patches=(target[0] - margin[0], target[1] - margin[1]),
                iterations=max(params.last_iterations, iterations),
                count=count,
                growth=factor / before,
                effort=effort,
                allowed=alloweds[level - 1],
            )
        )
    return scales


def match_at(
    scale: PatchScale, before: CoarserPatches | None, start: Correspondence, params: CoarseToFineParams
) -> Patches:
    """The match with which a scale begins: that of the scale before, or of the start."""
    if before is None:
        full = full_size(start, params.beyond)
        match = correspondence.from_pixels(
            start, full, scale.patches, scale.places, params.patch_size, scale.factor
        )
    else:
        match = correspondence.rescale(before, scale.patches, scale.places, scale.growth)
    return match if scale.allowed is None else scale.allowed.moved(match)


S = TypeVar("S")
L_contra = TypeVar("L_contra", bound=Scale, contravariant=True)


@runtime_checkable
class ScaleMethod(Protocol[S, L_contra]):
    """What is optimised at scales ``L_contra``: a state ``S``, improved in place.

    Besides a match it may hold what else a patch has: gain and bias, or turn, scale and mirroring.
    """

    saved: ClassVar[type[Any]]
    """of a state after a scale, as a checkpoint holds it; one of its fields is ``scales``"""

    def begun(self, scale: L_contra, before: S | None, random: np.random.Generator) -> S:
        """The state with which a scale begins, from that of the scale before, if there is one."""

    def rounds(self, state: S, scale: L_contra, random: np.random.Generator) -> Rounds:
        """Improve ``state`` in place, iteration by iteration."""

    def picture(self, state: S, scale: L_contra) -> Image:
        """The result at a scale: all channels, linear."""

    def save(self, state: S, scale: L_contra, scales: list[dict[str, Any]]) -> Any:
        """A ``saved`` state."""

    def restored(self, saved: Any) -> S:
        """The state from a checkpoint."""


@dataclass
class _Run(Generic[S]):
    """A result so far."""

    randoms: Sequence[np.random.Generator]
    """of each scale"""
    state: S | None = None
    """none before the first scale"""
    done: list[dict[str, Any]] = field(default_factory=list)
    """a record of each scale"""


def coarse_to_fine(
    method: ScaleMethod[S, L_contra],
    scales: Sequence[L_contra],
    randoms: Sequence[np.random.Generator],
    tolerance: float,
    checkpoints: Checkpoints,
    others: Sequence[Sequence[np.random.Generator]] = (),
    choice: Callable[[Sequence[S], L_contra, Sequence[Mapping[str, Any]]], int] | None = None,
) -> tuple[S, list[dict[str, Any]]]:
    """Optimise scale by scale, from the last checkpoint on.

    Parameters
    ----------
    randoms : of each scale.
    tolerance : share of changed matches at which a scale ends.
    others : the same as ``randoms`` for other results of the first scales, of which ``choice`` continues one,
        given the records of their last scale.

    Returns
    -------
    the state at full size, and a record of each scale; see `improve_all`.
    """
    runs: list[_Run[S]] = [_Run(randoms)]
    first = 0
    resumed = checkpoints.latest(method.saved)
    if resumed is not None:
        first, saved = resumed
        runs = [_Run(randoms, method.restored(saved), list(saved.scales))]
    else:
        runs += [_Run(other) for other in others]
    for scale in scales[first:]:
        states = [method.begun(scale, run.state, run.randoms[scale.level - 1]) for run in runs]
        rounds = [
            method.rounds(state, scale, run.randoms[scale.level - 1])
            for state, run in zip(states, runs, strict=True)
        ]
        previews = [partial(method.picture, state, scale) for state in states]
        records = improve_all(rounds, scale, scales, tolerance, previews)
        for run, state, record in zip(runs, states, records, strict=True):
            run.state = state
            run.done.append(record)
        if len(runs) > 1:
            if scale.level < len(others[0]):
                continue
            assert choice is not None
            best = runs[choice(states, scale, records)]
            runs = [_Run(randoms, best.state, best.done)]
        run = runs[0]
        assert run.state is not None
        if scale.level < len(scales):
            checkpoints.save(scale.level, method.save(run.state, scale, list(run.done)))
    assert runs[0].state is not None
    return runs[0].state, runs[0].done
