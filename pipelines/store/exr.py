"""EXR files of named planes: all calls to OpenEXR, with workarounds for its defects.

EXR holds float16, float32 and uint32. Other types are stored without loss: bool as float16, small integers as
uint32 (negative ones modulo 2**32), 64-bit types as two uint32 planes, ``.low`` and ``.high``.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from functools import cache
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np

from texloom.pipelines.memory import check_memory
from texloom.stages.kernels.core.threads import thread_count

Planes = dict[str, np.ndarray]
"""2-D arrays of one size, by channel"""

_AS_IS = ("float16", "float32", "uint32")
_SMALL = ("bool", "int8", "int16", "int32", "uint8", "uint16")
_SPLIT = ("float64", "int64", "uint64")
STORABLE = (*_AS_IS, *_SMALL, *_SPLIT)
"""the dtypes that `stored` accepts"""
TILED = 2**22
"""pixels above which a part is tiled, so that viewers need not read all of it"""
_TILE = 256  # px
MAX_NAME = 255
"""bytes of a channel's name; OpenEXR truncates longer ones without an error"""


@cache
def _openexr() -> Any:
    import OpenEXR

    OpenEXR.set_global_thread_count(thread_count())
    return OpenEXR


def stored(name: str, plane: np.ndarray) -> Planes:
    """The planes in which EXR stores a plane of any storable dtype."""
    plane = np.ascontiguousarray(plane)  # OpenEXR writes others incorrectly without an error
    dtype = plane.dtype
    if dtype.name in _SPLIT:
        bits = plane.view(np.uint64)
        halves = {"low": bits & 0xFFFFFFFF, "high": bits >> 32}
        return {f"{name}.{half}": values.astype(np.uint32) for half, values in halves.items()}
    return {name: plane.astype(_stored_dtype(dtype), copy=False)}


def _stored_dtype(dtype: np.dtype) -> str:
    return dtype.name if dtype.name in _AS_IS else "float16" if dtype.name == "bool" else "uint32"


def restored(name: str, planes: Planes, dtype: np.dtype) -> np.ndarray:
    """Remove from ``planes`` what `stored` made of a plane and restore it; `ValueError` if it is wrong."""
    if dtype.name in _SPLIT:
        low, high = (_taken(planes, f"{name}.{half}", "uint32").astype(np.uint64) for half in ("low", "high"))
        return (low | high << np.uint64(32)).view(dtype)
    return _taken(planes, name, _stored_dtype(dtype)).astype(dtype, copy=False)


def _taken(planes: Planes, name: str, dtype: str) -> np.ndarray:
    if name not in planes:
        raise ValueError(f"channel {name} is missing")
    plane = planes.pop(name)
    if plane.dtype != dtype:
        raise ValueError(f"channel {name} is {plane.dtype}, not {dtype}")
    return plane


def write(path: Path, parts: Mapping[str, Planes], attributes: Mapping[str, Any], compression: str) -> None:
    """Write an EXR; parts of more than `TILED` pixels are tiled.

    Parameters
    ----------
    parts : planes from `stored`, at least one a part; all planes of a part have the same size.
    attributes : written to the first part's header.
    compression : OpenEXR's name, such as ``ZIP``.

    Raises
    ------
    OSError
        the file cannot be written, such as on a full disk.
    """
    openexr = _openexr()
    shapes = {name: next(iter(planes.values())).shape for name, planes in parts.items()}
    file_parts: list[Any] = []
    for name, planes in parts.items():
        header = {
            "type": openexr.scanlineimage,
            "compression": getattr(openexr, f"{compression}_COMPRESSION"),
            "displayWindow": _window(*next(iter(shapes.values()))),  # must be equal for all parts
            "dataWindow": _window(*shapes[name]),
        }
        if shapes[name][0] * shapes[name][1] > TILED:
            header |= {"type": openexr.tiledimage, "tiles": _tiles(openexr)}
        file_parts.append(openexr.Part(header | ({} if file_parts else dict(attributes)), dict(planes), name))
    try:
        openexr.File(file_parts).write(str(path))
    except RuntimeError as error:  # also on a full disk
        raise OSError(f"{path}: {error}") from None


def _tiles(openexr: Any) -> Any:
    tiles = openexr.TileDescription()
    tiles.xSize = tiles.ySize = _TILE
    return tiles


def _window(height: int, width: int) -> tuple[np.ndarray, np.ndarray]:
    return np.zeros(2, np.int32), np.array([width - 1, height - 1], np.int32)


def read_headers(file: Path | BinaryIO) -> list[dict[str, Any]]:
    """The headers of all parts; `ValueError` where the file is damaged."""
    return [part.header for part in _parts(file, header_only=True)]


def read_parts(file: Path | BinaryIO, count: int) -> list[Any]:
    """All parts with separate channels; `ValueError` where the file is damaged or has not ``count`` parts."""
    parts = _parts(file, separate_channels=True)
    if len(parts) != count:  # OpenEXR omits parts that it cannot read, without an error
        raise ValueError("not a whole EXR file")
    return parts


def _parts(file: Path | BinaryIO, **options: bool) -> list[Any]:
    source = str(file) if isinstance(file, Path) else file
    if source is file:
        file.seek(0)
    try:
        return list(_openexr().File(source, **options).parts)
    except RuntimeError:
        raise ValueError("not a whole EXR file") from None


def data_size(header: Mapping[str, Any]) -> tuple[int, int]:
    """Height and width of a part, px."""
    (left, top), (right, bottom) = (corner.tolist() for corner in header["dataWindow"])
    return bottom - top + 1, right - left + 1


def is_flat(header: Mapping[str, Any]) -> bool:
    """Whether a part has one sample a pixel, and not the lists of samples of deep images."""
    return header["type"] in (_openexr().scanlineimage, _openexr().tiledimage)


def load(path: Path, pixels: bool = True, largest: int | None = None) -> tuple[dict[str, Any], dict[str, Planes]]:
    """The header of an EXR's first part, and its planes by part and channel.

    Parameters
    ----------
    pixels : whether the planes are read.
    largest : maximum number of pixels of a part of a file from elsewhere, which must also fit into the memory.

    Raises
    ------
    ValueError
        the file is missing, damaged or too large.
    """
    if not path.is_file():
        raise ValueError("is a folder, not an EXR file" if path.is_dir() else "no such file")
    headers = read_headers(path)
    for header in headers:
        height, width = data_size(header)
        if largest is not None and height * width > largest:
            raise ValueError(f"{height}x{width} px are more than {largest} px")
    needed = sum(4 * math.prod(data_size(header)) * len(header["channels"]) for header in headers)
    if pixels and largest is not None and (problem := check_memory(needed)):
        raise ValueError(problem)
    parts = read_parts(path, len(headers)) if pixels else []
    planes = {
        part.name() or "image": {
            name: channel.pixels
            for name, channel in part.channels.items()
            if channel.pixels.ndim == 2 and channel.pixels.dtype.name in _AS_IS  # others are in deep files
        }
        for part in parts
    }
    return headers[0], planes
