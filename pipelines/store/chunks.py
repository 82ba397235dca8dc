"""The layout of EXR files, by which they are written and read in pieces: headers, tables of offsets, chunks.

OpenEXR's Python module encodes and decodes whole files only. A chunk, a tile or some lines, is encoded by itself
however, so a file is put together from the chunks of small files, and a small file from some chunks of a large one
("OpenEXR File Layout", openexr.com).
"""

from __future__ import annotations

import dataclasses
import math
import struct
from collections.abc import Iterable, Mapping, Sequence
from typing import BinaryIO

import numpy as np

_MAGIC = b"\x76\x2f\x31\x01"
_TILED, _MULTIPART = 0x200, 0x1000  # flags of the version
_IS_TILED = {b"tiledimage": True, b"scanlineimage": False}
_MAX_ATTRIBUTE = 2**28  # bytes
_MAX_CHUNKS = 2**26


@dataclasses.dataclass(frozen=True)
class Chunk:
    """Some pixels of a part, encoded."""

    place: tuple[int, ...]
    """column and row of a tile, and its two levels; or the first line"""
    content: bytes

    def moved(self, rows: int, columns: int) -> Chunk:
        """A tile so many tiles further down and to the right."""
        column, row, *levels = self.place
        return Chunk((column + columns, row + rows, *levels), self.content)


@dataclasses.dataclass(frozen=True)
class ExrPart:
    """A part of a file, without its pixels."""

    attributes: Mapping[str, tuple[bytes, bytes]]
    """name to type and value"""
    is_tiled: bool
    offsets: Sequence[int]
    """where its chunks begin in the file"""

    @property
    def name(self) -> str:
        """Empty where it has none."""
        return self.attributes.get("name", (b"", b""))[1].decode()

    @property
    def size(self) -> tuple[int, int]:
        """Height and width, px."""
        left, top, right, bottom = struct.unpack("<4i", self.attributes["dataWindow"][1])
        return bottom - top + 1, right - left + 1

    @property
    def tile(self) -> tuple[int, int]:
        """Height and width of a tile, px."""
        across, down, mode = struct.unpack("<2IB", self.attributes["tiles"][1])
        if mode & 0xF or not across or not down:
            raise ValueError("several levels")
        return down, across

    @property
    def tiles(self) -> tuple[int, int]:
        """Number of tiles down and across."""
        down, across = (-(-side // step) for side, step in zip(self.size, self.tile, strict=True))
        return down, across

    def resized(self, height: int, width: int) -> ExrPart:
        """The same part of another size, in tiles, from pixel 0, 0 on."""
        window = struct.pack("<4i", 0, 0, width - 1, height - 1)
        part = dataclasses.replace(self, attributes={**self.attributes, "dataWindow": (b"box2i", window)})
        part = dataclasses.replace(part, offsets=[0] * math.prod(part.tiles))
        if "chunkCount" in part.attributes:
            count = struct.pack("<i", len(part.offsets))
            part = dataclasses.replace(part, attributes={**part.attributes, "chunkCount": (b"int", count)})
        return part


def read_layout(file: BinaryIO) -> tuple[int, list[ExrPart]]:
    """The version of a file with its flags, and the parts.

    Raises
    ------
    ValueError : it is no EXR file, is damaged, or has other parts than tiles of one level and lines.
    """
    try:
        return _read_layout(file)
    except (struct.error, KeyError, IndexError, UnicodeDecodeError):
        raise ValueError("not a whole EXR file") from None


def _read_layout(file: BinaryIO) -> tuple[int, list[ExrPart]]:
    file.seek(0)
    if file.read(4) != _MAGIC:
        raise ValueError("not an EXR file")
    (version,) = struct.unpack("<I", file.read(4))
    headers: list[dict[str, tuple[bytes, bytes]]] = []
    while attributes := _attributes(file):
        headers.append(attributes)
        if not version & _MULTIPART:
            break
    parts = []
    for attributes in headers:
        given = attributes.get("type", (b"", b"tiledimage" if version & _TILED else b"scanlineimage"))[1]
        if given not in _IS_TILED:
            raise ValueError("not an image of pixels")
        part = ExrPart(attributes, _IS_TILED[given], ())
        start = file.tell()
        if "chunkCount" in attributes:
            (count,) = struct.unpack("<i", attributes["chunkCount"][1])
        elif part.is_tiled:
            count = math.prod(part.tiles)
        else:  # the lines of a chunk depend on the compression, but the first one follows the table
            (first,) = struct.unpack("<Q", file.read(8))
            count = (first - start) // 8
            file.seek(start)
        if not 0 < count < _MAX_CHUNKS:
            raise ValueError("not a whole EXR file")
        offsets = struct.unpack(f"<{count}Q", file.read(8 * count))
        parts.append(dataclasses.replace(part, offsets=offsets))
    return version, parts


def _attributes(file: BinaryIO) -> dict[str, tuple[bytes, bytes]]:
    attributes = {}
    while name := _word(file):
        kind = _word(file)
        (size,) = struct.unpack("<i", file.read(4))
        if not 0 <= size < _MAX_ATTRIBUTE:
            raise ValueError("not a whole EXR file")
        attributes[name.decode()] = kind, file.read(size)
    return attributes


def _word(file: BinaryIO) -> bytes:
    word = bytearray()
    while (byte := file.read(1)) != b"\0":
        if not byte or len(word) > 255:
            raise ValueError("not a whole EXR file")
        word += byte
    return bytes(word)


def read_chunk(file: BinaryIO, version: int, part: ExrPart, number: int) -> Chunk:
    """A chunk of a part by its number; `ValueError` where the file is damaged."""
    extra = 4 if version & _MULTIPART else 0
    head = f"<{4 if part.is_tiled else 1}ii"
    try:
        file.seek(part.offsets[number] + extra)
        *place, size = struct.unpack(head, file.read(struct.calcsize(head)))
    except (struct.error, IndexError, OverflowError):
        raise ValueError("not a whole EXR file") from None
    content = file.read(size) if size >= 0 else b""
    if len(content) != size:
        raise ValueError("not a whole EXR file")
    return Chunk(tuple(place), content)


class ChunkWriter:
    """Writes a file chunk by chunk.

    Parameters
    ----------
    file : empty, open for writing.
    version : with its flags.
    parts : with as many offsets as they will have chunks.
    """

    def __init__(self, file: BinaryIO, version: int, parts: Sequence[ExrPart]):
        self._file = file
        self._prefix = bool(version & _MULTIPART)
        file.write(_MAGIC + struct.pack("<I", version))
        for part in parts:
            for name, (kind, value) in part.attributes.items():
                file.write(name.encode() + b"\0" + kind + b"\0" + struct.pack("<i", len(value)) + value)
            file.write(b"\0")
        if self._prefix:
            file.write(b"\0")
        self._tables = [np.zeros(len(part.offsets), "<u8") for part in parts]
        self._start = file.tell()
        self._filled = [0] * len(parts)
        file.write(bytes(8 * sum(table.size for table in self._tables)))

    def add(self, part: int, chunks: Iterable[Chunk]) -> None:
        """Write the next chunks of a part, in the order of rows and columns."""
        for chunk in chunks:
            self._tables[part][self._filled[part]] = self._file.tell()
            self._filled[part] += 1
            numbers = (*((part,) if self._prefix else ()), *chunk.place, len(chunk.content))
            self._file.write(struct.pack(f"<{len(numbers)}i", *numbers))
            self._file.write(chunk.content)

    def finish(self) -> None:
        """Write the tables of offsets."""
        self._file.seek(self._start)
        for table in self._tables:
            self._file.write(table.tobytes())


def single(version: int, part: ExrPart) -> tuple[int, ExrPart]:
    """Version and header of a file that has one of the parts of another file only."""
    flags = version & ~(_TILED | _MULTIPART) | (_TILED if part.is_tiled else 0)
    kept = {name: value for name, value in part.attributes.items() if name != "chunkCount"}
    return flags, dataclasses.replace(part, attributes=kept)
