"""What the simple ways to make a small picture of a large texture share; they stand beside a compaction."""

import dataclasses

import numpy as np

from texloom.stages.arrays import Correspondence, Image
from texloom.stages.common.control import resize_control
from texloom.stages.common.sizes import Sized
from texloom.stages.declare import InputError


@dataclasses.dataclass(frozen=True)
class Copied:
    """A small picture whose pixels are the texture's."""

    image: Image
    """all channels of the texture, copied"""
    control: Image | None
    """all channels of the control map, copied at the texture's size; none where there was none"""
    source: Correspondence
    """the texture pixel that each pixel is copied from"""

    @classmethod
    def of(cls, texture: Image, control: Image | None, source: np.ndarray) -> "Copied":
        """Copy from ``source``, (H, W, 2) rows and columns."""
        row, column = source[..., 0], source[..., 1]
        carried = None
        if control is not None:
            planes = resize_control(control, texture.height, texture.width).pixels
            carried = Image(np.ascontiguousarray(planes[row, column]), control.channels)
        return cls(
            Image(np.ascontiguousarray(texture.pixels[row, column]), texture.channels),
            carried,
            np.ascontiguousarray(source, np.uint32),
        )


def wanted_size(
    name: str, size: tuple[int, int] | None, texture: Sized, sides: list[int] | None, least: int = 1
) -> tuple[int, int]:
    """Height and width that the small picture is to have, px.

    Parameters
    ----------
    name : of the stage, for messages.
    size : as asked for; None takes ``sides``, those of a compaction.
    least : shortest side that will do.

    Raises
    ------
    InputError : neither is given; the size is beyond the texture's, or below ``least``.
    """
    if size is None:
        if sides is None:
            raise InputError(f"{name}: size is not given, and no sides of a compaction")
        size = (sides[0], sides[1])
    if size[0] > texture.height or size[1] > texture.width:
        raise InputError(
            f"{name}: size={size[0]}x{size[1]} px is larger than the texture of {texture.height}x{texture.width} px"
        )
    if min(size) < least:
        raise InputError(f"{name}: size={size[0]}x{size[1]} px is too small; its sides must be {least} px or more")
    return size


def require_features(name: str, features: np.ndarray, texture: Sized) -> None:
    """`ValueError` unless the features are the texture's."""
    if features.shape[:2] != (texture.height, texture.width):
        raise ValueError(
            f"{name}: features {features.shape} do not belong to a texture of {texture.height}x{texture.width} px"
        )
