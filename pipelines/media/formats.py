"""Formats of pictures by content and name, and what is missing to read them. Nothing heavy is imported."""

from __future__ import annotations

import dataclasses
import importlib.util
from collections.abc import Iterable
from typing import BinaryIO


@dataclasses.dataclass(frozen=True)
class Format:
    """A kind of picture file."""

    name: str
    starts: tuple[bytes, ...]
    """what files begin with, one of them"""
    suffixes: tuple[str, ...]
    needs: str = ""
    """a module that must be installed, of the extra ``photos``"""


FORMATS = (
    Format("PNG", (b"\x89PNG\r\n\x1a\n",), (".png",)),
    Format("JPEG", (b"\xff\xd8\xff",), (".jpg", ".jpeg")),
    Format("TIFF", (b"II*\0", b"MM\0*", b"II+\0"), (".tif", ".tiff")),
    Format("WebP", (b"RIFF",), (".webp",)),
    Format("BMP", (b"BM",), (".bmp",)),
    Format("EXR", (b"\x76\x2f\x31\x01",), (".exr", ".tx")),
    Format("JSON", (b"{",), ()),
    Format("TGA", (), (".tga",)),
    Format("HDR", (b"#?RADIANCE", b"#?RGBE"), (".hdr",)),
    Format("PSD", (b"8BPS",), (".psd", ".psb")),
    Format("DDS", (b"DDS ",), (".dds",)),
    Format("JPEG 2000", (b"\0\0\0\x0cjP  \r\n\x87\n", b"\xff\x4f\xff\x51"), (".jp2", ".j2k", ".jpx")),
    Format("AVIF", (), (".avif",)),
    Format("HEIC", (), (".heic", ".heif"), "pillow_heif"),
    Format("GIF", (b"GIF87a", b"GIF89a"), (".gif",)),
)
DEEP_PSD = "psd_tools"
"""the module that reads PSD of over 8 bits"""
SUFFIXES = tuple(suffix for format in FORMATS for suffix in format.suffixes)
"""what names of pictures end in, lower case"""
_UNREAD = (
    *(".jxl", ".jxr", ".pfm", ".ppm", ".pgm", ".ktx", ".ktx2", ".svg", ".xcf", ".kra", ".clip", ".ora", ".sbsar"),
    *(".dng", ".cr2", ".cr3", ".nef", ".arw", ".raf", ".rw2", ".orf", ".pic", ".ico", ".pcx", ".sgi"),
)
"""what names of pictures end in that are not read, lower case"""
_AVIF = (b"avif", b"avis")
_HEIC = (b"heic", b"heix", b"heim", b"heis", b"hevc", b"hevx", b"mif1", b"msf1")
_TGA_DEPTHS = {1: (8,), 2: (16, 24, 32), 3: (8, 16)}
"""bits of a pixel by the kind of picture: palette, colour, grey; compressed kinds are 8 higher"""


def kind_of(file: BinaryIO) -> str | None:
    """The name of the format of a file's content; None where it is none of them. Moves to the file's start."""
    file.seek(0)
    start = file.read(64)
    file.seek(0)
    if start[4:8] == b"ftyp":
        brands = [start[8:12], *(start[at : at + 4] for at in range(16, min(int.from_bytes(start[:4]), 64), 4))]
        if any(brand in _AVIF for brand in brands):
            return "AVIF"
        return "HEIC" if any(brand in _HEIC for brand in brands) else None
    kind = next((one.name for one in FORMATS if start.startswith(one.starts) and one.starts), None)
    if kind == "WebP" and start[8:12] != b"WEBP":
        return None
    return kind or ("TGA" if _is_tga(start) else None)


def is_archive(file: BinaryIO) -> bool:
    """Whether a file is a ZIP archive. Moves to the file's start."""
    file.seek(0)
    start = file.read(4)
    file.seek(0)
    return start == b"PK\3\4"


def missing(kind: str) -> str:
    """The module that reads a kind of picture and is not installed; empty where it can be read."""
    needs = next(one.needs for one in FORMATS if one.name == kind)
    return needs if needs and importlib.util.find_spec(needs) is None else ""


def readable() -> dict[str, str]:
    """Each format with what is missing to read it; nothing: it can be read."""
    found = {one.name: missing(one.name) for one in FORMATS if one.suffixes}
    found["PSD of 16 bits"] = "" if importlib.util.find_spec(DEEP_PSD) else DEEP_PSD
    return found


def is_unread(name: str) -> bool:
    """Whether a file's name is that of a picture of a kind that is never read."""
    return name.lower().endswith(_UNREAD)


def told_of_unread(names: Iterable[str]) -> str:
    """One line on the pictures of a folder of kinds that are never read, given all names; empty: there are none.

    >>> told_of_unread(["a.png", "b.jxl", "notes.txt"])
    '1 file is not read: b.jxl; save it as PNG, TIFF or EXR'
    """
    unread = sorted(filter(is_unread, names))
    if not unread:
        return ""
    shown = ", ".join(unread[:3]) + (", ..." if len(unread) > 3 else "")
    count = "1 file is" if len(unread) == 1 else f"{len(unread)} files are"
    return f"{count} not read: {shown}; save {'it' if len(unread) == 1 else 'them'} as PNG, TIFF or EXR"


def known_names() -> str:
    """The formats as the user is told them."""
    names = [one.name for one in FORMATS if one.suffixes]
    return f"{', '.join(names[:-1])} and {names[-1]}"


def _is_tga(start: bytes) -> bool:
    """Whether the first bytes are those of a TGA, which has no signature."""
    if len(start) < 18:
        return False
    has_palette, kind, palette, depth, flags = start[1], start[2], start[3:8], start[16], start[17]
    width, height = (int.from_bytes(start[at : at + 2], "little") for at in (12, 14))
    return (
        depth in _TGA_DEPTHS.get(kind & 7, ())
        and kind in (1, 2, 3, 9, 10, 11)
        and has_palette == (kind & 7 == 1)
        and (has_palette == 1) == any(palette)
        and flags < 64
        and flags & 15 <= 8
        and width > 0
        and height > 0
    )
