"""What baselines of patch optimisation share: parameters, the exemplar at each scale, the result."""

from dataclasses import dataclass
from typing import Any, ClassVar, Generic, Literal, TypeVar

import numpy as np
from jaxtyping import Float32

from texloom.stages.common.grids.pyramid import resize
from texloom.stages.synthesis.optimisation import correspondence
from texloom.stages.synthesis.optimisation.coarse_to_fine import (
    CoarserPatches,
    CoarseToFineParams,
    PatchScale,
    Schedule,
    match_at,
)
from texloom.stages.synthesis.optimisation.correspondence import Patches
from texloom.stages.synthesis.optimisation.features import PatchFeatures
from texloom.stages.synthesis.optimisation.match_search import occurrence_map
from texloom.stages.synthesis.optimisation.vote import window
from texloom.stages.vocabulary.arrays import Correspondence, Image, ScalarMap
from texloom.stages.vocabulary.facts import NOWHERE
from texloom.stages.vocabulary.masks import FilledExemplar, valid_pixels
from texloom.stages.vocabulary.tileable import Tileable


class PlainParams(CoarseToFineParams):
    """Scales, search and last vote. A preset replaces some defaults; explicit values override it."""

    presets: ClassVar = {
        "default": {},
        "fast": {"ratio": 1.6, "first_iterations": 10, "last_iterations": 2, "tolerance": 0.01},
    }
    schedules: ClassVar = {"default": Schedule(8, 6, 10), "fast": Schedule(4, 2, 10)}

    preset: Literal["default", "fast"] = "default"
    """`fast` has fewer scales and iterations"""
    tileable: Tileable = NOWHERE
    """the result continues across its borders: x left to right, y top to bottom, both, off"""


P = TypeVar("P", bound=PlainParams)
T = TypeVar("T", bound="PlainTexture")


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
        margin, usable = params.beyond, valid_pixels(exemplar)
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

    def __init__(self, image: Image, start: Correspondence, params: P):
        exemplar = FilledExemplar.of(image)
        self.image = exemplar.image
        self.compared = PatchFeatures(exemplar, None, 1.0, params.weights, None, None, 0.0, params.patch_size)
        self.start = start
        self.params = params
        self.even = window(params.patch_size)
        self.final = window(params.patch_size, params.schedule.final_sigma)

    def match_at(self, scale: PatchScale, before: CoarserPatches | None) -> Patches:
        """The match with which a scale begins."""
        return match_at(scale, before, self.start, self.params)

    def scaled_exemplar(self, scale: PatchScale) -> Float32[np.ndarray, "h w c"]:
        """All channels of the exemplar at a scale, linear."""
        return resize(self.image.pixels, *scale.exemplar)
