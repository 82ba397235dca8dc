"""UDIM tiles: pictures ``name.1001.png`` ... as one picture, ``name.<UDIM>.png``, laid out as they are written.

Tile 1001 is at the lower left, 1002 to its right, 1011 above it. ``name_u1_v1.png``, as of Mudbox, is the same tile
of ``name_<UVTILE>.png``.
"""

from __future__ import annotations

import dataclasses
import os
import re
from collections.abc import Callable, Iterable
from pathlib import Path

_FIRST, _COLUMNS, _LAST = 1001, 10, 1999
_MARK = re.compile("<udim>|<uvtile>", re.IGNORECASE)
_TILE = re.compile(r"(.+)([._])(1\d{3}|u\d+_v\d+)(\.[^.]+)", re.IGNORECASE)
_PLACE = re.compile(r"u(\d+)_v(\d+)", re.IGNORECASE)


@dataclasses.dataclass(frozen=True)
class Tiles:
    """The files of a picture in tiles."""

    rows: int
    columns: int
    files: tuple[Path, ...]
    """row by row from the upper left"""


def is_tiled(reference: str) -> bool:
    """Whether the name of a file has ``<UDIM>`` or ``<UVTILE>`` in it."""
    return "<" in reference and _MARK.search(os.path.basename(reference)) is not None  # noqa: PTH119


def plain_name(reference: str) -> str:
    """A file's name without the mark of tiles."""
    return re.sub(rf"[._]?{_MARK.pattern}", "", Path(reference).name, flags=re.IGNORECASE)


def tiles_of(path: Path) -> Tiles:
    """The tiles of ``name.<UDIM>.png``, which fill a rectangle from 1001.

    Raises
    ------
    ValueError
        There is none, or some are missing; in words.
    """
    before, after = _MARK.split(path.name, maxsplit=1)
    pattern = re.compile(rf"{re.escape(before)}(\d{{4}}|(?i:{_PLACE.pattern})){re.escape(after)}")
    try:
        names = [file.name for file in path.parent.iterdir()]
    except FileNotFoundError:
        names = []
    found = {_number_of(match[1]): path.parent / name for name in names if (match := pattern.fullmatch(name))}
    found = {number: file for number, file in found.items() if _FIRST <= number <= _LAST}
    if not found:
        raise ValueError(f"there are no tiles, such as {before}{_FIRST}{after}")
    rows, columns = _extent(found)
    wanted = list(areas(rows, columns, rows, columns))
    if missing := sorted(set(wanted) - set(found)):
        listed = ", ".join(map(str, missing[:8])) + (", ..." if len(missing) > 8 else "")
        raise ValueError(
            f"tiles are missing: {listed}; they have to fill {columns} x {rows} from {_FIRST}; move those beyond "
            f"the gap away, or list one tile of each map in a YAML file, as {found[min(found)].name}"
        )
    return Tiles(rows, columns, tuple(found[number] for number in wanted))


def areas(height: int, width: int, rows: int, columns: int) -> dict[int, tuple[slice, slice]]:
    """Number of each tile to its area in a picture of whole tiles, in the order of `Tiles.files`."""
    down, across = height // rows, width // columns
    return {
        _FIRST + column + _COLUMNS * (rows - 1 - row): (
            slice(row * down, (row + 1) * down),
            slice(column * across, (column + 1) * across),
        )
        for row in range(rows)
        for column in range(columns)
    }


def joined(paths: Iterable[Path], is_map: Callable[[str], bool]) -> list[Path]:
    """Paths with the tiles of each picture as one, ``name.<UDIM>.png``, in the order of the first of them.

    Tiles are several files with 1001 among their numbers. As cameras number files so too, ``name_1001`` needs
    to be named as a map, or a second row of tiles beside which numbers are not used.

    Parameters
    ----------
    paths : of files.
    is_map : whether a name without number and suffix is that of a map.
    """
    whole: dict[Path, list[tuple[int, Path]]] = {}
    for path in paths:
        match = _TILE.fullmatch(path.name)
        name, number = path, 0
        if match is not None and (number := _number_of(match[3])):
            mark = "<UDIM>" if match[3].isdecimal() else "<UVTILE>"
            name = path.with_name(f"{match[1]}{match[2]}{mark}{match[4]}")
        whole.setdefault(name, []).append((number, path))
    result: list[Path] = []
    for name, files in whole.items():
        numbers = {number for number, _ in files}
        stem, is_sure = Path(plain_name(str(name))).stem, name.stem.endswith((".<UDIM>", "<UVTILE>"))
        is_one = len(files) > 1 and _FIRST in numbers
        if is_one and (is_sure or is_map(stem) or _has_rows(numbers)):
            result.append(name)
        else:
            result += [path for _, path in files]
    return result


def _number_of(text: str) -> int:
    """The number of a tile, given as ``1012`` or ``u2_v2``; 0 where there is no such tile."""
    place = _PLACE.fullmatch(text)
    if place is None:
        return int(text)
    across, up = int(place[1]) - 1, int(place[2]) - 1
    return _FIRST + across + _COLUMNS * up if 0 <= across < _COLUMNS and up >= 0 else 0


def _has_rows(numbers: set[int]) -> bool:
    rows, columns = _extent(numbers)
    return rows > 1 and columns < _COLUMNS and len(numbers) == rows * columns


def _extent(numbers: Iterable[int]) -> tuple[int, int]:
    """Rows and columns up to the last tile."""
    places = [divmod(number - _FIRST, _COLUMNS) for number in numbers]
    return 1 + max(up for up, _ in places), 1 + max(across for _, across in places)
