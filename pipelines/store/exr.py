"""EXR files of named planes: the few calls to OpenEXR, with its traps fenced off.

EXR holds float16, float32 and uint32. Other types are stored without loss: bool as float16, small integers as
uint32 (negative ones modulo 2**32), 64-bit types as two uint32 planes, ``.low`` and ``.high``.
"""

from __future__ import annotations

from collections.abc import Mapping
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

from texloom.stages.kernels.core.threads import thread_count

Planes = dict[str, np.ndarray]
"""2-D arrays of one size, by channel"""

_AS_IS = ("float16", "float32", "uint32")
_SMALL = ("bool", "int8", "int16", "int32", "uint8", "uint16")
_SPLIT = ("float64", "int64", "uint64")
STORABLE = (*_AS_IS, *_SMALL, *_SPLIT)
"""the dtypes that `stored` takes"""
TILED = 2**22
"""pixels above which a part is cut into tiles, so that viewers need not read it whole"""
_TILE = 256  # px
LONGEST_NAME = 255
"""bytes of a channel's name; OpenEXR cuts off the rest without an error"""


@cache
def _openexr() -> Any:
    import OpenEXR

    OpenEXR.set_global_thread_count(thread_count())
    return OpenEXR


def stored(name: str, plane: np.ndarray) -> Planes:
    """A plane of any storable dtype as the planes that EXR can hold."""
    plane = np.ascontiguousarray(plane)  # OpenEXR writes others wrong without an error
    dtype = plane.dtype
    if dtype.name in _SPLIT:
        bits = plane.view(np.uint64)
        halves = {"low": bits & 0xFFFFFFFF, "high": bits >> 32}
        return {f"{name}.{half}": values.astype(np.uint32) for half, values in halves.items()}
    if dtype.name in _AS_IS:
        return {name: plane}
    if dtype.name == "bool":
        return {name: plane.astype(np.float16)}
    return {name: plane.astype(np.uint32)}


def restored(name: str, planes: Planes, dtype: np.dtype) -> np.ndarray:
    """Take the plane that `stored` got out of ``planes``; `ValueError` if it is missing or of another type."""
    if dtype.name in _SPLIT:
        low, high = (_taken(planes, f"{name}.{half}", "uint32").astype(np.uint64) for half in ("low", "high"))
        return (low | high << np.uint64(32)).view(dtype)
    if dtype.name in _AS_IS:
        return _taken(planes, name, dtype.name)
    if dtype.name == "bool":
        return _taken(planes, name, "float16").astype(bool)
    return _taken(planes, name, "uint32").astype(dtype)


def _taken(planes: Planes, name: str, dtype: str) -> np.ndarray:
    if name not in planes:
        raise ValueError(f"channel {name} is missing")
    plane = planes.pop(name)
    if plane.dtype != dtype:
        raise ValueError(f"channel {name} is {plane.dtype}, not {dtype}")
    return plane


def write(path: Path, parts: Mapping[str, Planes], attributes: Mapping[str, str], compression: str) -> None:
    """Write an EXR; parts of more than `TILED` pixels are tiled.

    Parameters
    ----------
    parts : planes as `stored` gives them, at least one a part; all planes of a part have one size.
    attributes : stand in the first part's header.
    compression : OpenEXR's name for it, such as ``ZIP``.
    """
    openexr = _openexr()
    shapes = {name: next(iter(planes.values())).shape for name, planes in parts.items()}
    made: list[Any] = []
    for name, planes in parts.items():
        header = {
            "type": openexr.scanlineimage,
            "compression": getattr(openexr, f"{compression}_COMPRESSION"),
            "displayWindow": _window(*next(iter(shapes.values()))),  # the format wants the same for all parts
            "dataWindow": _window(*shapes[name]),
        }
        if shapes[name][0] * shapes[name][1] > TILED:
            header |= {"type": openexr.tiledimage, "tiles": _tiles(openexr)}
        made.append(openexr.Part(header | ({} if made else dict(attributes)), dict(planes), name))
    try:
        openexr.File(made).write(str(path))
    except RuntimeError as error:  # as OpenEXR says that a disk is full
        raise OSError(f"{path}: {error}") from None


def _tiles(openexr: Any) -> Any:
    tiles = openexr.TileDescription()
    tiles.xSize = tiles.ySize = _TILE
    return tiles


def _window(height: int, width: int) -> tuple[np.ndarray, np.ndarray]:
    return np.zeros(2, np.int32), np.array([width - 1, height - 1], np.int32)


def load(path: Path, pixels: bool = True, largest: int | None = None) -> tuple[dict[str, Any], dict[str, Planes]]:
    """The header of an EXR's first part, and all planes by part and channel.

    Parameters
    ----------
    pixels : whether planes are wanted.
    largest : most pixels that a part may have.

    Raises
    ------
    ValueError
        The file is missing, broken, or too large.
    """
    openexr = _openexr()
    if not path.is_file():
        raise ValueError("a folder" if path.is_dir() else "no such file")
    try:
        heads = openexr.File(str(path), header_only=True).parts
        for head in heads:
            first, last = head.header["dataWindow"]  # columns before rows
            width, height = (int(end) - int(start) + 1 for start, end in zip(first, last, strict=True))
            if largest is not None and height * width > largest:
                raise ValueError(f"{height}x{width} px are more than {largest} px")
        parts = openexr.File(str(path), separate_channels=True).parts if pixels else []
    except RuntimeError:
        raise ValueError("not a whole EXR file") from None
    if pixels and len(parts) < len(heads):  # OpenEXR leaves out what it cannot read, without an error
        raise ValueError("not a whole EXR file")
    planes = {
        part.name() or "image": {
            name: channel.pixels
            for name, channel in part.channels.items()
            if channel.pixels.ndim == 2 and channel.pixels.dtype.name in _AS_IS  # others are in deep files
        }
        for part in parts
    }
    return heads[0].header, planes
