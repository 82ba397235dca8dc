"""EXR files of named planes: all calls to OpenEXR, with workarounds for its defects.

EXR holds float16, float32 and uint32. Other types are stored without loss: bool as float16, small integers as
uint32 (negative ones modulo 2**32), 64-bit types as two uint32 planes, ``.low`` and ``.high``.
"""

from __future__ import annotations

import contextlib
import ctypes
import io
import math
import threading
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np

from texloom.pipelines.memory import check_memory
from texloom.pipelines.store import chunks
from texloom.stages.kernels.core.threads import thread_count
from texloom.stages.vocabulary.scratch import release
from texloom.stages.vocabulary.sizes import format_size

Planes = dict[str, np.ndarray]
"""2-D arrays of one size, by channel"""

_AS_IS = ("float16", "float32", "uint32")
_SMALL = ("bool", "int8", "int16", "int32", "uint8", "uint16")
_SPLIT = ("float64", "int64", "uint64")
STORABLE = (*_AS_IS, *_SMALL, *_SPLIT)
"""the dtypes that `stored` accepts"""
TILED = 2**22
"""pixels above which a part is tiled, so that viewers need not read all of it, and written and read in bands"""
_TILE = 256  # px
_ZSTD_LEVEL = 2  # that of OpenEXR, 5, takes four times the time for files that are 6 % smaller
_ROWS_OF_TILES = 4  # decoded at once
MAX_NAME = 255
"""bytes of a channel's name; OpenEXR truncates longer ones without an error"""


_guard = threading.Lock()
_inside = 0  # calls that have begun and not ended, on all threads
_before = contextlib.ExitStack()  # gives OpenEXR its settings back


@contextlib.contextmanager
def set_up() -> Iterator[None]:
    """Have OpenEXR use all threads, and a level of compression, inside the ``with`` block."""
    global _inside  # noqa: PLW0603 (the settings belong to the process)
    with _guard:
        if not _inside:
            _set()
        _inside += 1
    try:
        yield
    finally:
        with _guard:
            _inside -= 1
            if not _inside:
                _before.close()


def _set() -> None:
    import OpenEXR

    _before.callback(OpenEXR.set_global_thread_count, OpenEXR.global_thread_count())
    OpenEXR.set_global_thread_count(thread_count())
    with contextlib.suppress(AttributeError, OSError):  # builds may hide it
        library = ctypes.CDLL(OpenEXR.__file__)
        _before.callback(library.exr_set_default_zstd_compression_level, _zstd_level(library))
        library.exr_set_default_zstd_compression_level(_ZSTD_LEVEL)


def _zstd_level(library: Any) -> int:
    level = ctypes.c_int()
    library.exr_get_default_zstd_compression_level(ctypes.byref(level))
    return level.value


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
    """Write an EXR; parts of more than `TILED` pixels are tiled, and encoded one row of tiles at a time.

    Parameters
    ----------
    parts : planes of any storable dtype, at least one a part; all planes of a part have the same size.
    attributes : written to the first part's header.
    compression : OpenEXR's name, such as ``ZIP``.

    Raises
    ------
    OSError
        the file cannot be written, such as on a full disk.
    """
    shapes = {name: next(iter(planes.values())).shape for name, planes in parts.items()}
    display = next(iter(shapes.values()))  # must be equal for all parts
    whole: list[Any] = []
    for name, planes in parts.items():
        is_tiled = math.prod(shapes[name]) > TILED
        given = {} if whole else attributes
        shown = {channel: plane[:1, :1] for channel, plane in planes.items()} if is_tiled else planes
        whole.append(_part(name, shown, compression, is_tiled, display, given))
    if all(math.prod(shape) <= TILED for shape in shapes.values()):
        _write(whole, path)
        return
    version, layout, pieces = _encoded(whole)  # with one pixel of each part that is tiled
    sizes = [shapes[part.name or next(iter(parts))] for part in layout]
    layout = [part.resized(*size) if part.is_tiled else part for part, size in zip(layout, sizes, strict=True)]
    with path.open("wb") as file:
        writer = chunks.ChunkWriter(file, version, layout)
        for number, (name, part) in enumerate(zip(parts, layout, strict=True)):
            if not part.is_tiled:
                writer.add(number, pieces[number])
                continue
            for row, top in enumerate(range(0, shapes[name][0], _TILE)):
                band = {channel: plane[top : top + _TILE] for channel, plane in parts[name].items()}
                _, _, (tiles,) = _encoded([_part(name, band, compression, is_tiled=True)])
                writer.add(number, (tile.moved(row, 0) for tile in tiles))
                release(*parts[name].values())
        writer.finish()


def _part(
    name: str,
    planes: Planes,
    compression: str,
    is_tiled: bool,
    display: tuple[int, ...] | None = None,
    attributes: Mapping[str, Any] | None = None,
) -> Any:
    import OpenEXR

    shape = next(iter(planes.values())).shape
    header = {
        "type": OpenEXR.tiledimage if is_tiled else OpenEXR.scanlineimage,
        "compression": getattr(OpenEXR, f"{compression}_COMPRESSION"),
        "displayWindow": _window(*(display or shape)),
        "dataWindow": _window(*shape),
    }
    if is_tiled:
        header["tiles"] = _tiles()
    kept: Planes = {}
    for channel, plane in planes.items():
        kept |= stored(channel, plane)
    return OpenEXR.Part(header | dict(attributes or {}), kept, name)


def _write(parts: list[Any], target: Path | BinaryIO) -> None:
    import OpenEXR

    try:
        with set_up():
            OpenEXR.File(parts).write(str(target) if isinstance(target, Path) else target)
    except RuntimeError as error:  # also on a full disk
        raise OSError(f"{target}: {error}") from None


def _encoded(parts: list[Any]) -> tuple[int, list[chunks.ExrPart], list[list[chunks.Chunk]]]:
    """Version, parts and chunks of a file in memory."""
    file = io.BytesIO()
    _write(parts, file)
    version, layout = chunks.read_layout(file)
    return (
        version,
        layout,
        [
            [chunks.read_chunk(file, version, part, number) for number in range(len(part.offsets))]
            for part in layout
        ],
    )


def _tiles() -> Any:
    import OpenEXR

    tiles = OpenEXR.TileDescription()
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
    import OpenEXR

    try:
        with set_up():
            return list(OpenEXR.File(source, **options).parts)
    except RuntimeError:
        raise ValueError("not a whole EXR file") from None


def data_size(header: Mapping[str, Any]) -> tuple[int, int]:
    """Height and width of a part, px."""
    (left, top), (right, bottom) = (corner.tolist() for corner in header["dataWindow"])
    return bottom - top + 1, right - left + 1


def is_flat(header: Mapping[str, Any]) -> bool:
    """Whether a part has one sample a pixel, and not the lists of samples of deep images."""
    import OpenEXR

    return header["type"] in (OpenEXR.scanlineimage, OpenEXR.tiledimage)


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
            raise ValueError(f"{format_size((height, width))} are more than {largest} px")
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


class Windows:
    """An EXR file of which windows are read: only the tiles that they touch are decoded, or a part of lines whole.

    Raises
    ------
    ValueError : it is missing, damaged, or no image of pixels.
    """

    def __init__(self, path: Path):
        self.path = path
        if not path.is_file():
            raise ValueError("no such file")
        with path.open("rb") as file:
            self._version, parts = chunks.read_layout(file)
        self._parts = {part.name or "image": part for part in parts}

    def sizes(self) -> dict[str, tuple[int, int]]:
        """Height and width of each part, px."""
        return {name: part.size for name, part in self._parts.items()}

    def text(self, name: str) -> str:
        """An attribute of the first part's header; `KeyError` without one."""
        return next(iter(self._parts.values())).attributes[name][1].decode()

    def bands(self, part: str) -> list[slice]:
        """Rows of a part that are best read at a time: a few rows of tiles, or all lines."""
        layout = self._parts[part]
        step = _ROWS_OF_TILES * layout.tile[0] if layout.is_tiled else layout.size[0]
        return [slice(top, top + step) for top in range(0, layout.size[0], step)]

    def read(self, part: str, rows: slice, columns: slice) -> Planes:
        """The planes of a part, as they are stored, inside a window, which must be within it.

        Parameters
        ----------
        rows, columns : of pixels, without a step.
        """
        layout = self._parts[part]
        bounds = [window.indices(side) for window, side in zip((rows, columns), layout.size, strict=True)]
        if any(stop <= start or step != 1 for start, stop, step in bounds):
            raise ValueError(f"no pixels in rows {rows}, columns {columns} of {layout.size}")
        tops = [0, 0]
        version, shown = chunks.single(self._version, layout)
        if layout.is_tiled:
            lines = [
                range(start // step, -(-stop // step))
                for (start, stop, _), step in zip(bounds, layout.tile, strict=True)
            ]
            tops = [line.start * step for line, step in zip(lines, layout.tile, strict=True)]
            ends = [
                min(line.stop * step, side)
                for line, step, side in zip(lines, layout.tile, layout.size, strict=True)
            ]
            shown = shown.resized(ends[0] - tops[0], ends[1] - tops[1])
            numbers = [row * layout.tiles[1] + column for row in lines[0] for column in lines[1]]
        else:
            numbers = list(range(len(layout.offsets)))
        piece = io.BytesIO()
        writer = chunks.ChunkWriter(piece, version, [shown])
        with self.path.open("rb") as file:
            for number in numbers:
                chunk = chunks.read_chunk(file, self._version, layout, number)
                writer.add(0, [chunk.moved(-lines[0].start, -lines[1].start) if layout.is_tiled else chunk])
        writer.finish()
        (decoded,) = read_parts(piece, 1)
        inside = tuple(slice(start - top, stop - top) for (start, stop, _), top in zip(bounds, tops, strict=True))
        return {name: channel.pixels[inside] for name, channel in decoded.channels.items()}
