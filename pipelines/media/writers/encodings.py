"""Integers and floats of a map as a file of the format that its name says, for maps written as they came."""

from __future__ import annotations

import io
from pathlib import Path
from typing import Any

import numpy as np

from texloom.pipelines.store.codec import ArtifactError

_OWN = (".png", ".exr", ".tx")
"""of other writers"""
_BY_PILLOW: dict[str, tuple[str, dict[str, Any]]] = {
    ".tga": ("TGA", {"compression": "tga_rle"}),
    ".dds": ("DDS", {}),
    ".webp": ("WebP", {"lossless": True, "quality": 50, "exact": True}),
    ".jp2": ("JPEG2000", {}),
    ".j2k": ("JPEG2000", {}),
    ".jpx": ("JPEG2000", {}),
    ".avif": ("AVIF", {"quality": 95, "subsampling": "4:4:4"}),
}
"""suffix to format and options; they hold 8 bits"""
_BY_OPENCV = {".tif": (8, 16, 32), ".tiff": (8, 16, 32), ".hdr": (32,)}
"""suffix to the bits that it holds"""
_WITHOUT_ALPHA = (".jpg", ".jpeg", ".bmp")
"""with 8 bits"""
_PLANES = {2: (".tga", ".jp2", ".j2k", ".jpx", ".avif", ".webp"), 4: (*_BY_PILLOW, ".tif", ".tiff")}
"""which hold grey with alpha, and colour with alpha"""


def can_encode(suffix: str, bits: int, planes: int) -> bool:
    """Whether a format is written with values of 8, 16 or 32 bits (floats) in so many planes."""
    suffix = suffix.lower()
    if suffix in _OWN or not suffix:
        return True
    if planes in _PLANES and suffix not in _PLANES[planes]:
        return False
    held = (8,) if suffix in _BY_PILLOW or suffix in _WITHOUT_ALPHA else _BY_OPENCV.get(suffix, ())
    return bits in held


def encoded(values: np.ndarray, path: Path, bits: int) -> bytes:
    """The content of a file of values, (h, w, c), uint8, uint16 or float32, in the format of its name.

    Raises
    ------
    ArtifactError
        The format does not hold such values.
    """
    import cv2
    import PIL.Image

    suffix = path.suffix.lower()
    if not can_encode(suffix, bits, values.shape[2]):
        raise ArtifactError(f"{path}: cannot be written with {values.shape[2]} channels of {bits} bits")
    if suffix in _BY_PILLOW:
        kind, options = _BY_PILLOW[suffix]
        buffer = io.BytesIO()
        picture = PIL.Image.fromarray(values[..., 0] if values.shape[2] == 1 else values)
        picture.save(buffer, kind, **options)
        return buffer.getvalue()
    # channels may be maps of their own, which a lower resolution of chroma would mix
    full = [cv2.IMWRITE_JPEG_SAMPLING_FACTOR, cv2.IMWRITE_JPEG_SAMPLING_FACTOR_444]
    options_of = [cv2.IMWRITE_JPEG_QUALITY, 95, *full] if suffix in (".jpg", ".jpeg") else []
    order = [2, 1, 0, *range(3, values.shape[2])] if values.shape[2] > 2 else [0]
    done, content = cv2.imencode(suffix, np.ascontiguousarray(values[..., order]), options_of)
    if not done:
        raise ArtifactError(f"{path}: the file could not be made")
    return content.tobytes()
