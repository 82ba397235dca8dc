"""The words of a file's name, and those among them that say its size and format."""

from __future__ import annotations

import re
import unicodedata
from collections.abc import Sequence
from pathlib import Path

from texloom.pipelines.media import udim

JUNK = re.compile(
    r"\d+k?|\d+k?(?:jpg|png|exr|tif)|\d+x\d+|\d+bit|var\d+|lod\d+|jpg|jpeg|png|tif|tiff|exr|raw|srgb|linear"
)
"""words at the end that say nothing of a map"""
_FORMATS = ("jpg", "jpeg", "png", "tif", "tiff", "exr")


def words_of(name: str) -> list[str]:
    """The words of a file's name, in lower case."""
    whole = re.sub("OpenGL|DirectX", lambda found: f"_{found[0].lower()}_", unicodedata.normalize("NFC", name))
    parted = re.sub(r"(?<=[a-z])(?=[A-Z])|(?<=[A-Z])(?=[A-Z][a-z])", "_", whole)
    return [word.lower() for word in re.split(r"[\W_]+", parted) if word]


def trimmed(words: list[str]) -> list[str]:
    """Without sizes, formats and variants at the end."""
    count = len(words)
    while count and JUNK.fullmatch(words[count - 1]):
        count -= 1
    return words[:count]


def stem_of(path: Path) -> str:
    """A file's name without suffix, and without the mark of UDIM tiles."""
    return Path(udim.plain_name(path.name)).stem


def largest(paths: Sequence[Path]) -> tuple[list[Path], tuple[Path, ...]]:
    """Files without those that are there with more pixels, as ``x_1K_d.png`` beside ``x_2K_d.png``; and those."""
    named: dict[tuple[str, ...], dict[int, list[Path]]] = {}
    for path in paths:
        words = words_of(stem_of(path))
        sizes = [size for word in words if (size := _pixels(word))]
        rest = tuple(word for word in words if not _pixels(word) and word not in _FORMATS)
        named.setdefault(rest, {}).setdefault(max(sizes, default=0), []).append(path)
    kept = {
        path
        for sizes in named.values()
        for size, files in sizes.items()
        for path in files
        if size in (0, max(sizes))
    }
    return sorted(kept), tuple(path for path in paths if path not in kept)


def _pixels(word: str) -> int:
    """The side that a word of a name says, as ``2k``, ``2048`` or ``2048x2048``, px; 0 of other words."""
    found = re.fullmatch(r"(\d+)k|(\d{3,5})(?:x\d{3,5})?", word)
    if found is None:
        return 0
    side = 1024 * int(found[1]) if found[1] else int(found[2])
    return side if side.bit_count() == 1 else 0
