"""The files of a source on the command line: a picture, a set of them, or the maps of a material."""

from __future__ import annotations

import glob
from collections.abc import Sequence
from os.path import basename, isdir, splitext  # as text, as there may be thousands
from pathlib import Path
from typing import NamedTuple

from texloom.pipelines.errors import one_line, refused
from texloom.pipelines.flow.model import Each
from texloom.pipelines.media import formats
from texloom.pipelines.media.map_names import recognised
from texloom.pipelines.media.material_set import (
    holds_maps,
    holds_one_material,
    looks_like_one,
    pictures_in,
    same_material,
    told_of_several,
)
from texloom.pipelines.media.meshes import SUFFIXES as MESHES
from texloom.pipelines.media.stack import SCHEME, path_of
from texloom.pipelines.media.udim import joined
from texloom.stages.vocabulary.declare import InputError

_READ = (".json", ".yaml", ".yml")  # strokes and maps
_LISTED = 4  # files in a note
_MOST_MAPS = 64  # files that may be maps of one material; to read the names of thousands takes seconds


def source_of(
    name: str, references: Sequence[str], pair: str | None, takes_maps: bool, ordered: bool = False
) -> str | Each:
    """What a source is, from what is given for it.

    One picture, or the maps of one material, are one source; several references, a pattern, or a folder of
    pictures or materials are a set.

    Parameters
    ----------
    name : of the source, for errors.
    references : files, folders and patterns; absolute.
    pair : of the set.
    takes_maps : whether any folder that holds an albedo, or pictures of one name and size, is one material; else
        it has to hold several maps and not several albedos.
    ordered : whether files keep the order in which they are given one by one, without patterns and folders of many.

    Raises
    ------
    InputError : a folder holds no picture, or the files are maps of one material.
    """
    first = references[0]
    if len(references) == 1 and not is_pattern(first) and not _is_library(first, takes_maps):
        return first
    patterns = {one: matching(one) for one in references if is_pattern(one)}
    given = [file for one in references for file in (patterns[one].files if one in patterns else [one])]
    folder = same_material(given) if takes_maps or len(given) <= _MOST_MAPS else None
    if takes_maps and folder is not None:
        raise refused(f"sources.{name}: these files are maps of one material; give their folder, {folder}")
    try:
        files = [file for reference in references for file in _files(reference, takes_maps)]
    except InputError as error:
        raise refused(f"sources.{name}: {error}") from None
    notes = [f"sources.{name}: {reference}: {told}" for reference in references if (told := _unread(reference))]
    libraries = [one for one in references if _is_library(one, takes_maps)]
    notes += [f"sources.{name}: {one}: {told}" for one in libraries if (told := _ignored(one))]
    notes += [f"sources.{name}: {one}: {found.told}" for one, found in patterns.items() if found.told]
    if folder is not None:
        notes.append(
            f"sources.{name}: these files are maps of one material, and each is taken by itself; "
            f"their folder, {folder}, keeps them in register"
        )
    is_ordered = ordered and not patterns and files == list(references)
    return Each(tuple(dict.fromkeys(files)), pair, tuple(map(one_line, notes)), is_ordered)


def stack_of(name: str, references: Sequence[str]) -> str:
    """The reference of a frame stack; `InputError` where several are given."""
    if len(references) > 1:
        problem = (
            f"{len(references)} files; a stack is one folder, one quoted pattern such as 'frames/*.png', or an EXR"
        )
        raise refused(f"sources.{name}: {problem}")
    return f"{SCHEME}{path_of(references[0])}"


def is_pattern(reference: str) -> bool:
    """Whether a reference is a pattern of files; a file or folder of just that name is not."""
    return bool(set("*?[") & set(reference)) and not Path(reference).exists()


class MatchedFiles(NamedTuple):
    """What a pattern matches."""

    files: list[str]
    told: str
    """of files that are left out; empty: there are none"""


def matching(pattern: str) -> MatchedFiles:
    """The files and folders that an absolute pattern matches, by name.

    Where pictures or folders are among them, without files that lie beside such, as ``Thumbs.db`` or ``moss.mtlx``.
    """
    found = sorted(glob.glob(pattern, recursive=True))  # noqa: PTH207 (absolute)
    kinds = {one: splitext(one)[1].lower() for one in found}  # noqa: PTH122
    others = [one for one, kind in kinds.items() if kind not in (*formats.SUFFIXES, *_READ)]
    files = [one for one in others if not isdir(one)]  # noqa: PTH112
    has_pictures = any(kind in formats.SUFFIXES for kind in kinds.values())
    if not has_pictures and len(files) == len(others):
        return MatchedFiles(found, "")
    left = [one for one in files if has_pictures or kinds[one] not in MESHES]
    if not left:
        return MatchedFiles(found, "")
    return MatchedFiles([one for one in found if one not in {*left}], _told_of_ignored(left))


def _told_of_ignored(files: Sequence[str]) -> str:
    shown = ", ".join(map(basename, files[:_LISTED])) + (", ..." if len(files) > _LISTED else "")
    count = "1 file" if len(files) == 1 else f"{len(files)} files"
    return f"{count} beside the others ignored: {shown}"


def _is_library(reference: str, takes_maps: bool) -> bool:
    """Whether it is a folder, and not one material."""
    folder = Path(reference)
    return folder.is_dir() and not _is_material(folder, takes_maps)


def _is_material(folder: Path, takes_maps: bool) -> bool:
    return holds_one_material(folder) or (takes_maps and (holds_maps(folder) or looks_like_one(folder)))


def _files(reference: str, takes_maps: bool) -> list[str]:
    if not _is_library(reference, takes_maps):
        return [reference]
    folder = Path(reference)
    try:
        materials = [path for path in sorted(folder.iterdir()) if path.is_dir() and _is_material(path, takes_maps)]
        found = [*joined(pictures_in(folder), lambda stem: recognised(stem) is not None), *materials]
    except OSError as error:
        raise refused(f"{reference}: cannot be read: {error.strerror}") from None
    if told := told_of_several(folder):
        raise refused(f"{reference}: {told}")
    if not found:
        told = _unread(reference)
        raise refused(f"{reference}: is a folder without pictures" + (f"; {told}" if told else ""))
    return list(map(str, found))


def _unread(reference: str) -> str:
    """What is told of pictures in a folder that are not read."""
    folder = Path(reference)
    return formats.told_of_unread(path.name for path in folder.iterdir()) if folder.is_dir() else ""


def _ignored(reference: str) -> str:
    """What is told of other files beside the pictures of a folder; hidden ones are none."""
    left = [
        one.name
        for one in sorted(Path(reference).iterdir())
        if one.suffix.lower() not in formats.SUFFIXES
        and not one.name.startswith(".")
        and not formats.is_unread(one.name)
        and one.is_file()
    ]
    return _told_of_ignored(left) if left else ""
