"""A picture that another program made, as a result to be scored."""

import dataclasses
from collections.abc import Mapping
from typing import Any

from texloom.stages.vocabulary.arrays import Image
from texloom.stages.vocabulary.declare import InputError, Params, stage
from texloom.stages.vocabulary.facts import NOWHERE
from texloom.stages.vocabulary.sizes import Size, format_size
from texloom.stages.vocabulary.tileable import Tileable


class ExternalResultParams(Params):
    """Size and kind of the result."""

    size: Size | None = None
    """size of the result, px, as 512 or 768x512 (width x height): a larger picture is cropped to its centre; null:
    all of the picture"""
    tileable: Tileable = NOWHERE
    """the picture wraps around along x, y or both, whether it says so or not; then it is not cropped there"""


@dataclasses.dataclass(frozen=True)
class ExternalResult:
    """The result."""

    image: Image
    """all maps of the picture, bit-identical"""


def check_size(params: ExternalResultParams, known: Mapping[str, Any]) -> None:
    """The picture must hold the result."""
    image = known.get("image")
    if image is None or params.size is None:
        return
    height, width = params.size
    sides = zip((image.height, image.width), params.size, params.tileable, strict=True)
    if any(around and own != wanted for own, wanted, around in sides):
        raise InputError(
            f"image: {format_size(image)}; a tileable result must have {format_size((height, width))}, as a part "
            "of it would not wrap around"
        )
    if image.height < height or image.width < width:
        raise InputError(
            f"image: {format_size(image)}; the result must have at least {format_size((height, width))}"
        )


@stage(version=1, check=check_size)
def external_result(image: Image, params: ExternalResultParams) -> ExternalResult:
    """Take a picture that another program made as a result, to score it and to compare it with others.

    Parameters
    ----------
    image : the other program's picture.

    Raises
    ------
    InputError
        the picture is smaller than the result, or a tileable one of another size.

    References
    ----------
    Ours.
    """
    height, width = params.size or (image.height, image.width)
    top, left = (image.height - height) // 2, (image.width - width) // 2
    part = image.cropped(slice(top, top + height), slice(left, left + width))
    return ExternalResult(part.wrapping(part.wraps | params.tileable))
