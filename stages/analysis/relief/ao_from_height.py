"""Ambient occlusion of a height map, by horizon angles."""

import dataclasses
import math

import numpy as np
from pydantic import Field

from texloom.stages.analysis.relief.added_maps import Relief, has_map, heights, with_map
from texloom.stages.kernels.core.elementary_functions import cos, sin
from texloom.stages.numerics.filters import padded
from texloom.stages.vocabulary.arrays import Image
from texloom.stages.vocabulary.declare import Params, stage
from texloom.stages.vocabulary.facts import DISPLACEMENT, MapFacts

_GROWTH = 1.25  # of the distance from one sample to the next
_PIECES = 64


class AoFromHeightParams(Params):
    """How deep the heights are, and how far they are looked at."""

    relief: Relief = DISPLACEMENT
    reach: float = Field(0.06, gt=0, le=1)
    """distance up to which heights hide the sky, as a share of the picture's width"""
    directions: int = Field(16, ge=4, le=128)
    """number of directions in which the horizon is searched"""


@dataclasses.dataclass(frozen=True)
class AoFromHeight:
    """The material with ambient occlusion."""

    image: Image
    """with a channel `ao`: 1 where nothing hides the sky; a map that was there is kept"""


@stage(version=1)
def ao_from_height(image: Image, params: AoFromHeightParams) -> AoFromHeight:
    """Compute the share of a uniform sky's light that reaches each point, by the horizon in each direction.

    It is the mean over directions of the squared cosine of the horizon's elevation, that of a point that faces up.
    Samples stand 1 px apart at first, then ever wider apart by a quarter.

    Parameters
    ----------
    image : a material with a map ``height``; excluded pixels count as the nearest others do.

    Raises
    ------
    InputError
        there is no map ``height``, or all pixels are excluded.

    References
    ----------
    [Max1988]_ for horizons of height maps; [DozierFrew1990]_ for the sky view factor, here of a level point.
    """
    from texloom.stages.kernels.core.threads import run_spans
    from texloom.stages.kernels.relief.sky_view import fill_sky_view

    if has_map(image, "ao"):
        return AoFromHeight(image)
    angles = 2 * np.pi * np.arange(params.directions) / params.directions
    distances = [1.0]
    while (further := max(distances[-1] + 1, np.floor(_GROWTH * distances[-1]))) <= params.reach * image.width:
        distances.append(float(further))
    height = heights(image, params.relief)
    margin = math.ceil(distances[-1]) + 1
    wide = padded(height, margin, image.wraps.modes("edge"))  # nothing rises beyond borders that are open
    places = np.stack([sin(angles), cos(angles)], axis=1)[:, None] * np.array(distances)[:, None]
    out = np.empty_like(height)
    given = (wide, places, np.array(distances), margin, out)
    run_spans(fill_sky_view, given, image.height, _PIECES)
    return AoFromHeight(with_map(image, "ao", out[..., None], ("ao",), MapFacts()))
