"""What headers of pictures say that Pillow does not tell: bits, alpha that counts, colour by code points."""

from __future__ import annotations

import dataclasses
from typing import BinaryIO

_SEARCHED = 2**18  # bytes at the start of a file, in which its boxes are
_FIRST_DXGI_BLOCKS = 70  # whole numbers without blocks come before, but for rare ones of video
_FIRST_DDS_BC6, _LAST_DDS_BC6 = 94, 96  # DXGI
_DX10 = b"DX10"
_BC5 = (b"BC5U", b"BC5S", b"ATI2")
_DXGI_BC5 = (82, 83, 84)
_CUBE, _VOLUME = 0x200, 0x200000


@dataclasses.dataclass(frozen=True)
class FileFacts:
    """Of a picture file."""

    depth: int = 8
    """bits a channel"""
    has_alpha: bool = True
    """whether an alpha that the pixels have is meant"""
    is_two_channels: bool = False
    """whether it is BC5, with the x and y of normals"""
    code_points: bytes | None = None
    """colour as in a PNG's chunk cICP"""
    note: str = ""
    """for the user"""


def facts_of(kind: str, file: BinaryIO) -> FileFacts:
    """What a file's header says, by its format. Moves in the file.

    Raises
    ------
    ValueError
        Its values are of a kind that is not read; in words.
    """
    file.seek(0)
    start = file.read(_SEARCHED if kind in ("AVIF", "HEIC", "JPEG 2000") else 256)
    known = {"TGA": _tga, "DDS": _dds, "JPEG 2000": _jpeg_2000, "AVIF": _boxes, "HEIC": _boxes}
    return known[kind](start) if kind in known else FileFacts()


def _tga(start: bytes) -> FileFacts:
    bits_of_alpha = start[17] & 15
    if start[16] in (16, 32) and start[2] & 7 == 2 and not bits_of_alpha:
        told = "its alpha is not read: the header says that it has none" if start[16] == 32 else ""
        return FileFacts(has_alpha=False, note=told)
    return FileFacts()


def _dds(start: bytes) -> FileFacts:
    four, caps = start[84:88], int.from_bytes(start[112:116], "little")
    code = int.from_bytes(start[128:132], "little") if four == _DX10 else 0
    if _FIRST_DDS_BC6 <= code <= _LAST_DDS_BC6:
        raise ValueError("is BC6H, whose floats are not read; save it as EXR")
    first = [name for bit, name in ((_CUBE, "a cube map"), (_VOLUME, "a volume")) if caps & bit]
    note = f"is {first[0]}, of which the first picture is read" if first else ""
    two = four in _BC5 or code in _DXGI_BC5
    if two:
        note = "has two channels (BC5): blue is computed, so that normals have length 1"
    return FileFacts(is_two_channels=two, note=note)


def is_in_blocks(start: bytes) -> bool:
    """Whether a DDS that begins so is compressed by blocks (BC1 to BC7)."""
    four, code = start[84:88], int.from_bytes(start[128:132], "little")
    return (four == _DX10 and code >= _FIRST_DXGI_BLOCKS) or four[:3] in (b"DXT", b"ATI", b"BC4", b"BC5")


def _jpeg_2000(start: bytes) -> FileFacts:
    at = start.find(b"\xff\x4f\xff\x51")
    if at < 0 or len(start) < at + 45:
        raise EOFError
    count = int.from_bytes(start[at + 40 : at + 42])
    sizes = {start[at + 42 + 3 * index] for index in range(min(count, 4)) if at + 42 + 3 * index < len(start)}
    if any(size & 0x80 for size in sizes):
        raise ValueError("has signed values, which are not read in JPEG 2000; save it as TIFF")
    if len(sizes) > 1 or max(sizes) > 15:
        raise ValueError("has channels of several depths or of over 16 bits; save it as TIFF")
    return FileFacts(depth=sizes.pop() + 1)


def _boxes(start: bytes) -> FileFacts:
    """AVIF and HEIC; the first picture's boxes count."""
    depth, at = 8, start.find(b"av1C")
    if 0 <= at < len(start) - 6:
        flags = start[at + 6]
        depth = (12 if flags & 0x20 else 10) if flags & 0x40 else 8
    at = start.find(b"hvcC")
    if 0 <= at < len(start) - 22:
        depth = 8 + (start[at + 21] & 7)
    code_points, at = None, start.find(b"colrnclx")
    if 0 <= at < len(start) - 14:
        primaries, transfer = (int.from_bytes(start[at + place : at + place + 2]) for place in (8, 10))
        # 2 is unspecified; what is decoded is RGB of the full range.
        code_points = bytes(
            [1 if primaries == 2 else primaries & 255, 13 if transfer == 2 else transfer & 255, 0, 1]
        )
    return FileFacts(depth=depth, code_points=code_points)
