"""The protocol of programs that make textures by ``texloom serve``; see docs/bridge.md."""

from __future__ import annotations

import math
from typing import Annotated, Any, Literal

import pydantic
from pydantic import Field

from texloom.pipelines.errors import one_line
from texloom.pipelines.studio.messages.message import Message
from texloom.pipelines.studio.messages.runs import Queued
from texloom.stages.vocabulary.declare import InputError

PROTOCOL = 1
"""rises where a program that speaks it would have to be changed"""
HEADER = "x-texloom-protocol"
ITEM_SIZES = {"uint8": 1, "uint16": 2, "float32": 4}
_Side = Annotated[int, Field(ge=1, le=32768)]


class Hello(Message):
    """What speaks."""

    protocol: int
    version: str
    flows: tuple[str, ...]


class PixelFormat(Message):
    """What the raw bytes of a picture are: row by row from the top, channels last, little-endian."""

    shape: Annotated[tuple[_Side, ...], Field(min_length=2, max_length=3)]
    """height and width, px, and channels if it has three axes"""
    dtype: Literal["uint8", "uint16", "float32"]
    color_space: Literal["srgb", "linear", "data"]
    """integers are sRGB, floats linear light; maps that are no colour, as normals, are data, as which they are read
    by their names"""

    @property
    def size(self) -> int:
        """Bytes."""
        return math.prod(self.shape) * ITEM_SIZES[self.dtype]

    @classmethod
    def of(cls, shape: str, dtype: str, color_space: str) -> PixelFormat:
        """As a request has it; `InputError` names what is wrong."""
        fields = {"shape": shape.split(","), "dtype": dtype, "color_space": color_space or space_of(dtype)}
        try:
            pixels = cls.model_validate(fields)
        except pydantic.ValidationError as error:
            field, problem = str(error.errors()[0]["loc"][0]), error.errors()[0]["msg"]
            raise InputError(one_line(f"{field}: {fields[field]}: {problem}")) from None
        if pixels.color_space not in (space_of(dtype), "data"):
            raise InputError(f"color_space: {dtype} is {space_of(dtype)}, not {color_space}; convert the picture")
        return pixels


def space_of(dtype: str) -> Literal["srgb", "linear"]:
    """The colour space of pictures of a dtype."""
    return "linear" if dtype.startswith("float") else "srgb"


class OnePicture(Message):
    """A source that was sent."""

    picture: str
    """its id"""


class Maps(Message):
    """The maps of a material that were sent, by name as ``albedo``, ``normal``, ``normal_dx``, ``height``."""

    maps: dict[str, str] = Field(min_length=1, max_length=32)
    """name to id"""


OneSource = str | OnePicture | Maps


class Submitted(Message):
    """A run that is wanted: the options of ``texloom run``."""

    flow: str
    sources: dict[str, OneSource | Annotated[list[OneSource], Field(min_length=1, max_length=32)]] = Field(
        {}, max_length=32
    )
    """name to a file of this machine, as the command takes it, to what was sent, or to several of these"""
    params: dict[str, Any] = Field({})
    size: str | int | None = None
    """WIDTHxHEIGHT, or one number for both, px"""
    tileable: Literal["off", "x", "y", "both"] | None = None
    preset: str | None = None
    seed: int | None = None
    crop: str | None = None
    reduce: str | None = None
    layout: str | None = None
    texel_size: str | None = None


class ResultMap(Message):
    """A map of a result."""

    name: str
    pixels: PixelFormat


class HostRun(Queued):
    """A run of such a program."""

    flow: str
    changes: int = 0
    """rises whenever this changes; a request may wait for more than it has seen"""
    previews: int = 0
    """how many pictures of what it has made so far there were"""
    preview: PixelFormat | None = None
    """the latest, R G B A"""
    maps: tuple[ResultMap, ...] = ()
    """the main result; ``albedo`` where it is a picture"""
    files: tuple[str, ...] = ()
    """the exports, by their names"""
    notes: tuple[str, ...] = ()
    """what a person is told, such as what was guessed, clipped or left out"""
    scores: dict[str, float] = Field({})
