"""A band along the borders of an image, which is replaced to make it tileable."""

import dataclasses
from collections.abc import Mapping
from typing import Any

import numpy as np
import pydantic
from pydantic import Field

from texloom.stages.vocabulary.arrays import Image, Mask
from texloom.stages.vocabulary.declare import InputError, Params, stage
from texloom.stages.vocabulary.facts import TORUS, Wraps
from texloom.stages.vocabulary.sizes import format_size
from texloom.stages.vocabulary.tileable import Tileable


class BorderBandParams(Params):
    """Width of the band."""

    width: int | None = Field(None, ge=4, le=4096)
    """width of the band from each border, px; null: a twelfth of the image's shorter side, at least 16. Wider bands
    have room for larger features, narrower ones preserve more of the image"""
    tileable: Tileable = TORUS
    """the borders that get a band: x left and right, y top and bottom, both"""

    @pydantic.field_validator("tileable")
    @classmethod
    def _some(cls, value: Wraps) -> Wraps:
        if not value:
            raise ValueError("off leaves the picture as it is; x, y or both")
        return value


@dataclasses.dataclass(frozen=True)
class BorderBand:
    """The image in two parts."""

    keep: Mask
    """false in the band"""


def _width(height: int, width: int, params: BorderBandParams) -> int:
    return params.width or max(16, min(height, width) // 12)


def check_width(params: BorderBandParams, known: Mapping[str, Any]) -> None:
    """The image must be four bands wide and high, where there are bands."""
    image = known.get("image")
    if image is None:
        return
    width = _width(image.height, image.width, params)
    sides = zip((image.height, image.width), params.tileable, strict=True)
    if any(has_bands and side < 4 * width for side, has_bands in sides):
        raise InputError(
            f"image: {format_size(image)} is too small for bands of {width} px along its borders, which "
            f"take {4 * width} px; give a larger picture or a narrower width"
        )


@stage(version=1, check=check_width)
def border_band(image: Image, params: BorderBandParams) -> BorderBand:
    """Mark a band along the borders of an image across which it is to continue.

    Parameters
    ----------
    image : the picture that is made tileable.

    Raises
    ------
    InputError
        the image is less than four bands wide or high, where there are bands.

    References
    ----------
    Ours; the overlap of two blocks through which [Efros2001]_ cut is such a band.
    """
    width = _width(image.height, image.width, params)
    keep = np.ones((image.height, image.width), bool)
    if params.tileable.down:
        keep[:width] = keep[-width:] = False
    if params.tileable.across:
        keep[:, :width] = keep[:, -width:] = False
    return BorderBand(keep)
