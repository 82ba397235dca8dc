"""Coarse-to-fine patch optimisation without guidance: its parameters, its scales, and the exemplar at each."""

import math
from dataclasses import dataclass
from typing import Any, Generic, Literal, TypeAlias, TypeVar

import numpy as np
import pydantic
from jaxtyping import Float32, Int32
from pydantic import Field

from texloom.stages.common.features.maps import MapWeights
from texloom.stages.common.grids.pyramid import resize, scale_sizes, scaled
from texloom.stages.synthesis.optimisation import correspondence
from texloom.stages.synthesis.optimisation.allowed import Allowed, allowed_at_scales
from texloom.stages.synthesis.optimisation.correspondence import Patches
from texloom.stages.synthesis.optimisation.features import PatchFeatures
from texloom.stages.synthesis.optimisation.match_search import Effort, occurrence_map
from texloom.stages.synthesis.optimisation.presets import with_preset
from texloom.stages.synthesis.optimisation.scale import Scale
from texloom.stages.synthesis.optimisation.vote import window
from texloom.stages.vocabulary.arrays import Correspondence, Image, ScalarMap
from texloom.stages.vocabulary.declare import Params
from texloom.stages.vocabulary.facts import NOWHERE, Wraps
from texloom.stages.vocabulary.masks import FilledExemplar, valid_pixels
from texloom.stages.vocabulary.tileable import Tileable

CoarserPatches: TypeAlias = Int32[np.ndarray, "2 coarser_p coarser_q"]

PRESETS: dict[str, dict[str, Any]] = {
    "default": {},
    "fast": {
        "ratio": 1.6,
        "first_iterations": 10,
        "last_iterations": 2,
        "coarse_sweeps": 4,
        "fine_sweeps": 2,
        "tolerance": 0.01,
    },
}
"""values that differ from the fields' defaults"""


class PlainParams(Params):
    """Scales, search and last vote. A preset replaces some defaults; explicit values override it."""

    preset: Literal["default", "fast"] = "default"
    """`fast` has fewer scales and iterations"""
    patch_size: int = Field(10, ge=3, le=32)
    """side of a patch, px"""
    tileable: Tileable = NOWHERE
    """the result continues across its borders: x left to right, y top to bottom, both, off"""
    ratio: float = Field(1.3, gt=1.0, le=4.0)
    """size of a scale relative to the one before it, at least"""
    coarsest: int = Field(35, ge=8)
    """exemplar's shorter side at the first scale, px; never below one and a half patches"""
    first_iterations: int = Field(24, ge=1, le=200)
    """iterations of search and vote at the first scale"""
    last_iterations: int = Field(6, ge=1, le=200)
    """the same at the last scale; interpolated between"""
    coarse_sweeps: int = Field(8, ge=1, le=50)
    """sweeps of patch search per iteration in the coarser half of the scales"""
    fine_sweeps: int = Field(6, ge=1, le=50)
    """sweeps of patch search per iteration in the finer half"""
    random_tries: int = Field(10, ge=0, le=100)
    """random places tried for a patch in the first sweep of an iteration; one fewer in each that follows"""
    tolerance: float = Field(0.002, ge=0, lt=1)
    """a scale ends early when an iteration changes no more than this share of the patches"""
    weights: MapWeights = Field({})
    final_sigma: float | None = Field(1.0, gt=0, le=100)
    """standard deviation of the Gaussian weights of a patch's votes in the last vote, px; null weighs all alike"""

    @pydantic.model_validator(mode="before")
    @classmethod
    def _fill_from_preset(cls, values: Any) -> Any:
        return with_preset(values, PRESETS)


P = TypeVar("P", bound=PlainParams)
T = TypeVar("T", bound="PlainTexture")


@dataclass(frozen=True)
class PlainScale(Scale):
    """Parameters of one scale. The target has a margin of `patch_size` - 1 px where it is not tileable."""

    effort: Effort
    allowed: Allowed | None
    """exemplar patches without masked pixels; none for all"""

    @property
    def cost(self) -> float:
        """Relative amount of work."""
        return super().cost * self.effort.sweeps


def margin_of(params: PlainParams) -> tuple[int, int]:
    """What is synthesised above and below the result, left and right of it, and cropped, px."""
    down, across = (0 if around else params.patch_size - 1 for around in params.tileable)
    return down, across


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


def plain_scales(image: Image, start: Correspondence, params: PlainParams) -> list[PlainScale]:
    """The scales, coarsest first. Coarse ones with too few unmasked patches are omitted.

    Raises
    ------
    InputError : no patch of the exemplar is without masked pixels.
    """
    size, margin = params.patch_size, margin_of(params)
    exemplar = (image.height, image.width)
    full = full_size(start, margin)
    coarsest = max(
        params.coarsest, math.ceil(1.5 * size), coarsest_side(min(exemplar), full, size, params.tileable)
    )
    factors = scale_sizes(*exemplar, coarsest, params.ratio)
    alloweds = allowed_at_scales(valid_pixels(image), exemplar, factors, size)
    factors = factors[-len(alloweds) :]
    count = len(factors)
    scales = []
    for level, factor in enumerate(factors, 1):
        progress = (level - 1) / (count - 1) if count > 1 else 1.0
        sides, target = ([scaled(side, factor) for side in whole] for whole in (exemplar, full))
        sweeps = params.coarse_sweeps if level <= count / 2 else params.fine_sweeps
        scales.append(
            PlainScale(
                level=level,
                factor=factor,
                exemplar=(sides[0], sides[1]),
                places=(sides[0] - size + 1, sides[1] - size + 1),
                target=(target[0], target[1]),
                patches=(target[0] - margin[0], target[1] - margin[1]),
                iterations=round(
                    params.first_iterations + (params.last_iterations - params.first_iterations) * progress
                ),
                effort=Effort(sweeps, params.random_tries, 0, params.tolerance),
                allowed=alloweds[level - 1],
            )
        )
    return scales


@dataclass(frozen=True)
class PlainTexture:
    """The new texture."""

    image: Image
    """all channels of the exemplar"""
    match: Correspondence
    """source of each pixel of the result in the exemplar, that of the most similar patch around it"""
    occurrence: ScalarMap
    """use of each exemplar pixel by the result's patches; 1 is uniform use of the unmasked pixels"""
    scales: list[dict[str, Any]]
    """for each scale, coarsest first: height and width of the result, px; number of iterations; energy per patch,
    squared CIELAB units per pixel; share of patches changed in the last iteration"""

    @classmethod
    def cropped(
        cls: type[T],
        whole: Image,
        match: Patches,
        exemplar: Image,
        params: PlainParams,
        scales: list[dict[str, Any]],
    ) -> T:
        """The result: ``whole`` and the sources of its pixels without their margin."""
        margin, usable = margin_of(params), valid_pixels(exemplar)
        sides = whole.height, whole.width
        inner = tuple(slice(beyond, side - beyond) for side, beyond in zip(sides, margin, strict=True))
        source = correspondence.to_pixels(match, params.patch_size, params.tileable)
        used_area = None if usable is None else int(usable.sum())
        return cls(
            image=whole.elsewhere(np.ascontiguousarray(whole.pixels[inner])).wrapping(params.tileable),
            match=np.ascontiguousarray(source[inner]),
            occurrence=occurrence_map(match, (exemplar.height, exemplar.width), params.patch_size, used_area),
            scales=scales,
        )


class PlainOptimisation(Generic[P]):
    """The data of one run: the exemplar, its compared planes, and the windows of the votes."""

    def __init__(self, image: Image, params: P):
        exemplar = FilledExemplar.of(image)
        self.image = exemplar.image
        self.compared = PatchFeatures(exemplar, None, 1.0, params.weights, None, None, 0.0, params.patch_size)
        self.params = params
        self.even = window(params.patch_size)
        self.final = window(params.patch_size, params.final_sigma)


def match_at(
    scales: list[PlainScale],
    scale: PlainScale,
    before: CoarserPatches | None,
    start: Correspondence,
    params: PlainParams,
) -> Patches:
    """The match with which a scale begins: that of the scale before, or of the start."""
    if before is None:
        full = full_size(start, margin_of(params))
        match = correspondence.from_pixels(
            start, full, scale.patches, scale.places, params.patch_size, scale.factor
        )
    else:
        growth = scale.factor / scales[scale.level - 2].factor
        match = correspondence.rescale(before, scale.patches, scale.places, growth)
    return match if scale.allowed is None else scale.allowed.moved(match)


def scaled_exemplar(image: Image, scale: Scale) -> Float32[np.ndarray, "h w c"]:
    """All channels of the exemplar at a scale, linear."""
    return resize(image.pixels, *scale.exemplar)
