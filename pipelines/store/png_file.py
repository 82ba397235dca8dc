"""PNG files of pictures larger than memory, written strip by strip."""

from __future__ import annotations

import json
import struct
import zlib
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np

from texloom.pipelines.store.atomic import atomic_path, file_digest

LARGE = 2**24
"""pixels of a picture above which it is written in strips"""
_COLOR_TYPES = {1: 0, 2: 4, 3: 2, 4: 6}  # by number of channels: grey, grey and alpha, RGB, RGBA
_SUB = 1  # filter: each byte less that of the pixel on its left


def write_png(
    path: Path, height: int, width: int, strips: Iterable[np.ndarray], provenance: Mapping[str, Any] | None = None
) -> str:
    """Write a PNG, complete or not at all; its digest (SHA-256).

    Parameters
    ----------
    strips : uint8 or uint16, (rows, width, c), from top to bottom, with 1 to 4 channels.
    provenance : stored as JSON in its text ``texloom.provenance``.
    """
    compressor = zlib.compressobj(1)
    with atomic_path(path) as temporary:
        with temporary.open("wb") as file:
            is_first = True
            for strip in strips:
                if is_first:
                    _begin(file, height, width, strip, provenance)
                    is_first = False
                _chunk(file, b"IDAT", compressor.compress(_filtered(strip)))
            _chunk(file, b"IDAT", compressor.flush())
            _chunk(file, b"IEND", b"")
        return file_digest(temporary)


def _begin(
    file: BinaryIO, height: int, width: int, strip: np.ndarray, provenance: Mapping[str, Any] | None
) -> None:
    file.write(b"\x89PNG\r\n\x1a\n")
    kind = (8 * strip.dtype.itemsize, _COLOR_TYPES[strip.shape[2]], 0, 0, 0)
    _chunk(file, b"IHDR", struct.pack(">2I5B", width, height, *kind))
    if provenance is not None:
        _chunk(file, b"iTXt", b"texloom.provenance\0\0\0\0\0" + json.dumps(provenance).encode())


def _filtered(strip: np.ndarray) -> bytes:
    rows = np.ascontiguousarray(strip.astype(strip.dtype.newbyteorder(">"), copy=False))
    values = rows.view(np.uint8).reshape(len(strip), strip.shape[1], -1)
    lines = np.empty((len(strip), 1 + values[0].size), np.uint8)
    lines[:, 0] = _SUB
    differences = lines[:, 1:].reshape(values.shape)
    differences[:, 0] = values[:, 0]
    np.subtract(values[:, 1:], values[:, :-1], out=differences[:, 1:])
    return lines.tobytes()


def _chunk(file: BinaryIO, kind: bytes, content: bytes) -> None:
    file.write(struct.pack(">I", len(content)) + kind + content)
    file.write(struct.pack(">I", zlib.crc32(content, zlib.crc32(kind))))
