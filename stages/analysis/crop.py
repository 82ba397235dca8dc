"""A part of a picture."""

import dataclasses
from collections.abc import Mapping
from typing import Annotated, Any

import numpy as np
from pydantic import Field

from texloom.stages.arrays import Image
from texloom.stages.declare import InputError, Params, stage
from texloom.stages.sizes import SIDES

_Pixels = Annotated[int, Field(ge=1)]
_Place = Annotated[int, Field(ge=0)]


class CropParams(Params):
    """Which part is kept."""

    size: Annotated[tuple[_Pixels, _Pixels], SIDES] = (256, 256)
    """height and width of the part, px"""
    at: tuple[_Place, _Place] | None = None
    """row and column of its upper left pixel; null: the part in the middle"""


@dataclasses.dataclass(frozen=True)
class Crop:
    """The part."""

    image: Image
    """all maps of the picture, bit for bit"""


def check_part(params: CropParams, known: Mapping[str, Any]) -> None:
    """The part must lie inside the picture."""
    image = known.get("image")
    if image is None:
        return
    top, left = corner(params, image.height, image.width)
    height, width = params.size
    if min(top, left) < 0 or top + height > image.height or left + width > image.width:
        place = "" if params.at is None else f" from row {top}, column {left}"
        raise InputError(
            f"size: {height}x{width} px{place} are not inside the image of {image.height}x{image.width} px"
        )


def corner(params: CropParams, height: int, width: int) -> tuple[int, int]:
    """Row and column of the upper left pixel."""
    return params.at or ((height - params.size[0]) // 2, (width - params.size[1]) // 2)


@stage(version=1, check=check_part)
def crop(image: Image, params: CropParams) -> Crop:
    """Keep a part of a picture, as to try a flow on little.

    Raises
    ------
    InputError
        the part is not inside the picture.

    References
    ----------
    Ours; the studies take exemplars of the sizes of [Ding2014]_ with it.
    """
    check_part(params, {"image": image})
    top, left = corner(params, image.height, image.width)
    part = image.pixels[top : top + params.size[0], left : left + params.size[1]]
    return Crop(Image(np.ascontiguousarray(part), image.channels))
