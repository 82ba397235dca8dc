"""The part of an exemplar that a flow takes, and its size: what ``--crop`` and ``--reduce`` ask for."""

from __future__ import annotations

import dataclasses
import hashlib
import json
import re
from collections.abc import Mapping

import numpy as np

from texloom.pipelines.errors import refused, shown
from texloom.pipelines.media.delivery import Fail, of_option
from texloom.stages.vocabulary.arrays import Image
from texloom.stages.vocabulary.masks import EXCLUSION_CHANNELS, valid_pixels
from texloom.stages.vocabulary.normals import NORMAL, unit
from texloom.stages.vocabulary.sizes import format_size

_LOBES = 3  # of the filter, in pixels of the result, that reach beyond a border
_MADE = 1  # raised where the same part has other pixels


@dataclasses.dataclass(frozen=True)
class Part:
    """A box of a picture, and how much smaller it becomes."""

    size: tuple[int, int] | None = None
    """height and width of the box, px; None is the whole picture"""
    at: tuple[int, int] | None = None
    """its top row and left column; None is in the middle"""
    reduce: float = 1.0
    """factor on the sides, above 0 to 1"""

    def box(self, height: int, width: int) -> tuple[int, int, int, int]:
        """Top, left, height and width in a picture; `InputError` where it is not inside."""
        rows, columns = self.size or (height, width)
        top, left = self.at or ((height - rows) // 2, (width - columns) // 2)
        if min(top, left) < 0 or top + rows > height or left + columns > width:
            at = "" if self.at is None else f"+{left}+{top}"
            raise refused(f"--crop {columns}x{rows}{at}: is not inside {format_size((height, width))}")
        return top, left, rows, columns

    def outline(self, height: int, width: int) -> tuple[int, int]:
        """Height and width of what is taken of a picture, px; `InputError` as of `box`."""
        sides = self.box(height, width)[2:]
        rows, columns = (max(1, round(side * self.reduce)) for side in sides)
        return rows, columns

    def digest(self, whole: str) -> str:
        """Of the content, by that of the whole picture; 64 hexadecimal digits."""
        content = [whole, self.size, self.at, self.reduce, _MADE]
        return hashlib.sha256(json.dumps(content).encode()).hexdigest()

    def of(self, image: Image, is_label: bool = False) -> Image:
        """What is taken of a picture; it wraps as `texloom.stages.vocabulary.facts` says, if reduced as before.

        Parameters
        ----------
        is_label : its values are not mixed.
        """
        size = self.outline(image.height, image.width)
        top, left, rows, columns = self.box(image.height, image.width)
        if self.size is not None:
            image = image.cropped(slice(top, top + rows), slice(left, left + columns))
        return image if self.reduce == 1 else _reduced(image, size, is_label)


WHOLE = Part()


def parse_part(options: Mapping[str, str], fail: Fail = of_option) -> Part:
    """The part by options of the command line or fields of a flow; `InputError` names one that is wrong.

    Parameters
    ----------
    options : ``crop`` as ``1024x768+200+0`` (width x height + left + top) or ``1024x768`` of the middle, and
        ``reduce`` as ``0.5``, those that are given.
    """
    size = at = None
    if "crop" in options:
        found = re.fullmatch(r"(\d{1,6})x(\d{1,6})(?:\+(\d{1,6})\+(\d{1,6}))?", options["crop"].strip())
        if found is None or 0 in (int(found[1]), int(found[2])):
            form = "WIDTHxHEIGHT+LEFT+TOP as 1024x768+200+0, or WIDTHxHEIGHT of the middle, px"
            raise fail("crop", f"must be {form}, got {shown(options['crop'])}")
        size = int(found[2]), int(found[1])
        at = None if found[3] is None else (int(found[4]), int(found[3]))
    factor = 1.0
    if "reduce" in options:
        text = options["reduce"].strip()
        factor = float(text) if re.fullmatch(r"\d?\.\d{1,6}|1", text) else 0.0
        if not 0.01 <= factor <= 1:
            raise fail("reduce", f"must be a factor from 0.01 to 1, as 0.5, got {shown(options['reduce'])}")
    return Part(size, at, factor)


def _reduced(image: Image, size: tuple[int, int], is_label: bool) -> Image:
    """A picture of another size; excluded pixels have no influence on others, and normals have length 1."""
    if is_label:
        rows, columns = (
            (2 * np.arange(side) + 1) * own // (2 * side) for side, own in zip(size, image.shape, strict=False)
        )
        return image.with_pixels(np.ascontiguousarray(image.pixels[rows[:, None], columns]))
    valid = valid_pixels(image)
    share = np.ones(size, np.float32) if valid is None else _plane(valid.astype(np.float32), size, image)
    pixels = np.empty((*size, len(image.channels)), np.float32)
    for number, name in enumerate(image.channels):
        plane = image.pixels[..., number]
        if valid is None or name in EXCLUSION_CHANNELS:
            pixels[..., number] = _plane(plane, size, image)
        else:
            known = _plane(np.where(valid, plane, 0), size, image) / np.maximum(share, np.float32(1e-6))
            pixels[..., number] = np.where(share > 0, np.clip(known, plane.min(), plane.max()), 0)
    if set(NORMAL) <= set(image.channels):
        places = [image.channels.index(name) for name in NORMAL]
        pixels[..., places] = unit(pixels[..., places])
    return image.with_pixels(pixels)


def _plane(plane: np.ndarray, size: tuple[int, int], image: Image) -> np.ndarray:
    """A plane in another size, in its range; across borders at which the picture wraps it goes on."""
    margins = [
        -(-_LOBES * own // side) if is_around else 0
        for own, side, is_around in zip(plane.shape, size, image.wraps, strict=True)
    ]
    from PIL import Image as Pillow

    padded = np.pad(plane, [(margin, margin) for margin in margins], mode="wrap")
    box = (margins[1], margins[0], margins[1] + plane.shape[1], margins[0] + plane.shape[0])
    resized = Pillow.fromarray(padded).resize(size[::-1], Pillow.Resampling.LANCZOS, box)
    return np.asarray(np.clip(np.asarray(resized), plane.min(), plane.max()))
