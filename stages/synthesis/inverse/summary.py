"""Shared by compactions and their baselines: sizes, and what is copied from the texture."""

import dataclasses
import math
from collections.abc import Mapping
from typing import Annotated, Any

import numpy as np

from texloom.stages.common.features.control import resize_control
from texloom.stages.common.grids.pyramid import halved_size
from texloom.stages.common.grids.size_checks import Sized
from texloom.stages.vocabulary.arrays import Correspondence, Image
from texloom.stages.vocabulary.declare import Check, InputError, Outline, Params
from texloom.stages.vocabulary.sizes import SIDES, format_size


@dataclasses.dataclass(frozen=True)
class Copied:
    """A small image whose pixels are copied from a texture."""

    image: Image
    """all channels of the texture, copied"""
    control: Image | None
    """all channels of the control map at the texture's size, copied; none without a control map"""
    source: Correspondence
    """the texture pixel that each pixel is copied from"""

    @classmethod
    def of(cls, texture: Image, control: Image | None, source: np.ndarray, wrap: bool = False) -> "Copied":
        """Copy from ``source``, (H, W, 2) rows and columns; ``wrap``: what results is a torus."""
        row, column = source[..., 0], source[..., 1]
        carried = None
        if control is not None:
            resized = resize_control(control, texture.height, texture.width)
            carried = control.elsewhere(np.ascontiguousarray(resized.pixels[row, column])).wrapping(wrap)
        return cls(
            texture.elsewhere(np.ascontiguousarray(texture.pixels[row, column])).wrapping(wrap),
            carried,
            np.ascontiguousarray(source, np.uint32),
        )


def outlines(params: Any, known: Mapping[str, Any]) -> dict[str, Outline]:
    """The small image and its control map, where ``params.size`` is in px or a share of the texture's pixels."""
    size, texture = params.size, known.get("texture")
    if isinstance(size, float) and texture is not None:
        largest = texture.height, texture.width
        size = square_of_share(size, math.prod(largest), largest, known.get("coarse"))
    if not isinstance(size, tuple):
        return {}
    height, width = size
    copied = {"image": texture, "control": known.get("control")}
    return {name: Outline(height, width, given.channels) for name, given in copied.items() if given is not None}


def square_of_share(
    share: float, pixels: int, largest: tuple[int, int], coarse: Sized | None = None
) -> tuple[int, int]:
    """Height and width of a square with ``share`` of so many pixels, less those of a ``coarse`` level beside it.

    They are a multiple of 8 px, within ``largest``.
    """
    beside = 0 if coarse is None else coarse.height * coarse.width
    side = min(max(8, 8 * round(math.sqrt(max(0.0, share * pixels - beside)) / 8)), *largest)
    return side, side


class SummaryParams(Params):
    """Size of the small image."""

    size: Annotated[tuple[int, int], SIDES] | None = None
    """size of the result, px; null: the input ``sides``"""


def size_check(name: str, min_side: str | None = None) -> Check:
    """Check of a stage's ``params.size``, if it is in px, against the texture; see `wanted_size`.

    ``min_side`` is the name of the param that holds the shortest permitted side.
    """

    def check(params: Any, known: Mapping[str, Any]) -> None:
        texture = known.get("texture")
        if texture is not None and isinstance(params.size, tuple):
            wanted_size(name, params.size, texture, None, getattr(params, min_side) if min_side else 1)

    return check


def wanted_size(
    name: str, size: tuple[int, int] | None, texture: Sized, sides: list[int] | None, min_side: int = 1
) -> tuple[int, int]:
    """Height and width of the small image, px: ``size``, or ``sides``, those of a compaction.

    Raises
    ------
    InputError
        neither is given; the size exceeds the texture's, or a side is below ``min_side`` px.
    """
    if size is None:
        if sides is None:
            raise InputError(f"{name}: neither size nor the sides of a compaction are given")
        size = (sides[0], sides[1])
    if size[0] > texture.height or size[1] > texture.width:
        raise InputError(f"{name}: size: {format_size(size)} is larger than the texture of {format_size(texture)}")
    if min(size) < min_side:
        raise InputError(f"{name}: size: {format_size(size)} is too small; its sides must be {min_side} px or more")
    return size


def level_count(shape: tuple[int, int], above: int, size: tuple[int, int], least: int) -> int:
    """Number of levels, each half as high and wide as the next.

    Parameters
    ----------
    shape, size : height and width of the texture and of the small image at the last level, px.
    above, least : their shorter sides at the first level are more than ``above`` and at least ``least`` px.
    """
    count = 1
    while min(halved_size(size, count)) >= least and min(halved_size(shape, count)) > above:
        count += 1
    return count


def require_features(name: str, features: np.ndarray, texture: Sized) -> None:
    """`ValueError` unless the features are the texture's."""
    if features.shape[:2] != (texture.height, texture.width):
        raise ValueError(f"{name}: features {features.shape} do not belong to a texture of {format_size(texture)}")
