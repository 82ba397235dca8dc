"""Pictures that Pillow opens, such as PNG, JPEG and TIFF of up to 8 bits; OpenCV reads those with more bits."""

from __future__ import annotations

import functools
import importlib
from typing import Any, BinaryIO

import numpy as np
from jaxtyping import Float32

from texloom.pipelines.media import cicp, color_management, icc, picture_facts
from texloom.pipelines.media.headers import OpenedPicture, Refusal, check_size
from texloom.pipelines.media.pixel_values import decoded_by_opencv, decoding_of, floats
from texloom.pipelines.store.png_file import PROVENANCE, facts_in, texel_size_in

_ORIENTATION = 0x0112  # TIFF and EXIF tag
_EXTRA = {"JPEG": 6, "WebP": 8, "JPEG 2000": 16, "AVIF": 12, "HEIC": 12}
"""bytes per pixel that a library takes while it decodes: coefficients, canvases"""
_ALPHA = {"LA": "Y", "La": "Y", "RGBA": "RGB", "RGBa": "RGB", "PA": "RGB"}
_OPAQUE = {"1": "Y", "L": "Y", "I;16": "Y", "RGB": "RGB", "RGBX": "RGB", "P": "RGB"}


@functools.cache
def _plugin(kind: str) -> Any:
    """What opens files in Pillow. `PIL.Image.open` would import other formats too, and limits the size."""
    if kind == "HEIC":
        return importlib.import_module("pillow_heif").HeifImageFile
    name = {"WebP": "WebP", "JPEG 2000": "Jpeg2K"}.get(kind, kind.capitalize())
    module = importlib.import_module(f"PIL.{name}ImagePlugin")
    return getattr(module, f"{name}ImageFile")


def _opened(kind: str, file: BinaryIO) -> Any:
    """A file opened by Pillow, which would refuse large WebP as broken."""
    import PIL.Image

    most, PIL.Image.MAX_IMAGE_PIXELS = PIL.Image.MAX_IMAGE_PIXELS, None
    try:
        return _plugin(kind)(file)
    finally:
        PIL.Image.MAX_IMAGE_PIXELS = most


def header_of(kind: str, file: BinaryIO, data: bool) -> OpenedPicture:
    """The header of a picture that Pillow opens, of one of the kinds of `texloom.pipelines.media.formats`."""
    if kind == "WebP":
        file.seek(0)
        _check_webp(file.read(32))
    try:
        told = picture_facts.facts_of(kind, file)
    except ValueError as error:
        raise Refusal(str(error)) from None
    chunk = told.code_points if kind != "PNG" or data else cicp.chunk_of(file)
    file.seek(0)
    image = _opened(kind, file)
    width, height = image.size
    check_size(height, width)
    raw = raw_mode(image)
    depth = 16 if "16" in raw else told.depth
    if image.mode in _ALPHA:
        color, alpha = "Y" if raw == "LA;16B" else _ALPHA[image.mode], told.has_alpha
    elif image.mode in _OPAQUE:
        color, alpha = _OPAQUE[image.mode], "transparency" in image.info
    elif image.mode in ("CMYK", "LAB") and not data:
        color, alpha = "RGB", False
    else:
        raise Refusal(f"is a {image.mode} picture; convert it to grey or RGB")
    orientation = 1 if kind == "TIFF" else _orientation(image)  # Pillow turns TIFF itself
    if orientation >= 5:
        height, width = width, height
    channels = (*color, "A") if alpha else tuple(color)
    converted, decoding, note = None, None, ""
    if not data:
        converted, note = _managed(image, chunk, depth, len(color))
        if converted is None:
            decoding, note = decoding_of(image.info, len(color), chunk)

    def integers() -> np.ndarray:
        image.load()
        # Pillow keeps only 8 of 16 bits in colour, but detects damage.
        if depth > 8 and kind == "HEIC":
            values = _deep_heic(file, len(channels))
        elif depth > 8 and not (image.mode == "I;16" and kind != "JPEG 2000"):
            values = _all_bits(decoded_by_opencv(file, channels), told.depth)
        else:
            values = _values(image if converted is None else converted(image), raw, alpha)
        if told.is_two_channels:
            values = _with_blue(values)
        return _oriented(values[..., : len(channels)], orientation)

    def decode() -> Float32[np.ndarray, "h w c"]:
        return floats(integers(), len(channels) if data else alpha, decoding)

    bits = 16 if depth > 8 else 8
    is_shown = bits == 8 and not data and decoding is None
    # Pillow's pixels and what the format needs beside them, the integers with a copy, and the floats
    memory = height * width * (4 + _EXTRA.get(kind, 0) + len(channels) * (bits // 4 + 4))
    facts = facts_in(image.info.get(PROVENANCE), height, width)
    notes = [
        told.note,
        note,
        "has several frames, of which the first is read" if kind != "TIFF" and _is_animated(image) else "",
        "is turned as its EXIF orientation says" if orientation > 1 else "",
    ]
    return OpenedPicture(
        *(height, width, channels, bits, memory, decode, facts, "; ".join(filter(None, notes))),
        texel_size=texel_size_in(image.info.get(PROVENANCE), height, width),
        codes=integers if is_shown else None,
    )


def _is_animated(image: Any) -> bool:
    """Whether there are other frames than the first; a broken end of the file is told when it is decoded."""
    try:
        return getattr(image, "n_frames", 1) > 1
    except (EOFError, OSError, SyntaxError):
        return False


def _check_webp(start: bytes) -> None:
    """Check the size of a WebP before Pillow opens it and allocates its canvas."""
    if start[12:16] == b"VP8X":
        width, height = (int.from_bytes(start[at : at + 3], "little") + 1 for at in (24, 27))
        check_size(height, width)


def _managed(image: Any, chunk: bytes | None, depth: int, planes: int) -> tuple[Any, str]:
    """What converts a Pillow image by littleCMS, and what is told; none where a matrix with curves does."""
    profile = image.info.get("icc_profile")
    is_plain = image.mode not in ("CMYK", "LAB")
    if is_plain and (profile is None or chunk is not None or not icc.needs_tables(profile, planes)):
        return None, ""
    if depth > 8:  # see `_decoding`
        return None, ""
    if image.mode not in ("CMYK", "LAB", "L", "LA", "RGB", "RGBA"):
        raise Refusal(f"has an ICC profile of tables, which is not read for {image.mode}; convert it to sRGB")
    try:
        return color_management.conversion_of(image, profile)
    except ValueError as error:
        raise Refusal(str(error)) from None


def _all_bits(values: np.ndarray, depth: int) -> np.ndarray:
    """Codes of 9 to 15 bits as 16 bits, uint16; those of 8 or 16 bits unchanged."""
    if depth in (8, 16):
        return values
    largest = 2**depth - 1
    return np.asarray((values.astype(np.uint32) * 65535 + largest // 2) // largest, np.uint16)


def _deep_heic(file: BinaryIO, planes: int) -> np.ndarray:
    """The values of a HEIC of over 8 bits, uint16."""
    import pillow_heif

    file.seek(0)
    values = np.asarray(pillow_heif.open_heif(file, convert_hdr_to_8bit=False))
    return values.reshape(*values.shape[:2], -1)[..., :planes].astype(np.uint16, copy=False)


def _with_blue(values: np.ndarray) -> np.ndarray:
    """Integers of normals, whose blue is computed of red and green."""
    x, y = (values[..., index] / 127.5 - 1 for index in (0, 1))
    blue = np.sqrt(np.maximum(1 - x * x - y * y, 0))
    return np.concatenate([values[..., :2], np.rint((blue + 1) * 127.5).astype(np.uint8)[..., None]], axis=2)


def raw_mode(image: Any) -> str:
    """Pillow's name of how the values of a picture stand in its file, such as ``L;2``; empty where it has none."""
    args = image.tile[0].args if image.tile else ""
    mode = args[0] if isinstance(args, tuple) and args else args
    return mode if isinstance(mode, str) else ""


def _orientation(image: Any) -> int:
    """EXIF orientation, 1 to 8; 1 where it is absent or broken."""
    if "exif" not in image.info:  # a PNG would be decoded to look for it behind the pixels
        return 1
    try:
        value = image.getexif().get(_ORIENTATION, 1)
    except Exception:
        return 1
    return value if value in range(1, 9) else 1


def _oriented(values: np.ndarray, orientation: int) -> np.ndarray:
    """Apply an EXIF orientation; 5 to 8 swap rows and columns."""
    if orientation >= 5:
        values = values.swapaxes(0, 1)
    if orientation in (3, 4, 7, 8):
        values = values[::-1]
    if orientation in (2, 3, 6, 7):
        values = values[:, ::-1]
    return values


def _values(image: Any, raw: str, alpha: bool) -> np.ndarray:
    """The integers of a decoded Pillow image, (h, w, c)."""
    key = image.info.get("transparency") if image.mode in ("1", "L", "I;16", "RGB") else None
    modes = {"1": "L", "P": "RGBA" if alpha else "RGB", "PA": "RGBA", "RGBa": "RGBA", "La": "LA", "RGBX": "RGB"}
    wanted = modes.get(image.mode, image.mode)
    values = np.asarray(image if wanted == image.mode else image.convert(wanted))
    if values.ndim == 2:
        values = values[..., None]
    if key is None:
        return values
    if raw in ("L;2", "L;4"):  # Pillow scales the pixels to 8 bits, but not the key
        key = key * 255 // (2 ** int(raw[2:]) - 1)
    opaque = np.any(values != np.asarray(key), axis=2, keepdims=True)
    return np.concatenate([values, opaque * np.array(np.iinfo(values.dtype).max, values.dtype)], axis=2)
