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
import importlib.util
import threading
import warnings
from collections.abc import Callable, Iterator
from typing import BinaryIO

import numpy as np
from jaxtyping import Float32

from texloom.pipelines.media import (
    color_spaces,
    deep_psd,
    exr_pictures,
    formats,
    pillow_pictures,
    radiance,
    strokes,
    tiff_pictures,
)
from texloom.pipelines.media.headers import OpenedPicture, Refusal, check_size
from texloom.pipelines.media.pixel_values import decoded_by_opencv, decoding_of, floats
from texloom.pipelines.store.capture import capture_output


def read_header(file: BinaryIO, data: bool = False, layered: bool = False) -> OpenedPicture:
    """The header of a picture file, whose content decides the format; `Refusal` where it cannot be read.

    What ``decode`` returns is contiguous, finite and in linear light; integers of ``data`` are divided by their
    highest value instead. With ``layered``, the parts of an EXR are the frames of a stack.
    """
    kind = formats.kind_of(file)
    if kind is None and formats.is_archive(file):
        raise Refusal("is a ZIP archive; unpack it, and give its folder")
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
            header = tiff_pictures.header_of(file, data)
        elif kind == "HDR":
            header = _hdr_header(file)
        elif kind == "PSD":
            header = _psd_header(file, data)
        else:
            header = pillow_pictures.header_of(kind, file, data)

    def guarded(read: Callable[[], np.ndarray]) -> np.ndarray:
        with _guarded(kind):
            pixels = read()
        if pixels.shape != (header.height, header.width, len(header.channels)):
            raise Refusal(f"is a broken {kind} file (its pixels do not fit its header)")
        return pixels

    def decode() -> Float32[np.ndarray, "h w c"]:
        pixels = guarded(header.decode)
        _check_finite(pixels, header.channels)
        return pixels

    codes = None if header.codes is None else functools.partial(guarded, header.codes)
    return dataclasses.replace(header, decode=decode, codes=codes)


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


def _hdr_header(file: BinaryIO) -> OpenedPicture:
    """Radiance HDR: linear light, by OpenCV."""
    try:
        header = radiance.header_of(file)
    except ValueError as error:
        raise Refusal(str(error)) from None
    height, width = header.height, header.width
    check_size(height, width)
    note = "" if header.exposure == 1 else f"its EXPOSURE of {header.exposure:g} is not taken out"

    def decode() -> Float32[np.ndarray, "h w c"]:
        pixels = np.ascontiguousarray(decoded_by_opencv(file, ("R", "G", "B")), np.float32)
        return pixels if header.matrix is None else color_spaces.converted(pixels, header.matrix)

    return OpenedPicture(height, width, ("R", "G", "B"), 32, height * width * 36, decode, note=note)


def _psd_header(file: BinaryIO, data: bool) -> OpenedPicture:
    """PSD, flattened: Pillow reads those of 8 bits, psd-tools the others."""
    start = file.read(26)
    height, width = (int.from_bytes(start[at : at + 4]) for at in (14, 18))
    if len(start) < 26:
        raise EOFError
    check_size(height, width)
    if start[4:6] == b"\0\1" and int.from_bytes(start[22:24]) <= 8:
        return pillow_pictures.header_of("PSD", file, data)
    if importlib.util.find_spec(formats.DEEP_PSD) is None:
        raise Refusal(f"is a PSD of over 8 bits, which needs {formats.DEEP_PSD}; pip install 'texloom[photos]'")
    header = deep_psd.header_of(file)
    try:
        channels = deep_psd.channels_of(header)
    except ValueError as error:
        raise Refusal(str(error)) from None
    planes, alpha = len(channels), "A" in channels
    info = {"icc_profile": deep_psd.profile_of(file)}
    decoding, note = (None, "") if data or header.depth == 32 else decoding_of(info, planes - alpha)

    def decode() -> Float32[np.ndarray, "h w c"]:
        return floats(deep_psd.values_of(file, header, planes), planes if data else alpha, decoding)

    memory = height * width * (header.channels * header.depth // 4 + planes * 8)
    return OpenedPicture(height, width, channels, header.depth, memory, decode, note=note)


def _strokes_header(file: BinaryIO) -> OpenedPicture:
    try:
        drawn = strokes.parse(file.read())
    except ValueError as error:
        raise Refusal(f"is JSON, but not of strokes: {error}") from None
    check_size(drawn.height, drawn.width)
    return OpenedPicture(drawn.height, drawn.width, ("Y",), 8, 9 * drawn.height * drawn.width, drawn.draw)
