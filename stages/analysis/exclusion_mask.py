"""Which pixels of an exemplar may be used: a mask laid over it."""

import dataclasses
from collections.abc import Mapping
from typing import Any, Literal

import numpy as np
from pydantic import Field

from texloom.stages.arrays import Image, Mask
from texloom.stages.declare import InputError, Params, stage
from texloom.stages.masks import USABLE, unmarked, usable_pixels

_MIDDLE_GREY = 0.2140  # linear light of sRGB's 0.5


class ExclusionMaskParams(Params):
    """How the mask is read."""

    avoid: Literal["black", "white"] = "black"
    """which side of middle grey marks pixels that are never used"""
    grow: int = Field(0, ge=0, le=256)
    """how much wider the marks become on every side, px, as where they have soft borders"""


@dataclasses.dataclass(frozen=True)
class ExclusionMask:
    """The exemplar with its mask."""

    image: Image
    """the exemplar with a channel `usable`, 0 or 1, which the stages heed"""
    mask: Mask
    """true where the exemplar may be used"""


def check_mask(params: ExclusionMaskParams, known: Mapping[str, Any]) -> None:  # noqa: ARG001
    """The mask must be of the exemplar's size."""
    image, mask = known.get("image"), known.get("mask")
    if image is not None and mask is not None and (mask.height, mask.width) != (image.height, image.width):
        raise InputError(
            f"mask: {mask.height}x{mask.width} px for an image of {image.height}x{image.width} px; "
            "both have to be of one size"
        )


@stage(version=1, check=check_mask)
def exclusion_mask(image: Image, params: ExclusionMaskParams, mask: Image | None = None) -> ExclusionMask:
    """Mark the pixels of an exemplar that must never be used: logos, borders, damage.

    Parameters
    ----------
    image : its alpha ``A`` marks pixels too, where it is below a half.
    mask : a picture of the same size, whose lightness counts; none leaves the alpha alone.

    Raises
    ------
    InputError
        the mask is of another size, or nothing is left.

    References
    ----------
    Masks are ours; what they mark is left out of every step of [Kaspar2015]_.
    """
    import cv2

    check_mask(params, {"image": image, "mask": mask})
    given = usable_pixels(image)
    found = np.ones((image.height, image.width), bool) if given is None else given
    if mask is not None:
        bright = mask.color @ np.array([0.2126, 0.7152, 0.0722], np.float32) >= _MIDDLE_GREY
        found = found & (bright if params.avoid == "black" else ~bright)
    if params.grow:
        side = 2 * params.grow + 1
        marked = cv2.dilate((~found).astype(np.uint8), np.ones((side, side), np.uint8))
        found = marked == 0
    if not found.any():
        raise InputError("mask: no pixel of the image is left")
    plain = unmarked(image)
    pixels = np.concatenate([plain.pixels, found[..., None].astype(np.float32)], axis=2)
    return ExclusionMask(Image(pixels, (*plain.channels, USABLE)), found)
