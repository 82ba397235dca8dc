"""Sizes: (height, width) in Python, as of arrays; width x height in every text, as ``768x512``."""

import re
from collections.abc import Sequence
from typing import Annotated, Any, Protocol, get_args

from pydantic import BeforeValidator, Field, GetCoreSchemaHandler, GetJsonSchemaHandler
from pydantic_core import CoreSchema, core_schema


class HasSides(Protocol):
    """A picture, a canvas, a map."""

    @property
    def height(self) -> int:
        """Rows, px."""

    @property
    def width(self) -> int:
        """Columns, px."""


def format_size(of: HasSides | Sequence[int]) -> str:
    """The size of a picture, or of an array by its shape, for people: ``768 x 512 px``, width first."""
    height, width = of[:2] if isinstance(of, Sequence) else (of.height, of.width)
    return f"{width} x {height} px"


def size_value(size: Sequence[int]) -> str:
    """(height, width) as it is typed: ``768x512``, width first."""
    height, width = size
    return f"{width}x{height}"


def parse_size(text: str) -> tuple[int, int] | None:
    """(height, width) of ``512`` or ``768x512``; None where it is neither."""
    sides = re.fullmatch(r"(\d{1,6})(?:[xX](\d{1,6}))?", text)
    return None if sides is None else (int(sides[2] or sides[1]), int(sides[1]))


class _Sides:
    """In the annotation of a pair: takes texts of sizes, no lists, and becomes such a text in JSON."""

    def __get_pydantic_core_schema__(self, source: Any, handler: GetCoreSchemaHandler) -> CoreSchema:
        text = core_schema.plain_serializer_function_ser_schema(_text, when_used="json")
        return core_schema.no_info_before_validator_function(_sides, handler(source), serialization=text)

    def __get_pydantic_json_schema__(self, _schema: CoreSchema, _handler: GetJsonSchemaHandler) -> dict[str, Any]:
        return {"type": "string"}


def _text(value: Any) -> Any:
    return size_value(value) if isinstance(value, tuple) else value


def _sides(value: Any) -> Any:
    if isinstance(value, list):
        raise ValueError(_of_list(value))
    if isinstance(value, str):
        return parse_size(value) or value
    return (value, value) if isinstance(value, int) and not isinstance(value, bool) else value


def _of_list(sides: list[Any]) -> str:
    """Why a list is no size: nobody can tell which side comes first."""
    if len(sides) != 2 or not all(isinstance(side, int) for side in sides):
        return f"must be N or WIDTHxHEIGHT, as 512 or 768x512, got {str(sides)[:40]}"
    one, other = (size_value(pair) for pair in (sides, sides[::-1]))
    readings = str(sides[0]) if one == other else f"{one} or {other}"
    return f"must be N or WIDTHxHEIGHT, got the list {sides}; write {readings}"


def _size(value: Any) -> Any:
    if isinstance(value, str) and parse_size(value) is None:
        raise ValueError(f"must be N or WIDTHxHEIGHT, px, as 512 or 768x512, got {value[:40]!r}")
    return value


SIDES = _Sides()
"""takes ``512`` and ``768x512`` for a height and width"""
Side = Annotated[int, Field(ge=16, le=32768)]
Size = Annotated[
    tuple[Side, Side],
    SIDES,
    BeforeValidator(_size),
    Field(description="size of the result: width x height in texts, px; (height, width) in Python"),
]


def takes_sides(annotation: Any) -> bool:
    """Whether `SIDES` are among what a type allows."""
    parts = get_args(annotation)
    return SIDES in parts or any(takes_sides(part) for part in parts)
