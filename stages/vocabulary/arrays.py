"""The vocabulary of the stages: what arrays are called, their axes, their units.

Rows come before columns everywhere; sizes are (height, width); pixel centres stand at whole numbers.
Axis names: ``h w`` an exemplar, ``H W`` a result, ``c`` channels.
"""

from __future__ import annotations

import dataclasses
import logging
from typing import Annotated, Any, TypeAlias

import numpy as np
from jaxtyping import Bool, Float32, UInt8, UInt32

from texloom.stages.vocabulary.color import linear_from_codes, srgb_codes
from texloom.stages.vocabulary.declare import InputError
from texloom.stages.vocabulary.facts import UNKNOWN, Facts, Wraps

_LOG = logging.getLogger(__name__)


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
    facts: Facts = UNKNOWN
    """what holds for it; see `texloom.stages.vocabulary.facts` for what becomes of them"""

    def __post_init__(self) -> None:
        if self.pixels.dtype != np.float32:
            raise TypeError(
                f"pixels are {self.pixels.dtype}, not linear light in float32; Image.of(array) converts an array"
            )
        if self.pixels.ndim != 3 or self.pixels.shape[2] != len(self.channels):
            raise ValueError(f"image of shape {self.pixels.shape} with channels {self.channels}")

    @classmethod
    def of(cls, array: np.ndarray) -> Image:
        """Convert an array to an image.

        Parameters
        ----------
        array : (h, w), (h, w, 1), (h, w, 3) or (h, w, 4): grey, colour, colour and alpha. uint8 and uint16 are sRGB
            and decoded; floats are linear light already and must be finite. Pixels that a NumPy mask covers
            get 0 in a further channel ``usable``, which excludes them.

        Examples
        --------
        >>> import numpy as np
        >>> Image.of(np.array([[0, 188, 255]], np.uint8)).pixels[..., 0].round(2)
        array([[0. , 0.5, 1. ]], dtype=float32)
        """
        if isinstance(array, np.ma.MaskedArray):
            array, usable = split_mask(array)
            image = cls.of(array)
            if usable.all():
                return image
            _LOG.warning("%d masked pixels are excluded", usable.size - np.count_nonzero(usable))
            pixels = np.concatenate([image.pixels, usable[..., None].astype(np.float32)], axis=2)
            return cls(pixels, (*image.channels, "usable"))
        planes = array[..., None] if array.ndim == 2 else array
        count = planes.shape[-1] if planes.ndim == 3 else 0
        channels = {1: ("Y",), 3: ("R", "G", "B"), 4: ("R", "G", "B", "A")}.get(count)
        if channels is None or 0 in planes.shape:
            raise InputError(f"an array of shape {array.shape} is no image; (h, w), (h, w, 3) and (h, w, 4) are")
        if planes.dtype in (np.uint8, np.uint16):
            return cls(linear_from_codes(planes, int(len(channels) == 4)), channels)
        if planes.dtype.kind != "f":
            raise InputError(f"an array of {array.dtype} is no image; uint8, uint16 (sRGB) and floats (linear) are")
        with np.errstate(over="ignore"):
            pixels = np.ascontiguousarray(planes, np.float32)
        if not np.isfinite(pixels).all():
            raise InputError("an image has values that are NaN or infinite")
        return cls(pixels, channels)

    def with_pixels(self, pixels: Float32[np.ndarray, "h w k"], channels: tuple[str, ...] | None = None) -> Image:
        """Other values at the same places, of the same channels unless given; facts are kept."""
        names = self.channels if channels is None else channels
        return Image(pixels, names, self.facts.within(names))

    def elsewhere(self, pixels: Float32[np.ndarray, "H W k"], channels: tuple[str, ...] | None = None) -> Image:
        """Values of this picture at other places, of the same channels unless given.

        The facts of its maps are kept; it does not wrap.
        """
        names = self.channels if channels is None else channels
        return Image(pixels, names, dataclasses.replace(self.facts.within(names), wraps=Wraps()))

    def cropped(self, rows: slice, columns: slice) -> Image:
        """A part, copied; it wraps along the sides that are whole."""
        pixels, wraps = np.ascontiguousarray(self.pixels[rows, columns]), self.wraps
        whole = Wraps(pixels.shape[0] == self.height, pixels.shape[1] == self.width)
        return Image(pixels, self.channels, dataclasses.replace(self.facts, wraps=wraps & whole))

    def wrapping(self, wraps: Wraps | bool) -> Image:
        """The same picture, which continues across these borders; across all or none by a truth value."""
        wraps = wraps if isinstance(wraps, Wraps) else Wraps(wraps, wraps)
        return dataclasses.replace(self, facts=dataclasses.replace(self.facts, wraps=wraps))

    @property
    def wraps(self) -> Wraps:
        """Across which of its borders it continues."""
        return self.facts.wraps

    def __array__(self, dtype: Any = None, copy: bool | None = None) -> np.ndarray:
        """The pixels, for ``numpy.asarray(image)``."""
        return np.array(self.pixels, dtype, copy=copy)

    @property
    def shape(self) -> tuple[int, ...]:
        """Rows, columns, channels."""
        return tuple(self.pixels.shape)

    @property
    def srgb(self) -> UInt8[np.ndarray, "h w 3"]:
        """The colour as 8-bit sRGB, clipped to 0..1."""
        return srgb_codes(self.color)

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


Mask: TypeAlias = Bool[np.ndarray, "h w"]
"""true where something is"""


def split_mask(array: np.ma.MaskedArray[Any, Any]) -> tuple[np.ndarray, Bool[np.ndarray, "h w"]]:
    """The values of a masked array, (h, w, ...), 0 where masked; and true where none of a pixel is, (h, w)."""
    masked = np.ma.getmaskarray(array)
    usable = ~(masked if masked.ndim < 3 else masked.any(axis=2))
    return np.where(masked, np.zeros((), array.dtype), array.data), usable


ScalarMap: TypeAlias = Float32[np.ndarray, "h w"]
"""one value a pixel"""

ColorField = Annotated[Float32[np.ndarray, "h w 3"], Channels(("L", "a", "b"))]
"""CIELAB (D65): L in 0..100, a and b about -100..100"""

Correspondence = Annotated[UInt32[np.ndarray, "H W 2"], Channels(("row", "column"))]
"""for every pixel of a result the exemplar pixel that it comes from"""

Vectors = Annotated[Float32[np.ndarray, "n 2"], Channels(("row", "column"))]
"""displacements in pixels, one a row"""

Quads = Annotated[Float32[np.ndarray, "n 4 2"], Channels(("row", "column"))]
"""corners of rectangles in perspective, px, clockwise in the picture"""

Jacobian = Annotated[
    Float32[np.ndarray, "h w 4"], Channels(("row.down", "row.across", "column.down", "column.across"))
]
"""how texture lies in a picture: the first two are the picture's rows that one unit down and one unit across in the
texture go, the last two its columns; 1 0 0 1 is flat"""

Mesh = Annotated[
    Float32[np.ndarray, "corners 12"],
    Channels(
        (
            "x", "y", "z", "normal.x", "normal.y", "normal.z", "u", "v",
            "direction.x", "direction.y", "direction.z", "control",
        )
    ),
]  # fmt: skip
"""triangles, three rows each, counter-clockwise seen from outside: position in world units, unit normal, texture
coordinates with v up, direction in which the texture's top lies, and control, 0..1; NaN where there is none"""

Spreadsheet = Annotated[str, "csv"]
"""comma-separated values, a line of names first"""

Glsl = Annotated[str, "glsl"]
"""source text of a shader in GLSL"""

Hlsl = Annotated[str, "hlsl"]
"""source text of a shader in HLSL"""

GodotShader = Annotated[str, "gdshader"]
"""source text of a shader in the language of Godot 4"""

Osl = Annotated[str, "osl"]
"""source text of a shader in Open Shading Language"""

TiledTileset = Annotated[str, "tsx"]
"""a tile set of Tiled"""

GodotTileset = Annotated[str, "tres"]
"""a tile set of Godot 4, a text resource"""

UnityAsset = Annotated[str, "asset"]
"""an asset of Unity, in its YAML"""

UnityMeta = Annotated[str, "meta"]
"""how Unity imports the file whose name it continues, in its YAML"""

MaterialX = Annotated[str, "mtlx"]
"""a MaterialX document"""

Page = Annotated[str, "html"]
"""a self-contained HTML document; a run that exports it fills elements with ``data-run="NAME"``, where NAME is
``title``, ``name`` (of the picture), ``about`` or ``command``"""
