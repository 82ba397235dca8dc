"""The vocabulary of the stages: what arrays are called, their axes, their units.

Rows come before columns everywhere; sizes are (height, width); pixel centres stand at whole numbers.
Axis names: ``h w`` an exemplar, ``H W`` a result, ``c`` channels.
"""

from __future__ import annotations

import dataclasses
from typing import Annotated

import numpy as np
from jaxtyping import Bool, Float32, UInt32


@dataclasses.dataclass(frozen=True)
class Channels:
    """Names the planes of an array's last axis when it is written to a file."""

    names: tuple[str, ...]


@dataclasses.dataclass(frozen=True)
class Layers:
    """Names the planes of an array's first axis when it is written to a file."""

    names: tuple[str, ...]


@dataclasses.dataclass(frozen=True)
class Image:
    """A picture: colour in linear light with Rec.709 primaries, and whatever rides along.

    ``channels`` starts with ``R G B`` or, for a grey picture, ``Y``; ``A`` and further maps may follow.
    """

    pixels: Float32[np.ndarray, "h w c"]
    """linear light; 1 is diffuse white, values above 1 are allowed"""
    channels: tuple[str, ...]
    """one name a plane"""

    def __post_init__(self) -> None:
        if self.pixels.ndim != 3 or self.pixels.shape[2] != len(self.channels):
            raise ValueError(f"image of shape {self.pixels.shape} with channels {self.channels}")

    @property
    def height(self) -> int:
        """Rows."""
        return int(self.pixels.shape[0])

    @property
    def width(self) -> int:
        """Columns."""
        return int(self.pixels.shape[1])

    @property
    def color(self) -> Float32[np.ndarray, "h w 3"]:
        """Linear Rec.709 colour; a grey picture is repeated in the three channels."""
        if self.channels[0] == "Y":
            return np.repeat(self.pixels[..., :1], 3, axis=2)
        return self.pixels[..., :3]


Mask = Bool[np.ndarray, "h w"]
"""true where something is"""

ScalarMap = Float32[np.ndarray, "h w"]
"""one value a pixel"""

ColorField = Annotated[Float32[np.ndarray, "h w 3"], Channels(("L", "a", "b"))]
"""CIELAB (D65): L in 0..100, a and b about -100..100"""

Correspondence = Annotated[UInt32[np.ndarray, "H W 2"], Channels(("row", "column"))]
"""for every pixel of a result the exemplar pixel that it comes from"""

Vectors = Annotated[Float32[np.ndarray, "n 2"], Channels(("row", "column"))]
"""displacements in pixels, one a row"""

Jacobian = Annotated[
    Float32[np.ndarray, "h w 4"], Channels(("row.down", "row.across", "column.down", "column.across"))
]
"""how texture lies in a picture: the first two are the picture's rows that one unit down and one unit across in the
texture go, the last two its columns; 1 0 0 1 is flat"""

Spreadsheet = Annotated[str, "csv"]
"""comma-separated values, a line of names first"""

Page = Annotated[str, "html"]
"""a self-contained HTML document"""
