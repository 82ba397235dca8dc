"""Decoding of pictures: headers first, then pixels in linear light.

Integer pictures are taken as sRGB (IEC 61966-2-1), or as the first of these says that there is: a PNG's cICP chunk,
an ICC profile, a PNG's gamma and chromaticities; float pictures as linear light with Rec.709 primaries, or those of
an EXR's header. Other primaries are converted to Rec.709, and may give negative values. Alpha is linear and
unchanged. Of several frames or pages the first is read. Integers of pictures that hold data, such as heights or
normals, are divided by the highest value of their type, and colour spaces do not matter. A JSON file of strokes is
the picture that they draw.
"""

from __future__ import annotations

import contextlib
import dataclasses
import functools
import importlib
import importlib.util
import threading
import warnings
from collections.abc import Iterator, Mapping
from typing import Any, BinaryIO

import numpy as np
from jaxtyping import Float32

from texloom.pipelines.media import (
    cicp,
    color_management,
    color_spaces,
    deep_psd,
    exr_pictures,
    formats,
    icc,
    picture_facts,
    radiance,
    strokes,
    tiff_values,
)
from texloom.pipelines.media.headers import Picture, Refusal, check_size
from texloom.pipelines.media.icc import Decoding
from texloom.pipelines.store.capture import capture_output
from texloom.pipelines.store.png_file import PROVENANCE, facts_in
from texloom.stages.vocabulary.color import linear_from_codes

_ORIENTATION = 0x0112  # TIFF and EXIF tag


def read_header(file: BinaryIO, data: bool = False, layered: bool = False) -> Picture:
    """The header of a picture file, whose content decides the format; `Refusal` where it cannot be read.

    What ``decode`` returns is contiguous, finite and in linear light; integers of ``data`` are divided by their
    highest value instead. With ``layered``, the parts of an EXR are the frames of a stack.
    """
    kind = formats.kind_of(file)
    if kind is None:
        raise Refusal(f"is not a picture that can be read; {formats.known_names()} can")
    if needs := formats.missing(kind):
        raise Refusal(f"is {kind}, which needs {needs}; pip install 'texloom[photos]'")
    with _guarded(kind, prints=kind in ("EXR", "TIFF", "HEIC")):
        if kind == "EXR":
            header = exr_pictures.stack_header_of(file) if layered else exr_pictures.header_of(file, data)
        elif kind == "JSON":
            header = _strokes_header(file)
        elif kind == "TIFF":
            header = _tiff_header(file, data)
        elif kind == "HDR":
            header = _hdr_header(file)
        elif kind == "PSD":
            header = _psd_header(file, data)
        else:
            if kind == "WebP":
                _check_webp(file.read(32))
            header = _pillow_header(kind, file, data)

    def decode() -> Float32[np.ndarray, "h w c"]:
        with _guarded(kind):
            pixels = header.decode()
        if pixels.shape != (header.height, header.width, len(header.channels)):
            raise Refusal(f"is a broken {kind} file (its pixels do not fit its header)")
        _check_finite(pixels, header.channels)
        return pixels

    return dataclasses.replace(header, decode=decode)


_libraries = threading.Lock()  # `_guarded` changes warning filters and streams of the whole process


@contextlib.contextmanager
def _guarded(kind: str, prints: bool = True) -> Iterator[None]:
    """Turn every error of a library into a `Refusal`.

    Parameters
    ----------
    prints : whether the library may print errors; keeping them back takes longer than reading a header.
    """
    kept_back = capture_output() if prints else contextlib.nullcontext()
    with _libraries, warnings.catch_warnings(), kept_back:
        warnings.simplefilter("ignore")
        try:
            yield
        except (Refusal, MemoryError):
            raise
        except Exception as error:
            message = next(iter(str(error).splitlines()), "")
            # Some messages are only a number or a missing key.
            reason = f" ({message[:100]})" if message.isprintable() and " " in message else ""
            raise Refusal(f"is a truncated or broken {kind} file{reason}") from None


def _check_finite(pixels: Float32[np.ndarray, "h w c"], channels: tuple[str, ...]) -> None:
    for index, channel in enumerate(channels):
        plane = pixels[..., index]
        bad = plane.size - int(np.count_nonzero(np.isfinite(plane)))
        if bad:
            raise Refusal(f"channel '{channel}' has {bad} of {plane.size} values NaN or infinite")


def _check_webp(start: bytes) -> None:
    """Check the size of a WebP before Pillow opens it and allocates its canvas."""
    if start[12:16] == b"VP8X":
        width, height = (int.from_bytes(start[at : at + 3], "little") + 1 for at in (24, 27))
        check_size(height, width)


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


def _pillow_header(kind: str, file: BinaryIO, data: bool) -> Picture:
    """Pictures that Pillow opens."""
    try:
        told = picture_facts.facts_of(kind, file)
    except ValueError as error:
        raise Refusal(str(error)) from None
    chunk = told.code_points if kind != "PNG" or data else cicp.chunk_of(file)
    file.seek(0)
    image = _opened(kind, file)
    width, height = image.size
    check_size(height, width)
    raw = _raw_mode(image)
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
            decoding, note = _decoding(image.info, len(color), chunk)

    def decode() -> Float32[np.ndarray, "h w c"]:
        image.load()
        # Pillow keeps only 8 of 16 bits in colour, but detects damage.
        if depth > 8 and kind == "HEIC":
            values = _deep_heic(file, len(channels))
        elif depth > 8 and not (image.mode == "I;16" and kind != "JPEG 2000"):
            values = _all_bits(_decoded_by_opencv(file, channels), told.depth)
        else:
            values = _values(image if converted is None else converted(image), raw, alpha)
        if told.is_two_channels:
            values = _with_blue(values)
        return _floats(
            _oriented(values[..., : len(channels)], orientation), len(channels) if data else alpha, decoding
        )

    bits = 16 if depth > 8 else 8
    # Pillow's pixels and what the format needs beside them, the integers with a copy, and the floats
    memory = height * width * (4 + _EXTRA.get(kind, 0) + len(channels) * (bits // 4 + 4))
    facts = facts_in(image.info.get(PROVENANCE), height, width)
    return Picture(height, width, channels, bits, memory, decode, facts, "; ".join(filter(None, (told.note, note))))


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


def _hdr_header(file: BinaryIO) -> Picture:
    """Radiance HDR: linear light, by OpenCV."""
    try:
        header = radiance.header_of(file)
    except ValueError as error:
        raise Refusal(str(error)) from None
    height, width = header.height, header.width
    check_size(height, width)
    note = "" if header.exposure == 1 else f"its EXPOSURE of {header.exposure:g} is not taken out"

    def decode() -> Float32[np.ndarray, "h w c"]:
        pixels = np.ascontiguousarray(_decoded_by_opencv(file, ("R", "G", "B")), np.float32)
        return pixels if header.matrix is None else color_spaces.converted(pixels, header.matrix)

    return Picture(height, width, ("R", "G", "B"), 32, height * width * 36, decode, note=note)


def _psd_header(file: BinaryIO, data: bool) -> Picture:
    """PSD, flattened: Pillow reads those of 8 bits, psd-tools the others."""
    start = file.read(26)
    height, width = (int.from_bytes(start[at : at + 4]) for at in (14, 18))
    if len(start) < 26:
        raise EOFError
    check_size(height, width)
    if start[4:6] == b"\0\1" and int.from_bytes(start[22:24]) <= 8:
        return _pillow_header("PSD", file, data)
    if importlib.util.find_spec(formats.DEEP_PSD) is None:
        raise Refusal(f"is a PSD of over 8 bits, which needs {formats.DEEP_PSD}; pip install 'texloom[photos]'")
    header = deep_psd.header_of(file)
    try:
        channels = deep_psd.channels_of(header)
    except ValueError as error:
        raise Refusal(str(error)) from None
    planes, alpha = len(channels), "A" in channels
    info = {"icc_profile": deep_psd.profile_of(file)}
    decoding, note = (None, "") if data or header.depth == 32 else _decoding(info, planes - alpha)

    def decode() -> Float32[np.ndarray, "h w c"]:
        return _floats(deep_psd.values_of(file, header, planes), planes if data else alpha, decoding)

    memory = height * width * (header.channels * header.depth // 4 + planes * 8)
    return Picture(height, width, channels, header.depth, memory, decode, note=note)


def _decoding(
    info: Mapping[str, Any], planes: int, chunk: bytes | None = None
) -> tuple[Decoding | color_management.Tables | None, str]:
    """How a picture that is not sRGB is decoded, and what was assumed; ``chunk``: the content of cICP."""
    profile = info.get("icc_profile")
    try:
        if chunk is not None:
            return cicp.decoding_of(chunk)
        if planes == len("CMYK") or (profile and icc.needs_tables(profile, planes)):
            return color_management.of_tables(profile)
        return (icc.of_profile(profile, planes) if profile else icc.of_png(info)), ""
    except ValueError as error:
        raise Refusal(str(error)) from None


def _raw_mode(image: Any) -> str:
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


def _decoded_by_opencv(file: BinaryIO, channels: tuple[str, ...]) -> np.ndarray:
    """The values of a PNG or TIFF with all their bits, (h, w, c)."""
    import cv2

    file.seek(0)
    log = cv2.utils.logging
    level = log.getLogLevel()
    log.setLogLevel(log.LOG_LEVEL_SILENT)
    try:
        values: np.ndarray | None = cv2.imdecode(np.frombuffer(file.read(), np.uint8), cv2.IMREAD_UNCHANGED)
    finally:
        log.setLogLevel(level)
    if values is None:
        raise ValueError("cannot be decoded")
    if values.ndim == 2:
        return np.repeat(values[..., None], 1 if channels[0] == "Y" else len(channels), axis=2)
    if channels[0] == "Y":  # OpenCV gives grey with alpha as colour
        return values[..., [0, -1]]
    values[..., [0, 2]] = values[..., [2, 0]]  # from B G R
    return values


def _floats(
    values: np.ndarray, straight_planes: int, decoding: Decoding | color_management.Tables | None = None
) -> Float32[np.ndarray, "h w c"]:
    """Linear light of sRGB integers of 8 or 16 bits, or of floats, which are linear already.

    The last ``straight_planes`` are not sRGB: they are divided by the highest value of their type. ``decoding``
    replaces sRGB.
    """
    if values.dtype == np.float32:
        return np.ascontiguousarray(values)
    if decoding is None:
        return linear_from_codes(values, straight_planes)
    colors = values.shape[2] - straight_planes
    light = decoding.linear(values[..., :colors])
    if not straight_planes:
        return light
    return np.concatenate([light, linear_from_codes(values[..., colors:], straight_planes)], axis=2)


def _tiff_header(file: BinaryIO, data: bool) -> Picture:
    """TIFF, with what of it is not read."""
    from PIL.TiffImagePlugin import ImageFileDirectory_v2

    start = file.read(8)
    start += file.read(8) if b"+" in start[:4] else b""
    tags = ImageFileDirectory_v2(start)
    file.seek(tags.next)
    tags.load(file)
    found = _tiff_page(file, tags, data)
    left = tags.get(277, 1) - len(found.channels) if tags.get(262) in (1, 2) else 0
    notes = [
        found.note,
        "its last channel is not read, as the header does not say what it holds" if left else "",
        "has several pages, of which the first is read" if tags.next else "",
    ]
    return dataclasses.replace(found, note="; ".join(filter(None, notes)))


def _tiff_page(file: BinaryIO, tags: Any, data: bool) -> Picture:
    """The first page of a TIFF: Pillow reads up to 8 bits, OpenCV 16 bits and floats."""
    width, height, planes = tags[256], tags[257], tags.get(277, 1)
    bits, kinds = set(tags.get(258, (1,))), set(tags.get(339, (1,)))
    check_size(height, width)
    if planes > 4:
        raise Refusal(f"has {planes} channels, at most 4 in TIFF")
    if kinds == {1} and max(bits) <= 8:
        file.seek(0)
        return _pillow_header("TIFF", file, data)
    names = {(1, 1): "Y", (3, 2): "RGB", (4, 2): "RGBA", (4, 5): "RGB"}.get((planes, tags.get(262)))
    is_cmyk = tags.get(262) == 5
    if names is None or (is_cmyk and (data or (kinds, bits) != ({1}, {16}))):
        raise Refusal("is neither plain grey nor RGB nor RGBA; convert it")
    if tags.get(274, 1) != 1:
        raise Refusal("is turned by its orientation tag; save it upright")
    by_opencv = (kinds, bits) in (({1}, {16}), ({3}, {32}))
    # OpenCV would read nonsense of planar ones, and sRGB of CMYK.
    if not by_opencv or is_cmyk or (planes > 1 and tags.get(284, 1) != 1):
        return _odd_tiff_header(file, tags, names, data)

    is_integer = kinds == {1}
    profile = {"icc_profile": tags.get(34675)}
    decoding, note = _decoding(profile, min(planes, 3)) if is_integer and not data else (None, "")

    def decode() -> Float32[np.ndarray, "h w c"]:
        return _floats(_decoded_by_opencv(file, tuple(names)), planes if data else planes == 4, decoding)

    memory = height * width * (4 + planes * (max(bits) // 4 + 4))
    return Picture(height, width, tuple(names), max(bits), memory, decode, note=note)


def _odd_tiff_header(file: BinaryIO, tags: Any, names: str, data: bool) -> Picture:
    """TIFF of planes apart, of signed integers, or of half or double floats, by tifffile."""
    try:
        kinds, bits_of = set(tags.get(339, (1,))), set(tags.get(258, (1,)))
        kind, note = tiff_values.kind_of(kinds, bits_of, tags.get(259, 1), tags.get(317, 1))
    except ValueError as error:
        raise Refusal(str(error)) from None
    height, width, planes = tags[257], tags[256], tags.get(277, 1)
    profile, alpha = {"icc_profile": tags.get(34675)}, names == "RGBA"
    decoding = None
    if kind == np.uint16 and not data:
        decoding, note = _decoding(profile, planes - alpha)

    def decode() -> Float32[np.ndarray, "h w c"]:
        values = tiff_values.values_of(file, planes)
        return _floats(values, planes if data else int(alpha), decoding)

    memory = height * width * planes * (2 * kind.itemsize + 8)
    bits = 16 if kind == np.uint16 else 32
    return Picture(height, width, tuple(names), bits, memory, decode, note=note)


def _strokes_header(file: BinaryIO) -> Picture:
    try:
        drawn = strokes.parse(file.read())
    except ValueError as error:
        raise Refusal(f"is JSON, but not of strokes: {error}") from None
    check_size(drawn.height, drawn.width)
    return Picture(drawn.height, drawn.width, ("Y",), 8, 9 * drawn.height * drawn.width, drawn.draw)
