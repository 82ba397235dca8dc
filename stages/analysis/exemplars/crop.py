"""Crop an image."""

import dataclasses
from collections.abc import Mapping
from typing import Annotated, Any

from pydantic import Field

from texloom.stages.vocabulary.arrays import Image
from texloom.stages.vocabulary.declare import InputError, Outline, Params, stage
from texloom.stages.vocabulary.sizes import SIDES, format_size

_CropSide = Annotated[int, Field(ge=1)]
_Position = Annotated[int, Field(ge=0)]


class CropParams(Params):
    """Size and position of the part."""

    size: Annotated[tuple[_CropSide, _CropSide], SIDES] = (256, 256)
    """size of the part, px: 256, or 512x256 for 512 wide and 256 high"""
    at: tuple[_Position, _Position] | None = None
    """row and column of its upper left pixel; null: the central part"""


@dataclasses.dataclass(frozen=True)
class Crop:
    """The part."""

    image: Image
    """all maps of the image, bit-identical"""


def check_part(params: CropParams, known: Mapping[str, Any]) -> None:
    """The part must lie inside the image."""
    image = known.get("image")
    if image is None:
        return
    top, left = corner(params, image.height, image.width)
    height, width = params.size
    if min(top, left) < 0 or top + height > image.height or left + width > image.width:
        position = "" if params.at is None else f" from row {top}, column {left}"
        raise InputError(
            f"size: {format_size((height, width))}{position} is not inside the image of {format_size(image)}"
        )


def corner(params: CropParams, height: int, width: int) -> tuple[int, int]:
    """Row and column of the upper left pixel."""
    return params.at or ((height - params.size[0]) // 2, (width - params.size[1]) // 2)


def outlines(params: CropParams, known: Mapping[str, Any]) -> dict[str, Outline]:
    """The part has the size that was asked for, and all maps."""
    image = known.get("image")
    return {} if image is None else {"image": Outline(*params.size, image.channels)}


@stage(version=1, check=check_part, outlines=outlines)
def crop(image: Image, params: CropParams) -> Crop:
    """Crop an image, such as to try a flow on a small part.

    Parameters
    ----------
    image : the picture that is cropped.

    Raises
    ------
    InputError
        the part is not inside the image.

    References
    ----------
    Ours; the studies crop exemplars to the sizes of [Ding2014]_.
    """
    top, left = corner(params, image.height, image.width)
    return Crop(image.cropped(slice(top, top + params.size[0]), slice(left, left + params.size[1])))
