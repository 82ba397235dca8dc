"""How results are delivered: colour space, physical size, and the layout of material sets."""

from __future__ import annotations

import dataclasses
import math
import re
from collections.abc import Callable, Mapping
from typing import Any

from texloom.pipelines.errors import hint, refused, shown
from texloom.pipelines.media import conventions
from texloom.pipelines.media.color_spaces import ACESCG, PRIMARIES, REC709, conversion, converted
from texloom.stages.vocabulary.arrays import Image
from texloom.stages.vocabulary.declare import InputError
from texloom.stages.vocabulary.frame_stacks import name_in_frame

_ONLY_READ = ("short_specular",)
SAME = "same"
"""layout of the exemplar: its names, packing, formats and bits"""
LAYOUTS = (*(name for name in conventions.LAYOUTS if name not in _ONLY_READ), SAME)
"""file names, channel packing, direction of green and bits that a material set can have"""
COLOR_SPACES: Mapping[str, str] = {"rec709": REC709, "acescg": ACESCG}
"""name on the command line to that in files"""
METRES: Mapping[str, float] = {"um": 1e-6, "mm": 1e-3, "cm": 1e-2, "m": 1.0, "in": 0.0254}
"""of units of length"""
_INCH = 0.0254  # m
_MAX_COLUMNS = 10  # of UDIM tiles
_MAX_ROWS = 100
_EMITTED = ("emissive.", "translucency.")


@dataclasses.dataclass(frozen=True)
class Delivery:
    """How exports are written."""

    layout: str | None = None
    """one of `LAYOUTS`; without one, folders of maps are like the exemplar's"""
    texel_size: float | None = None
    """side of a pixel, m"""
    color_space: str = REC709
    """of linear colour in EXR and tx"""
    udim: tuple[int, int] | None = None
    """rows and columns of the tiles that maps of a layout are cut into"""
    material: str | None = None
    """the name with which files of a layout begin; without one, that of the exemplar"""

    def encoded(self, image: Image) -> Image:
        """An image with its colours in `color_space`; grey ones as they are."""
        if self.color_space == REC709:
            return image
        matrix = conversion(PRIMARIES[REC709], PRIMARIES[self.color_space])
        pixels = image.pixels.copy()
        reds = [name for name in image.channels if name_in_frame(name) == "R"]
        for prefix in (*_EMITTED, *(name.removesuffix("R") for name in reds)):
            names = tuple(f"{prefix}{letter}" for letter in "RGB")
            if set(names) <= set(image.channels):
                places = [image.channels.index(name) for name in names]
                pixels[..., places] = converted(pixels[..., places], matrix)
        return image.with_pixels(pixels)

    def reduced(self, factor: float) -> Delivery:
        """Of a picture that becomes smaller by a factor: so much larger is the side of its pixels."""
        if self.texel_size is None or factor == 1:
            return self
        return dataclasses.replace(self, texel_size=self.texel_size / factor)

    def size(self, height: int, width: int) -> tuple[float, float] | None:
        """Height and width of a result of so many pixels, m."""
        return None if self.texel_size is None else (height * self.texel_size, width * self.texel_size)

    def exr_attributes(self, is_color: bool) -> dict[str, Any]:
        """Of an EXR's header: the colour space and, as pixels per inch, the physical size."""
        attributes: dict[str, Any] = {"colorInteropID": self.color_space if is_color else "data"}
        if is_color:
            attributes["chromaticities"] = PRIMARIES[self.color_space]
        if self.texel_size is not None:
            attributes["xDensity"] = _INCH / self.texel_size
        return attributes


AS_IS = Delivery()


Fail = Callable[[str, str], InputError]
"""makes the error of an option, by its name and the problem"""


def of_option(name: str, problem: str) -> InputError:
    """The error of an option of the command line."""
    return refused(f"--{name.replace('_', '-')}: {problem}")


def parse_delivery(options: Mapping[str, str], fail: Fail = of_option) -> Delivery:
    """The delivery by options of the command line or fields of a flow; `InputError` names one that is wrong.

    Parameters
    ----------
    options : ``layout``, ``texel_size`` as ``0.5mm``, ``color_space``, ``udim`` as ``3x2`` (columns x rows) and
        ``material``, those that are given.
    """
    layout, color_space = options.get("layout"), options.get("color_space", "rec709")
    if layout is not None and layout not in LAYOUTS:
        raise fail("layout", f"no layout {shown(layout)}{hint(layout, LAYOUTS)}")
    if color_space not in COLOR_SPACES:
        raise fail("color_space", f"no colour space {shown(color_space)}{hint(color_space, COLOR_SPACES)}")
    udim = _tiles(options["udim"], fail) if "udim" in options else None
    if udim is not None and layout == SAME:
        raise fail("udim", "not with the layout same, which has the exemplar's tiles")
    if udim is not None and layout is None:
        raise fail("udim", "needs a layout, whose maps are cut into tiles")
    material = options.get("material")
    if material is not None and layout in (None, SAME):
        raise fail("material", "needs a layout, whose files begin with it")
    if material is not None and not re.search(r"\w", material):
        raise fail("material", f"must have a letter or digit, got {shown(material)}")
    texel_size = _length(options["texel_size"], fail) if "texel_size" in options else None
    return Delivery(layout, texel_size, COLOR_SPACES[color_space], udim, material)


def _length(text: str, fail: Fail) -> float:
    found = re.fullmatch(r"(\d{1,9}(?:\.\d{1,9})?|\.\d{1,9})\s*(um|mm|cm|m|in)", text.strip())
    metres = float(found[1]) * METRES[found[2]] if found else 0.0
    if not 1e-9 <= metres <= 1e3 or not math.isfinite(metres):
        raise fail("texel_size", f"must be a length as 0.5mm, in um, mm, cm, m or in, got {shown(text)}")
    return metres


def _tiles(text: str, fail: Fail) -> tuple[int, int]:
    found = re.fullmatch(r"(\d{1,2})x(\d{1,3})", text)
    columns, rows = (int(found[1]), int(found[2])) if found else (0, 0)
    if not (1 <= rows <= _MAX_ROWS and 1 <= columns <= _MAX_COLUMNS):
        raise fail(
            "udim", f"must be COLUMNSxROWS as 3x2, at most {_MAX_COLUMNS} and {_MAX_ROWS}, got {shown(text)}"
        )
    return rows, columns
