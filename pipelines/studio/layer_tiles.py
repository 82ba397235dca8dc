"""Tiles of the layers of EXR files and of other pictures, at any zoom, in a worker.

A layer is read once, in bands, for the pictures of its reduced levels, which lie in files of 8 bits. Tiles of full
size are decoded from the EXR when they are wanted; only where it has lines instead of tiles they are kept as well.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np

from texloom.pipelines.media.sources import open_source
from texloom.pipelines.store import exr
from texloom.pipelines.store.capture import capture_output
from texloom.pipelines.store.png_file import png
from texloom.pipelines.store.preview import picture, range_of
from texloom.pipelines.studio.layers import ExrLayer, layers_of
from texloom.pipelines.studio.picture_levels import SIDE, Levels, levels_of, window
from texloom.pipelines.studio.work import Encoded, Places, TileWork
from texloom.stages.vocabulary.declare import InputError

_MOST_BYTES = 2**30  # of the files of all layers
_MOST_OPEN = 16  # layers
_MOST_PIXELS = 2**28  # of a file that is decoded as a whole


class Tiler:
    """The layers that are looked at."""

    def __init__(self, places: Places):
        self.folder = Path(places.scratch) / "levels"
        self._places = places
        self._open: dict[tuple[str, int], Pyramid | PicturePyramid] = {}

    def send(self, work: TileWork, send: Callable[..., None]) -> None:
        """Send a tile as PNG."""
        key = work.key, work.layer
        pyramid = self._open.pop(key, None) or self._opened(work)
        self._open[key] = pyramid
        while len(self._open) > _MOST_OPEN:
            del self._open[next(iter(self._open))]
        send(Encoded(), png(pyramid.tile(work.level, work.row, work.column)))

    def _opened(self, work: TileWork) -> Pyramid | PicturePyramid:
        if Path(work.file).suffix.lower() != ".exr":
            return PicturePyramid(levels_of(open_source("picture", work.file), self._places))
        known = layers_of(Path(work.file))
        if work.layer >= len(known):
            raise InputError("there is no such layer")
        self.folder.mkdir(parents=True, exist_ok=True)
        _prune(self.folder)
        return Pyramid(Path(work.file), known[work.layer], self.folder / f"{work.key}_{work.layer}")


@dataclasses.dataclass
class PicturePyramid:
    """A picture at all levels."""

    levels: Levels

    def tile(self, level: int, row: int, column: int) -> np.ndarray:
        """The picture of a tile, uint8."""
        height, width = self.levels[0].shape[:2]
        part = window((height, width), level, row, column)
        return np.ascontiguousarray(self.levels[level][part])


@dataclasses.dataclass
class Pyramid:
    """A layer at all levels, each of half the size of the one before."""

    path: Path
    layer: ExrLayer
    stem: Path

    def __post_init__(self) -> None:
        self._whole: exr.Planes | None = None
        self._bands = [slice(0, self.layer.size[0])]
        try:
            with capture_output():
                self._windows = exr.Windows(self.path)
            self._bands = self._windows.bands(self.layer.part)
        except ValueError:  # it has levels of its own, or is damaged
            self._whole = self._loaded()
        self._first = int(len(self._bands) > 1)  # the first level that is kept
        self._ranges = self._measured()
        self._levels: list[np.ndarray] = []

    def tile(self, level: int, row: int, column: int) -> np.ndarray:
        """The picture of a tile, uint8."""
        rows, columns = window(self.layer.size, level, row, column)
        if level < self._first:
            return self._picture(self._read(rows, columns))
        self._levels = self._levels or self._made()
        return np.ascontiguousarray(self._levels[level - self._first][rows, columns])

    def _loaded(self) -> exr.Planes:
        try:
            with capture_output():
                return exr.load(self.path, largest=_MOST_PIXELS)[1][self.layer.part]
        except ValueError as error:
            raise InputError(f"{self.path.name}: {error}") from None

    def _read(self, rows: slice, columns: slice) -> exr.Planes:
        if self._whole is not None:
            return {name.rpartition(".")[2]: self._whole[name][rows, columns] for name in self.layer.channels}
        if len(self._bands) == 1 and math.prod(self.layer.size) > _MOST_PIXELS:
            raise InputError(f"{self.path.name}: is not in tiles and too large to be shown")
        try:
            with capture_output():
                read = self._windows.read(self.layer.part, rows, columns)
        except ValueError as error:
            raise InputError(f"{self.path.name}: {error}") from None
        return {name.rpartition(".")[2]: read[name] for name in self.layer.channels}

    def _picture(self, planes: exr.Planes) -> np.ndarray:
        shown = picture(planes, self._ranges)
        assert shown is not None
        return shown

    def _measured(self) -> dict[str, tuple[float, float]]:
        """The ranges of planes that are not colour."""
        names = [name.rpartition(".")[2] for name in self.layer.channels]
        if {*"RGB"} <= {*names} or {*names} & {"Y", "L"}:
            return {}
        found = dict.fromkeys(names, (np.inf, -np.inf))
        for band in self._bands:
            for name, plane in self._read(band, slice(None)).items():
                least, most = range_of(plane)
                found[name] = min(found[name][0], least), max(found[name][1], most)
        return found

    def _made(self) -> list[np.ndarray]:
        """All levels from the first that is kept."""
        levels: list[np.ndarray] = []
        for band in self._bands:
            planes = self._read(band, slice(None))
            if self._first:  # in linear light
                planes = {name: _halved(plane.astype(np.float32)) for name, plane in planes.items()}
            part = self._picture(planes)
            if not levels:
                height = -(-self.layer.size[0] // 2) if self._first else self.layer.size[0]
                levels.append(self._file(0, (height, *part.shape[1:])))
            top = band.start // (1 + self._first)
            levels[0][top : top + len(part)] = part
        while max(levels[-1].shape[:2]) > SIDE:
            part = _halved(levels[-1])
            levels.append(self._file(len(levels), part.shape))
            levels[-1][:] = part
        return levels

    def _file(self, number: int, shape: tuple[int, ...]) -> np.ndarray:
        path = self.stem.with_name(f"{self.stem.name}_{number}.npy")
        return np.lib.format.open_memmap(path, "w+", np.uint8, shape)


def _halved(plane: np.ndarray) -> np.ndarray:
    height, width = (-(-side // 2) for side in plane.shape[:2])
    return np.asarray(cv2.resize(plane, (width, height), interpolation=cv2.INTER_AREA))


def _prune(folder: Path) -> None:
    """Remove the files that were used the longest ago; those that are open keep their content."""
    files = sorted(folder.iterdir(), key=lambda path: path.stat().st_mtime, reverse=True)
    total = 0
    for path in files:
        total += path.stat().st_size
        if total > _MOST_BYTES:
            path.unlink()
