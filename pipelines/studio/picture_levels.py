"""Large pictures as a screen shows them, each in several sizes: decoded once for all processes of a studio.

Level 0 is a picture in sRGB, 8 bits; each further level has half the size of the one before, and the last one fits
into a tile. They lie in uncompressed files, of which only what is looked at is read.
"""

from __future__ import annotations

import functools
import os
import shutil
import tempfile
from pathlib import Path

import cv2
import filelock
import numpy as np
from jaxtyping import UInt8, UInt16

from texloom.pipelines.media.sources import Source
from texloom.pipelines.studio.work import Places
from texloom.stages.vocabulary.arrays import Image
from texloom.stages.vocabulary.declare import InputError

LARGE = 2048
"""px of a side, above which a picture is looked at in tiles"""
SIDE = 512
"""px of a tile"""
_MOST_BYTES = 2**30  # of the files of all pictures but the newest
_ROWS = 512  # halved at once; even
_MOST_LIGHT = 65535

Levels = list[UInt8[np.ndarray, "h w 3"]]


def is_large(source: Source) -> bool:
    """Whether a picture is looked at in tiles."""
    return not source.maps and max(source.height, source.width) > LARGE


def levels_of(source: Source, places: Places) -> Levels:
    """The levels of a picture, made if need be; `InputError` where it cannot be decoded."""
    own = _folder(source, places)
    own.parent.mkdir(parents=True, exist_ok=True)
    with filelock.FileLock(own.with_suffix(".lock")):
        if not own.is_dir():
            _prune(own.parent)
            _make(source, own)
        os.utime(own)
        return [np.load(own / f"{level}.npy", mmap_mode="r") for level in range(len(list(own.iterdir())))]


def level_for(levels: Levels, height: int, width: int) -> UInt8[np.ndarray, "h w 3"]:
    """The smallest level that is no smaller than this."""
    return [one for one in levels if one.shape[0] >= height and one.shape[1] >= width][-1]


def shown(source: Source, side: int, places: Places) -> UInt8[np.ndarray, "h w 3"]:
    """A large picture, reduced to a longest side of ``side`` px; for less than a tile no levels are made."""
    factor = min(1.0, side / max(source.height, source.width))
    height, width = (max(1, round(factor * one)) for one in (source.height, source.width))
    is_listed = side < SIDE and not _folder(source, places).is_dir()
    codes = source.colour() if is_listed else level_for(levels_of(source, places), height, width)
    return _codes(np.asarray(cv2.resize(_light(codes), (width, height), interpolation=cv2.INTER_AREA)))


def small_image(source: Source, size: tuple[int, int], places: Places) -> Image:
    """A large picture in linear light, not much larger than ``size``, px."""
    return Image.of(np.array(level_for(levels_of(source, places), *size)))


def window(size: tuple[int, int], level: int, row: int, column: int) -> tuple[slice, slice]:
    """Rows and columns of a tile in its level; those at the right and lower borders are smaller.

    Raises
    ------
    InputError : there is no such tile of a picture of this size.
    """
    rows, columns = (
        slice(SIDE * at, min(SIDE * (at + 1), -(-side // 2**level)))
        for at, side in zip((row, column), size, strict=True)
    )
    is_known = level == 0 or SIDE << level < 2 * max(size)
    if not is_known or rows.start >= rows.stop or columns.start >= columns.stop:
        raise InputError("there is no such tile")
    return rows, columns


def halved(codes: UInt8[np.ndarray, "h w 3"]) -> UInt8[np.ndarray, "half_h half_w 3"]:
    """A picture of half the size, averaged in linear light; of odd sides the last pixels count twice."""
    made = np.empty((-(-codes.shape[0] // 2), -(-codes.shape[1] // 2), 3), np.uint8)
    for top in range(0, len(codes), _ROWS):
        strip = codes[top : top + _ROWS]
        strip = np.pad(strip, ((0, len(strip) % 2), (0, strip.shape[1] % 2), (0, 0)), "edge")
        light = cv2.resize(_light(strip), None, fx=0.5, fy=0.5, interpolation=cv2.INTER_AREA)
        made[top // 2 : top // 2 + len(light)] = _codes(np.asarray(light))
    return made


def _folder(source: Source, places: Places) -> Path:
    """Where the levels of a picture are, if they are."""
    return Path(places.scratch) / "pictures" / source.digest


def _make(source: Source, own: Path) -> None:
    """Write all levels into a folder, which is complete or absent."""
    made = Path(tempfile.mkdtemp(dir=own.parent, prefix=".new-"))
    try:
        levels = [source.colour()]
        while max(levels[-1].shape) > SIDE:
            levels.append(halved(levels[-1]))
        for number, level in enumerate(levels):
            np.save(made / f"{number}.npy", level)
        made.rename(own)
    finally:
        shutil.rmtree(made, ignore_errors=True)


def _prune(folder: Path) -> None:
    """Remove the pictures that were looked at the longest ago; those that are open keep their content."""
    found = sorted((path for path in folder.iterdir() if path.is_dir()), key=lambda path: -path.stat().st_mtime)
    total = 0
    for path in found:
        total += sum(file.stat().st_size for file in path.iterdir())
        if total > _MOST_BYTES:
            shutil.rmtree(path, ignore_errors=True)


def _light(codes: UInt8[np.ndarray, "h w 3"]) -> UInt16[np.ndarray, "h w 3"]:
    """Linear light; the darkest codes are 20 apart."""
    return np.asarray(cv2.LUT(np.ascontiguousarray(codes), _tables()[0]))


def _codes(light: UInt16[np.ndarray, "h w 3"]) -> UInt8[np.ndarray, "h w 3"]:
    return np.take(_tables()[1], light)


@functools.cache
def _tables() -> tuple[np.ndarray, np.ndarray]:
    """The light of each code, uint16, and the code of each light, uint8 (IEC 61966-2-1)."""
    light = np.array([_light_of(code / 255) for code in range(256)])
    between = [_light_of((code + 0.5) / 255) for code in range(255)]
    codes = np.searchsorted(between, np.arange(_MOST_LIGHT + 1) / _MOST_LIGHT, side="right").astype(np.uint8)
    return np.rint(light * _MOST_LIGHT).astype(np.uint16), codes


def _light_of(encoded: float) -> float:
    # As `texloom.stages.vocabulary.color`, whose kernels take longer to load than a photograph to decode.
    return float(encoded / 12.92 if encoded <= 0.04045 else ((encoded + 0.055) / 1.055) ** 2.4)
