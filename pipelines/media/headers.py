"""What is known of a picture file before its pixels are decoded, and why one is not read."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Mapping

import numpy as np
from jaxtyping import Float32, UInt8

from texloom.stages.vocabulary.facts import UNKNOWN, Facts
from texloom.stages.vocabulary.sizes import format_size

_SIDE = 32768  # px
_PIXELS = 2**28


class Refusal(Exception):  # noqa: N818
    """Why a picture is not read; the text follows its name."""


@dataclasses.dataclass(frozen=True)
class Header:
    """The header of a picture."""

    height: int
    width: int
    channels: tuple[str, ...]
    """``R G B`` or ``Y``, then ``A`` if there is alpha, then other channels of an EXR"""
    bits: int
    """8 or 16 of an integer, 32 where the values are floats"""
    memory: int
    """bytes that decoding takes at most, with its result"""


@dataclasses.dataclass(frozen=True)
class OpenedPicture(Header):
    """A picture of which the header was read."""

    decode: Callable[[], Float32[np.ndarray, "h w c"]]
    """reads the pixels, while the file is open"""
    facts: Facts = UNKNOWN
    """what texloom has written into it; other files say nothing"""
    note: str = ""
    """what was assumed of its colour, for the user"""
    original_bits: Mapping[str, int] = dataclasses.field(default_factory=dict)
    """as ``bits``, of what texloom made each map, by its role, in a file of floats from, where that is known"""
    texel_size: float | None = None
    """side of a pixel, m, where texloom has written it"""
    names: Mapping[str, str] = dataclasses.field(default_factory=dict)
    """of the files that maps came from, by role, without suffix, where texloom has written it"""
    codes: Callable[[], UInt8[np.ndarray, "h w c"]] | None = None
    """reads sRGB, 8 bits, as it is in the file, which takes a third of the time; none where it is not so"""


def check_size(height: int, width: int) -> None:
    """`Refusal` of a size that is too small, or too large to be decoded."""
    if height < 1 or width < 1:
        raise Refusal(f"has no pixels: {format_size((height, width))}")
    if height < 2 or width < 2:
        raise Refusal(f"is too small: {format_size((height, width))}, at least 2 x 2 px")
    if max(height, width) > _SIDE or height * width > _PIXELS:
        raise Refusal(
            f"is too large: {format_size((height, width))}, at most {_SIDE} px a side and {_PIXELS} in all"
        )
