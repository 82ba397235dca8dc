"""Atomic writes, and digests of files."""

from __future__ import annotations

import contextlib
import hashlib
import itertools
import os
import shutil
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import BinaryIO

from texloom.pipelines.errors import refused
from texloom.pipelines.store.folders import Folder, named
from texloom.stages.vocabulary.declare import InputError

_LONGEST_NAME = 255
_LONGEST_PATH = 3800  # of the 4096 that Linux has, as names are added
_SMALL = 2**18  # bytes of a file that is read at once


@contextlib.contextmanager
def atomic_path(path: Path, durable: bool = True) -> Iterator[Path]:
    """A temporary path to write to, which is renamed to ``path`` at the end of the ``with`` block.

    The file is thus complete or absent; if it is ``durable``, also after a power failure. A temporary file of a
    process that was killed is removed by `remove_abandoned`.
    """
    with Folder.at(path.parent) as folder, folder.owned(path.name) as (name, _):
        temporary = path.with_name(name)
        with named(path):
            yield temporary
            if durable:
                with temporary.open("r+b") as file:
                    os.fsync(file.fileno())
            folder.rename(name, path.name)


@contextlib.contextmanager
def owned_file(folder: Path) -> Iterator[Path]:
    """A new empty file for the ``with`` block; if the process is killed, `remove_abandoned` removes it."""
    with Folder.at(folder) as opened, opened.owned("owned") as (name, _):
        yield folder / name


def remove_abandoned(folder: Path) -> list[Path]:
    """Remove the temporary files in a folder that no living process holds; those that others hold are returned."""
    try:
        with Folder.at(folder) as opened:
            return [folder / name for name in opened.remove_abandoned()]
    except (FileNotFoundError, NotADirectoryError):
        return []


def probe_folder(folder: Path) -> None:
    """`OSError` where no file can be created in a folder."""
    with tempfile.TemporaryFile(dir=folder, prefix=".new-"):
        pass


def write_atomically(path: Path, content: bytes, durable: bool = True) -> None:
    """Write a file so that it is complete or absent, see `atomic_path`."""
    with Folder.at(path.parent) as folder:
        folder.write(path.name, content, durable)


def file_digest(file: str | Path | BinaryIO) -> str:
    """SHA-256 of a file's content, 64 hexadecimal digits; an open file is read from its start."""
    if isinstance(file, (str, Path)):
        with open(file, "rb") as opened:  # noqa: PTH123 (`Path.open` takes longer)
            return file_digest(opened)
    file.seek(0)
    start = file.read(_SMALL)
    if len(start) < _SMALL:  # `hashlib.file_digest` clears a buffer of its own first
        return hashlib.sha256(start).hexdigest()
    file.seek(0)
    return hashlib.file_digest(file, "sha256").hexdigest()  # type: ignore[arg-type]


def make_new_folder(first: Path) -> Path:
    """Create a new folder: ``first``, or if it exists, one with a number appended."""
    first.parent.mkdir(parents=True, exist_ok=True)
    paths = (first.with_name(f"{first.name}-{count}") for count in itertools.count(2))
    path = first
    while True:
        try:
            path.mkdir()
        except FileExistsError:
            path = next(paths)
        else:
            return path


def nearest_folder(path: Path) -> Path:
    """The folder ``path``, or the nearest one above that exists."""
    existing = path.absolute()
    while not existing.exists() and existing != existing.parent:
        existing = existing.parent
    return existing


def free_space(path: Path) -> int:
    """Bytes that are free where the folder ``path`` is, or would be."""
    return shutil.disk_usage(nearest_folder(path)).free


def too_long(path: str | Path) -> str | None:
    """Why a file or folder can have no such name, in words; none where its names are short enough."""
    text = os.path.abspath(path)  # noqa: PTH100 (keeps links; as text, as there are thousands)
    part = max(text.split("/"), key=_bytes)
    if _bytes(part) > _LONGEST_NAME:
        return f"the name {part[:20]}... has {_bytes(part)} bytes; {_LONGEST_NAME} are possible"
    size = _bytes(text)
    return f"the path has {size} bytes; {_LONGEST_PATH} are possible" if size > _LONGEST_PATH else None


def _bytes(name: str) -> int:
    return len(name.encode(errors="surrogatepass"))


def check_folder(option: str, path: Path) -> None:
    """`InputError` where the folder ``path`` cannot be created or written; leaves nothing behind."""
    problem = too_long(path)
    if problem is not None:
        raise refused(f"{option} {os.fspath(path):.40}...: {problem}")
    existing = nearest_folder(path)
    if not existing.is_dir():
        raise InputError(f"{option} {path}: {existing} is not a folder")
    try:
        probe_folder(existing)  # the superuser has permission where nothing can be written, as in /proc
    except OSError as error:
        why = "" if isinstance(error, FileNotFoundError) else f": {str(error.strerror or error).lower()}"
        raise InputError(f"{option} {path}: {existing} cannot be written{why}") from None
