"""What stitching methods share: parameters, results, and the exemplar with its features and mask."""

import dataclasses
from collections.abc import Callable, Mapping, Sequence
from typing import Any, TypeAlias

import numpy as np
from jaxtyping import Bool, Float32, Int64
from pydantic import Field

from texloom.stages.common.features.maps import MIN_SPREAD, MapWeights, check_weights, map_features
from texloom.stages.common.grids.size_checks import check_side
from texloom.stages.vocabulary.arrays import Correspondence, Image
from texloom.stages.vocabulary.color import lab_from_linear
from texloom.stages.vocabulary.declare import InputError, Params
from texloom.stages.vocabulary.facts import NOWHERE
from texloom.stages.vocabulary.masks import (
    FilledExemplar,
    count_excluded,
)
from texloom.stages.vocabulary.sizes import Size
from texloom.stages.vocabulary.tileable import Tileable


class StitchingParams(Params):
    """Parameters of every stitching method."""

    size: Size = (512, 512)
    tileable: Tileable = NOWHERE
    """the result continues across its borders: x left to right, y top to bottom, both, off"""
    weights: MapWeights = Field({})


@dataclasses.dataclass(frozen=True)
class Stitched:
    """The texture."""

    image: Image
    """all maps of the exemplar: its pixels at ``match``, blended where the method blends"""
    match: Correspondence
    """for every pixel of the result its source in the exemplar, to the nearest pixel; of blended ones the one of
    larger weight"""


def check_exemplar(params: StitchingParams, known: Mapping[str, Any], min_side: int) -> None:
    """The exemplar must have sides of at least ``min_side`` px, and the maps of ``weights``."""
    image = known.get("image")
    if image is not None:
        check_weights(params.weights, image.channels)
        check_side(image, min_side)


Features: TypeAlias = Float32[np.ndarray, "h w c"]
MoreFeatures: TypeAlias = Float32[np.ndarray, "h w k"]


def lab_of(image: Image) -> Float32[np.ndarray, "h w c"]:
    """CIELAB colours, or lightness alone of a grey image."""
    lab = lab_from_linear(image.color)
    return np.ascontiguousarray(lab[..., :1] if image.channels[0] == "Y" else lab)


class Exemplar:
    """An exemplar whose masked pixels are replaced by the nearest usable ones.

    Parameters
    ----------
    color : function from an image to the features of its colour, (h, w, c).
    white : distance from black to white in these; 100 for CIELAB.
    weights : see `MapWeights`; the image must have these maps.

    Raises
    ------
    InputError
        a usable pixel holds a value that is not finite, or no pixel is usable.
    """

    image: Image
    """all channels except the mask; masked pixels hold the nearest usable pixel's values"""
    features: Features
    """colour, and the principal components of all other maps, scaled to vary together as much as colour alone"""
    usable: Bool[np.ndarray, "h w"] | None
    """false for masked pixels; none if there are none"""

    def __init__(
        self, image: Image, color: Callable[[Image], Features], white: float, weights: Mapping[str, float]
    ):
        filled = FilledExemplar.of(image)
        self.image, self.usable = filled.image, filled.valid
        if not np.isfinite(self.image.pixels).all():
            raise InputError("image: a value is not finite")
        self._open: dict[tuple[int, int], np.ndarray] = {}
        self.features = _with_maps(color(self.image), self.image, self.usable, 100 / white, weights)

    @property
    def shape(self) -> tuple[int, int]:
        """Height and width, px."""
        return self.image.height, self.image.width

    def open_places(self, height: int, width: int) -> Bool[np.ndarray, "p q"]:
        """Where a box without masked pixels may have its top-left pixel."""
        if (height, width) not in self._open:
            places = (self.shape[0] - height + 1, self.shape[1] - width + 1)
            unmasked = self.usable is None
            self._open[height, width] = (
                np.ones(places, bool) if unmasked else count_excluded(self.usable, height, width) == 0
            )
        return self._open[height, width]

    def anywhere(self, height: int, width: int, rng: np.random.Generator) -> Int64[np.ndarray, "2"]:
        """Row and column of a random open place, uniformly distributed."""
        if self.usable is None:
            return rng.integers(0, np.subtract(self.shape, (height, width)).astype(np.int64) + 1)
        places = np.argwhere(self.open_places(height, width))
        return np.asarray(places[rng.integers(len(places))])

    def first_that_fits(self, sides: Sequence[int], name: str, param: str = "") -> int:
        """Index of the first of ``sides`` for which there is a square without masked pixels.

        Raises
        ------
        InputError
            there is none; the message calls the square ``name`` and its side ``param``.
        """
        if self.usable is None:
            return 0
        for number, side in enumerate(sides):
            if self.open_places(side, side).any():
                return number
        advice = f"lower {param} or mask less" if param else "mask less"
        raise InputError(f"image: its mask leaves no whole {name} of {sides[-1]} px; {advice}")


def _with_maps(
    color: Features, image: Image, usable: np.ndarray | None, scale: float, weights: Mapping[str, float]
) -> MoreFeatures:
    counted = color.reshape(-1, color.shape[2]) if usable is None else color[usable]
    spread = scale * float(np.sqrt(counted.var(axis=0, dtype=np.float64).sum()))
    maps = map_features(image, spread, weights, usable)
    if not maps.shape[2]:
        return color
    # Tolerances refer to colour alone, so that colour and maps together are scaled to its variance.
    base = max(spread, MIN_SPREAD)
    inside = maps.reshape(-1, maps.shape[2]) if usable is None else maps[usable]
    factor = base / np.hypot(base, float(np.sqrt(inside.var(axis=0, dtype=np.float64).sum())))
    both = np.concatenate([color * np.float32(factor), maps * np.float32(factor / scale)], axis=2)
    return np.ascontiguousarray(both, np.float32)
