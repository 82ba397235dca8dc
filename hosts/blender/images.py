"""Images of Blender as arrays, and results as new images, which are packed into the file."""

from __future__ import annotations

import tempfile
from pathlib import Path
from typing import Any

import bpy
import numpy as np

from . import pixels
from .texloom_client import Pixels, TexloomError

LINEAR = "Linear Rec.709"
EXEMPLAR = "texloom_exemplar"
"""the property of a result that names the picture that it was made from"""


def read(image: bpy.types.Image) -> np.ndarray:
    """R G B A as `pixels.to_array`; an image that has no pixels is refused."""
    width, height = image.size
    if not width or not height:
        raise TexloomError(f"{image.name}: has no pixels; is its file there?")
    if image.source not in ("FILE", "GENERATED"):
        raise TexloomError(f"{image.name}: {image.source.lower()} cannot be used; give a single picture")
    flat = np.empty(width * height * image.channels, np.float32)
    image.pixels.foreach_get(flat)
    is_data = image.colorspace_settings.is_data
    values = pixels.to_array(flat, width, height, image.channels, image.is_float, is_data)
    return values.repeat(3, 2) if values.shape[2] == 1 else values


def named(name: str, what: str) -> bpy.types.Image:
    """The image of a name."""
    image = bpy.data.images.get(name)
    if image is None:
        raise TexloomError(f"{what}: {f'{name}: there is no such picture' if name else 'no picture is chosen'}")
    return image


def sent(image: bpy.types.Image) -> Any:
    """What texloom is sent of an image: R G B, or R G B A where some of it is transparent."""
    return pixels.without_alpha(read(image))


def new(name: str, made: Pixels, like: bpy.types.Image | None, exemplar: str) -> bpy.types.Image:
    """A result as a new image with the colour space of the picture that it is like."""
    flat, is_float, has_alpha = pixels.to_flat(made)
    height, width = made.shape[:2]
    image = bpy.data.images.new(name, width, height, alpha=has_alpha, float_buffer=is_float)
    if like is not None and (like.colorspace_settings.is_data or not is_float):
        image.colorspace_settings.name = like.colorspace_settings.name
    elif is_float:
        image.colorspace_settings.name = LINEAR
    image.pixels.foreach_set(flat)
    image.update()
    image.pack()
    image[EXEMPLAR] = exemplar
    return image


def loaded(content: bytes, file: str, is_color: bool) -> bpy.types.Image:
    """A PNG of a layout as a packed image with all its bits."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder, Path(file).name)
        path.write_bytes(content)
        image = bpy.data.images.load(str(path))
        image.colorspace_settings.name = "sRGB" if is_color else "Non-Color"
        image.pack()
    image.filepath_raw = ""
    image.name = Path(file).stem
    return image
