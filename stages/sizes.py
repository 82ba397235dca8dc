"""Sizes as parameters: ``512``, ``512x768`` or ``[512, 768]``, height before width."""

import re
from typing import Annotated, Any

from pydantic import BeforeValidator, Field


def _sides(value: Any) -> Any:
    if isinstance(value, str) and (sides := re.fullmatch(r"(\d{1,6})(?:[xX](\d{1,6}))?", value)):
        return int(sides[1]), int(sides[2] or sides[1])
    return (value, value) if isinstance(value, int) and not isinstance(value, bool) else value


def _size(value: Any) -> Any:
    sides = _sides(value)
    if isinstance(sides, str):
        raise ValueError(f"must be N or HxW (height x width, px), as 512 or 512x768, got {sides[:40]!r}")
    return sides


SIDES = BeforeValidator(_sides)
"""takes ``512`` and ``512x768`` for a height and width"""
Side = Annotated[int, Field(ge=16, le=32768)]
Size = Annotated[
    tuple[Side, Side],
    BeforeValidator(_size),
    Field(description="height and width of the result, px"),
]
