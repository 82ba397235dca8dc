"""Strokes as lists of points: a JSON file that stands for a picture of lines, white on black.

    {"size": "512x384", "strokes": [[[10, 20], [40, 200.5]], [[300, 20], [280, 90], [300, 400]]], "width": 3}

``size`` is the width x height of the picture, px; each stroke is a list of at least two points, (row, column) in
px; ``width`` of the lines may be left out.
"""

from __future__ import annotations

import dataclasses
import json
import math
from typing import Annotated, Any

import numpy as np
import pydantic
from jaxtyping import Float32

from texloom.stages.vocabulary.declare import first_problem
from texloom.stages.vocabulary.sizes import SIDES, format_size

_LARGEST = 2**22  # bytes
_POINTS = 100_000
_PIXELS = 2**26  # of the picture that a few bytes ask for
_WIDTHS = (1, 255)  # px
_BEYOND = 2**15  # px that a point may lie beyond the picture
_SIZE = pydantic.TypeAdapter(Annotated[tuple[pydantic.PositiveInt, pydantic.PositiveInt], SIDES])
_FRACTION = 4  # bits of a pixel by which lines are drawn


@dataclasses.dataclass(frozen=True)
class Strokes:
    """Lines and the picture that they are drawn in."""

    height: int
    width: int
    lines: tuple[np.ndarray, ...]
    """(n, 2) rows and columns of each, px"""
    thickness: int

    def draw(self) -> Float32[np.ndarray, "h w 1"]:
        """The lines, 1 on 0, with soft borders."""
        import cv2

        canvas = np.zeros((self.height, self.width), np.uint8)
        lines = [np.rint(line[:, ::-1] * 2**_FRACTION).astype(np.int32) for line in self.lines]
        cv2.polylines(canvas, lines, False, 255, self.thickness, cv2.LINE_AA, _FRACTION)
        return (canvas / np.float32(255))[..., None]


def parse(content: bytes) -> Strokes:
    """Read a file's content; `ValueError` says what is wrong with it."""
    if len(content) > _LARGEST:
        raise ValueError(f"{len(content)} bytes are too many for strokes, at most {_LARGEST}")
    try:
        document = json.loads(content)
    except (ValueError, RecursionError):
        raise ValueError("it is not JSON") from None
    if not isinstance(document, dict) or not {"size", "strokes"} <= set(document) <= {"size", "strokes", "width"}:
        raise ValueError("strokes are a mapping with 'size', 'strokes' and, if need be, 'width'")
    size, strokes, thickness = document["size"], document["strokes"], document.get("width", 3)
    try:
        size = _SIZE.validate_python(size)
    except pydantic.ValidationError as error:
        raise ValueError(f"size: {first_problem(error)}") from None
    if size[0] * size[1] > _PIXELS:
        raise ValueError(f"a size of {format_size(size)} is too large, at most {_PIXELS} pixels of strokes")
    if type(thickness) is not int or not _WIDTHS[0] <= thickness <= _WIDTHS[1]:
        raise ValueError(f"width must be a whole number from {_WIDTHS[0]} to {_WIDTHS[1]}, px")
    if not _is_list(strokes) or not strokes:
        raise ValueError("strokes must be a list of lines")
    if sum(len(line) for line in strokes if _is_list(line)) > _POINTS:
        raise ValueError(f"strokes of more than {_POINTS} points")
    lines = [_line(number, line, size) for number, line in enumerate(strokes, 1)]
    return Strokes(size[0], size[1], tuple(lines), thickness)


def _line(number: int, line: Any, size: tuple[int, int]) -> np.ndarray:
    def is_inside(point: Any) -> bool:
        return _is_list(point, 2) and all(
            type(at) in (int, float) and math.isfinite(at) and -_BEYOND <= at <= side + _BEYOND
            for at, side in zip(point, size, strict=True)
        )

    if not _is_list(line) or len(line) < 2 or not all(map(is_inside, line)):
        raise ValueError(f"stroke {number} must be a list of two or more points [row, column], px")
    return np.array(line, np.float64)


def _is_list(value: Any, length: int | None = None) -> bool:
    return isinstance(value, list) and (length is None or len(value) == length)
