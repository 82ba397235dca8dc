"""Which pictures a folder holds: of all its subfolders, searched, sorted, some at a time."""

from __future__ import annotations

import dataclasses
import itertools
import os
from collections import Counter
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Literal

from texloom.pipelines.media.formats import SUFFIXES as PICTURES
from texloom.pipelines.media.map_names import read_names

PictureSorting = Literal["name", "newest"]
DROPPED = ":dropped"
"""in place of a folder: what was dropped"""
_DEEPEST = 8
"""folders below each other that are looked into"""
_MOST_LOOKED_AT = 100_000
"""entries of all folders"""


@dataclasses.dataclass(frozen=True)
class Listed:
    """A picture or a folder of maps, by its id."""

    id: str
    folder: str
    """in which it is, relative to that of the studio; or `DROPPED`"""
    time: float
    """when it was last written, seconds since 1970"""

    @property
    def text(self) -> str:
        """What is searched."""
        return self.id.partition(":")[2].casefold()


@dataclasses.dataclass
class FolderScan:
    """What there is in a folder."""

    found: list[Listed] = dataclasses.field(default_factory=list)
    linked_out: int = 0
    """links that lead out of the folder, which are left out"""
    left_out: int = 0
    """folders that are too deep, or come when too many entries have been looked at"""

    @property
    def notes(self) -> tuple[str, ...]:
        """What is not shown, a line each."""
        notes = []
        if self.linked_out:
            notes.append(f"{_counted(self.linked_out, 'link')} out of the folder {_is(self.linked_out)} left out")
        if self.left_out:
            notes.append(f"{_counted(self.left_out, 'folder')} too deep or too many {_is(self.left_out)} left out")
        return tuple(notes)


def scan(root: Path, without: Iterable[Path]) -> FolderScan:
    """Look for pictures in a folder and all of its subfolders.

    Links to something in the folder count, each place once; hidden files and the folders ``without`` do not.
    """
    made = FolderScan()
    seen = {os.path.realpath(one) for one in without}
    entries = _MOST_LOOKED_AT
    waiting = [(root, 0)]
    real_root = os.path.realpath(root)
    while waiting:
        folder, depth = waiting.pop(0)
        real = os.path.realpath(folder)
        if real in seen:
            continue
        seen.add(real)
        if depth > _DEEPEST or entries <= 0:
            made.left_out += 1
            continue
        own = list(itertools.islice(_entries(folder), entries))
        entries -= len(own)
        inside = [one for one in own if not one.is_symlink() or _is_inside(one, real_root)]
        made.linked_out += len(own) - len(inside)
        pictures = [one for one in inside if Path(one.name).suffix.lower() in PICTURES and _is_file(one)]
        if depth and _is_material([Path(one.path) for one in pictures]):
            made.found.append(_listed(root, folder, max(one.stat().st_mtime for one in pictures)))
            continue
        made.found += [_listed(root, Path(one.path), one.stat().st_mtime) for one in pictures]
        waiting += [(Path(one.path), depth + 1) for one in inside if _is_folder(one)]
    return made


def _is_material(pictures: list[Path]) -> bool:
    """Whether pictures of a folder are the maps of one material, by their names alone."""
    if len(pictures) < 2:
        return False
    named = read_names(pictures, lambda _: None)
    return "albedo" in named.claims and "albedo" not in named.several and len(named.claims) > 1


def _listed(root: Path, path: Path, time: float) -> Listed:
    relative = path.relative_to(root)
    folder = "" if relative.parent == Path() else relative.parent.as_posix()
    return Listed(f"folder:{relative.as_posix()}", folder, time)


def chosen(
    found: Iterable[Listed], search: str, folder: str, sorting: PictureSorting
) -> list[Listed]:  # fmt: skip
    """Those with all words of a search, of a folder and those below it, in their order."""
    words = search.casefold().split()
    kept = [
        one
        for one in found
        if all(word in one.text for word in words)
        and (not folder or one.folder == folder or one.folder.startswith(f"{folder}/"))
    ]
    if sorting == "newest":
        return sorted(kept, key=lambda one: (-one.time, one.id))
    return sorted(kept, key=lambda one: (one.folder == DROPPED, one.text))


def folders_of(found: Iterable[Listed]) -> dict[str, int]:
    """The folders that hold pictures, and how many they have, with those in folders below."""
    counts: Counter[str] = Counter()
    for one in found:
        parts = [one.folder] if one.folder == DROPPED else one.folder.split("/")
        for depth in range(1, len(parts) + 1):
            counts["/".join(parts[:depth])] += 1
    counts.pop("", None)
    return dict(sorted(counts.items(), key=lambda pair: (pair[0] == DROPPED, pair[0].casefold())))


def _entries(folder: Path) -> Iterator[os.DirEntry[str]]:
    try:
        with os.scandir(folder) as entries:
            yield from sorted((one for one in entries if not one.name.startswith(".")), key=lambda one: one.name)
    except OSError:
        return


def _is_inside(entry: os.DirEntry[str], root: str) -> bool:
    real = os.path.realpath(entry.path)
    return f"{real}{os.sep}".startswith(root.rstrip(os.sep) + os.sep) and os.path.exists(real)  # noqa: PTH110


def _is_file(entry: os.DirEntry[str]) -> bool:
    try:
        return entry.is_file()
    except OSError:
        return False


def _is_folder(entry: os.DirEntry[str]) -> bool:
    try:
        return entry.is_dir()
    except OSError:
        return False


def _counted(count: int, what: str) -> str:
    return f"{count} {what}" if count == 1 else f"{count} {what}s"


def _is(count: int) -> str:
    return "is" if count == 1 else "are"
