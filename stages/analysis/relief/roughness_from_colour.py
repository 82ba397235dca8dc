"""Roughness guessed from colour: where colour has more fine detail, the surface is rougher."""

import dataclasses
import logging

import numpy as np
from pydantic import Field

from texloom.stages.analysis.relief.added_maps import has_map, smoothed, with_map, within
from texloom.stages.vocabulary.arrays import Image
from texloom.stages.vocabulary.color import lab_from_linear
from texloom.stages.vocabulary.declare import Params, stage
from texloom.stages.vocabulary.facts import MapFacts
from texloom.stages.vocabulary.masks import fill_excluded, valid_pixels

_LOG = logging.getLogger(__name__)

_WINDOW = 1 / 128  # deviation of the window in which detail is measured, as a share of the shorter side


class RoughnessFromColourParams(Params):
    """Where the guess lies."""

    level: float = Field(0.7, ge=0, le=1)
    """roughness where there is a median amount of fine detail; most stone, wood and soil have 0.6 to 0.9"""
    spread: float = Field(0.3, ge=-1, le=1)
    """how much rougher the most detailed places are, and smoother those without detail; less than 0 reverses it"""


@dataclasses.dataclass(frozen=True)
class RoughnessFromColour:
    """The material with roughness."""

    image: Image
    """with a channel `roughness`, 0..1; a map that was there is kept"""


@stage(version=1)
def roughness_from_colour(image: Image, params: RoughnessFromColourParams) -> RoughnessFromColour:
    """Guess roughness by the deviation of lightness in small windows, relative to its median over the picture.

    No photograph under one light tells roughness: the mean is a convention, and the pattern only plausible.

    Parameters
    ----------
    image : the exemplar; its excluded pixels have no influence.

    Raises
    ------
    InputError
        all pixels are excluded.

    References
    ----------
    Ours.
    """
    if has_map(image, "roughness"):
        return RoughnessFromColour(image)
    valid = valid_pixels(image)
    lightness = lab_from_linear(fill_excluded(image).color)[..., 0] / np.float32(100)
    deviation = max(1.0, _WINDOW * min(image.height, image.width))
    mean = smoothed(lightness, image.wraps, deviation)
    detail = np.sqrt(np.maximum(smoothed(np.square(lightness - mean), image.wraps, deviation), 0))
    middle = np.float32(np.median(within(detail, valid))) + np.float32(1e-4)
    share = (detail - middle) / (detail + middle)  # -1..1, 0 in the middle
    roughness = np.clip(np.float32(params.level) + np.float32(params.spread) * share, 0, 1)
    _LOG.warning(
        "roughness is a guess: %g, %g more where colour has fine detail (--set roughness.level, roughness.spread)",
        params.level,
        params.spread,
    )
    made = with_map(image, "roughness", roughness[..., None], ("roughness",), MapFacts())
    return RoughnessFromColour(made)
