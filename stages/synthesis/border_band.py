"""A band along the borders of a picture: what may change so that it tiles."""

import dataclasses
from collections.abc import Mapping
from typing import Any

import numpy as np
from pydantic import Field

from texloom.stages.arrays import Image, Mask
from texloom.stages.declare import InputError, Params, stage


class BorderBandParams(Params):
    """How much may change."""

    width: int | None = Field(None, ge=4, le=4096)
    """how far the band reaches from each border, px; null: a twelfth of the picture's shorter side, at least 16.
    Wider ones hold larger features, narrower ones keep more of the picture"""


@dataclasses.dataclass(frozen=True)
class BorderBand:
    """The picture in two parts."""

    keep: Mask
    """false in the band"""


def _width(height: int, width: int, params: BorderBandParams) -> int:
    return params.width or max(16, min(height, width) // 12)


def check_width(params: BorderBandParams, known: Mapping[str, Any]) -> None:
    """Something must be left to keep."""
    image = known.get("image")
    if image is None:
        return
    width = _width(image.height, image.width, params)
    if min(image.height, image.width) < 4 * width:
        raise InputError(
            f"image: {image.height}x{image.width} px is too small for bands of {width} px along its borders, which "
            f"take {4 * width} px; give a larger picture or a narrower width"
        )


@stage(version=1, check=check_width)
def border_band(image: Image, params: BorderBandParams) -> BorderBand:
    """Mark a band along all four borders of a picture.

    Raises
    ------
    InputError
        the picture is not four bands wide and high.

    References
    ----------
    Ours; such a band is what [Efros2001]_ cut through when they join two pieces.
    """
    check_width(params, {"image": image})
    width = _width(image.height, image.width, params)
    keep = np.zeros((image.height, image.width), bool)
    keep[width:-width, width:-width] = True
    return BorderBand(keep)
