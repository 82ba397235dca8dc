"""TIFF: by Pillow up to 8 bits, by OpenCV those of 16 bits and of floats, by tifffile what these do not read."""

from __future__ import annotations

import dataclasses
from typing import Any, BinaryIO

import numpy as np
from jaxtyping import Float32

from texloom.pipelines.media import pillow_pictures, tiff_values
from texloom.pipelines.media.cie_lab import Lab
from texloom.pipelines.media.headers import OpenedPicture, Refusal, check_size
from texloom.pipelines.media.pixel_values import decoded_by_opencv, decoding_of, floats

_CIE_LAB, _OTHER_LAB = 8, (9, 10)  # photometric interpretations; ICC and ITU Lab have other codes


def header_of(file: BinaryIO, data: bool) -> OpenedPicture:
    """The header of a TIFF, with what of it is not read."""
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


def _tiff_page(file: BinaryIO, tags: Any, data: bool) -> OpenedPicture:
    """The first page of a TIFF: Pillow reads up to 8 bits, OpenCV 16 bits and floats."""
    width, height, planes = tags[256], tags[257], tags.get(277, 1)
    bits, kinds = set(tags.get(258, (1,))), set(tags.get(339, (1,)))
    check_size(height, width)
    if planes > 4:
        raise Refusal(f"has {planes} channels, at most 4 in TIFF")
    if kinds == {1} and max(bits) <= 8:
        file.seek(0)
        return pillow_pictures.header_of("TIFF", file, data)
    names = {(1, 1): "Y", (3, 2): "RGB", (4, 2): "RGBA", (4, 5): "RGB"}.get((planes, tags.get(262)))
    is_cmyk = tags.get(262) == 5
    if tags.get(274, 1) != 1:
        raise Refusal("is turned by its orientation tag; save it upright")
    if tags.get(262) in (_CIE_LAB, *_OTHER_LAB) and not data:
        return _lab_header(file, tags)
    if names is None or (is_cmyk and (data or (kinds, bits) != ({1}, {16}))):
        raise Refusal("is neither plain grey nor RGB nor RGBA; convert it")
    by_opencv = (kinds, bits) in (({1}, {16}), ({3}, {32}))
    # OpenCV would read nonsense of planar ones, and sRGB of CMYK.
    if not by_opencv or is_cmyk or (planes > 1 and tags.get(284, 1) != 1):
        return _odd_tiff_header(file, tags, names, data)

    is_integer = kinds == {1}
    profile = {"icc_profile": tags.get(34675)}
    decoding, note = decoding_of(profile, min(planes, 3)) if is_integer and not data else (None, "")

    def decode() -> Float32[np.ndarray, "h w c"]:
        return floats(decoded_by_opencv(file, tuple(names)), planes if data else planes == 4, decoding)

    memory = height * width * (4 + planes * (max(bits) // 4 + 4))
    return OpenedPicture(height, width, tuple(names), max(bits), memory, decode, note=note)


def _lab_header(file: BinaryIO, tags: Any) -> OpenedPicture:
    """TIFF of CIE L*a*b* with 16 bits a channel, by tifffile."""
    kinds, bits = set(tags.get(339, (1,))), set(tags.get(258, (1,)))
    if (tags.get(262), tags.get(277), kinds, bits) != (_CIE_LAB, 3, {1}, {16}):
        raise Refusal("is Lab, but not plain CIE L*a*b* of 8 or 16 bits; save it as RGB of 16 bits")
    try:
        tiff_values.kind_of(kinds, bits, tags.get(259, 1), tags.get(317, 1))
    except ValueError as error:
        raise Refusal(str(error)) from None
    height, width = tags[257], tags[256]

    def decode() -> Float32[np.ndarray, "h w c"]:
        return floats(tiff_values.values_of(file, 3), 0, Lab())

    note = "its colour is converted from CIE Lab (D50)"
    return OpenedPicture(height, width, ("R", "G", "B"), 16, height * width * 72, decode, note=note)


def _odd_tiff_header(file: BinaryIO, tags: Any, names: str, data: bool) -> OpenedPicture:
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
        decoding, note = decoding_of(profile, planes - alpha)

    def decode() -> Float32[np.ndarray, "h w c"]:
        values = tiff_values.values_of(file, planes)
        return floats(values, planes if data else int(alpha), decoding)

    memory = height * width * planes * (2 * kind.itemsize + 8)
    bits = 16 if kind == np.uint16 else 32
    return OpenedPicture(height, width, tuple(names), bits, memory, decode, note=note)
