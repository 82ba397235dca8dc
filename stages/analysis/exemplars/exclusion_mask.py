"""Exclude pixels of an exemplar by a mask."""

import dataclasses
import logging
from collections.abc import Mapping
from typing import Any, Literal

import numpy as np
from pydantic import Field

from texloom.stages.common.grids.border_steps import fitting_borders
from texloom.stages.common.grids.size_checks import check_same_size
from texloom.stages.numerics.matrices import matrix_product
from texloom.stages.vocabulary.arrays import Image, Mask
from texloom.stages.vocabulary.declare import InputError, Outline, Params, stage
from texloom.stages.vocabulary.facts import NOWHERE
from texloom.stages.vocabulary.masks import USABLE, valid_pixels, with_usable
from texloom.stages.vocabulary.tileable import Tileable

_LOG = logging.getLogger(__name__)

_MIDDLE_GREY = 0.2140  # linear light of sRGB's 0.5


class ExclusionMaskParams(Params):
    """How the mask is interpreted."""

    avoid: Literal["black", "white"] = "black"
    """whether pixels darker or brighter than middle grey are excluded"""
    grow: int = Field(0, ge=0, le=256)
    """px by which excluded areas grow on every side, such as to cover soft borders"""
    keep_tile: Tileable | None = NOWHERE
    """borders across which the picture is taken to continue, beside those that it says: x, y, both, off; null: if
    it says none, those that an excluded area touches and where opposite ones fit"""


@dataclasses.dataclass(frozen=True)
class ExclusionMask:
    """The exemplar with its mask."""

    image: Image
    """the exemplar with a channel `usable`: 0 where a pixel is excluded, else 1"""
    valid: Mask
    """true where the exemplar may be used, that is, where `usable` is 1"""


def check_mask(params: ExclusionMaskParams, known: Mapping[str, Any]) -> None:
    """The mask must have the size of the image, and leave some of it; without one, alpha must exclude some."""
    image, mask = known.get("image"), known.get("mask")
    check_same_size(mask, "mask", image, "image")
    if isinstance(image, Image) and isinstance(mask, Image | None):
        valid = _valid(image, mask, params)
        if not valid.any():
            raise InputError("mask: all pixels of the image are excluded")
        if mask is None and valid.all():
            raise InputError("image: no pixel of it is transparent, and no mask is given; give one of the two")


def outlines(params: ExclusionMaskParams, known: Mapping[str, Any]) -> dict[str, Outline]:  # noqa: ARG001
    """The image keeps its size and gets the channel `usable`."""
    image = known.get("image")
    if image is None:
        return {}
    kept = [name for name in image.channels if name != USABLE]
    return {"image": Outline(image.height, image.width, (*kept, USABLE))}


@stage(version=1, check=check_mask, outlines=outlines)
def exclusion_mask(image: Image, params: ExclusionMaskParams, mask: Image | None = None) -> ExclusionMask:
    """Exclude pixels of an exemplar, such as logos, borders or damage, from every later step.

    Parameters
    ----------
    image : pixels whose alpha ``A`` is below a half are excluded too.
    mask : an image of the same size, whose luminance is used; without it only alpha excludes pixels.

    Raises
    ------
    InputError
        the mask has another size, or all pixels are excluded; without a mask, none is.

    References
    ----------
    Ours; [Kaspar2015]_ has no masks.
    """
    valid = _valid(image, mask, params)
    if mask is not None and valid.all():
        _LOG.warning("the mask excludes no pixel: none of it is %s", params.avoid)
    if params.keep_tile is None:
        image = image if image.wraps else image.wrapping(fitting_borders(_LOG, image, ~valid))
    elif params.keep_tile:
        image = image.wrapping(image.wraps | params.keep_tile)
    return ExclusionMask(with_usable(image, valid), valid)


def _valid(image: Image, mask: Image | None, params: ExclusionMaskParams) -> Mask:
    """True where neither alpha nor the mask excludes a pixel."""
    import cv2

    valid = valid_pixels(image)
    if valid is None:
        valid = np.ones((image.height, image.width), bool)
    if mask is not None:
        bright = matrix_product(mask.color, np.array([0.2126, 0.7152, 0.0722], np.float32)) >= _MIDDLE_GREY
        valid = valid & (bright if params.avoid == "black" else ~bright)
    if params.grow:
        side = 2 * params.grow + 1
        valid = cv2.dilate((~valid).astype(np.uint8), np.ones((side, side), np.uint8)) == 0
    return valid
