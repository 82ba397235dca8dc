"""Sizes: (height, width) in Python, as of arrays; width x height in every text, as ``768x512``."""

import re
from collections.abc import Callable, Sequence
from decimal import Decimal
from typing import Annotated, Any, Protocol, get_args, get_origin

from pydantic import (
    Field,
    GetCoreSchemaHandler,
    GetJsonSchemaHandler,
    ValidationError,
    ValidatorFunctionWrapHandler,
)
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


def size_value(size: Sequence[float]) -> str:
    """(height, width) as it is typed: ``768x512``, width first."""
    height, width = (f"{Decimal(repr(float(side))).normalize():f}" for side in size)
    return f"{width}x{height}"


def parse_size(text: str) -> tuple[int, int] | None:
    """(height, width) of ``512`` or ``768x512``; None where it is neither."""
    sides = re.fullmatch(r"(\d{1,6})(?:[xX](\d{1,6}))?", text)
    return None if sides is None else (int(sides[2] or sides[1]), int(sides[1]))


def parse_lengths(text: str) -> tuple[float, float] | None:
    """(height, width) of lengths in any unit, ``2`` or ``13.2x10``; None where it is neither."""
    sides = re.fullmatch(r"(\d{1,6}(?:\.\d{1,32})?)(?:[xX](\d{1,6}(?:\.\d{1,32})?))?", text)
    return None if sides is None else (float(sides[2] or sides[1]), float(sides[1]))


class _Sides:
    """In the annotation of a pair: takes texts of sizes, no lists, and becomes such a text in JSON."""

    def __init__(self, parse: Callable[[str], tuple[float, float] | None], example: str):
        self._parse = parse
        self._form = f"must be N or WIDTHxHEIGHT, as {example}"

    def __get_pydantic_core_schema__(self, source: Any, handler: GetCoreSchemaHandler) -> CoreSchema:
        is_pair = get_origin(source) is tuple  # else there are other values, which may be texts

        def checked(value: Any, check: ValidatorFunctionWrapHandler) -> Any:
            pair = self._pair(value, is_pair)
            try:
                return check(pair)
            except ValidationError as error:
                problem = _named(error, pair) if is_pair else None
                raise problem or error from None

        text = core_schema.plain_serializer_function_ser_schema(_text, when_used="json")
        return core_schema.no_info_wrap_validator_function(checked, handler(source), serialization=text)

    def __get_pydantic_json_schema__(self, _schema: CoreSchema, _handler: GetJsonSchemaHandler) -> dict[str, Any]:
        return {"type": "string"}

    def _pair(self, value: Any, is_pair: bool) -> Any:
        if isinstance(value, list):
            raise ValueError(self._of_list(value))
        if isinstance(value, str):
            pair = self._parse(value)
            if pair is None and is_pair:
                raise ValueError(f"{self._form}, got {value[:40]!r}")
            return pair or value
        if type(value) in ((int, float) if is_pair else (int,)):
            return value, value
        if is_pair and not isinstance(value, tuple):
            raise ValueError(f"{self._form}, got {value!r:.40}")
        return value

    def _of_list(self, sides: list[Any]) -> str:
        """Why a list is no size: nobody can tell which side comes first."""
        if len(sides) != 2 or not all(type(side) in (int, float) and 0 < side < 1e6 for side in sides):
            return f"{self._form}, got {str(sides)[:40]}"
        one, other = (size_value(pair) for pair in (sides, sides[::-1]))
        readings = one.partition("x")[0] if one == other else f"{one} or {other}"
        return f"must be N or WIDTHxHEIGHT, got the list {sides}; write {readings}"


def _text(value: Any) -> Any:
    return size_value(value) if isinstance(value, tuple) else value


def _named(error: ValidationError, pair: Any) -> ValueError | None:
    """What is wrong with one side, by its name: texts have the sides in another order than pairs."""
    first = error.errors()[0]
    if first["loc"] not in ((0,), (1,)) or first["type"] == "missing":
        return None
    side = "side" if pair[0] == pair[1] else ("height", "width")[first["loc"][0]]
    return ValueError(f"the {side} {first['msg'].removeprefix('Input ')}, got {first['input']!r:.40}")


SIDES = _Sides(parse_size, "512 or 768x512")
"""takes ``512`` and ``768x512`` for a height and width"""
LENGTHS = _Sides(parse_lengths, "2 or 13.2x10")
"""takes ``2`` and ``13.2x10`` for a height and width in any unit"""
Side = Annotated[int, Field(ge=16, le=32768)]
Size = Annotated[
    tuple[Side, Side],
    SIDES,
    Field(description="size of the result: width x height in texts, px; (height, width) in Python"),
]


def takes_sides(annotation: Any) -> bool:
    """Whether `SIDES` are among what a type allows."""
    parts = get_args(annotation)
    return SIDES in parts or any(takes_sides(part) for part in parts)
