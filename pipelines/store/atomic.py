"""Atomic writes, and digests of files."""

from __future__ import annotations

import contextlib
import fcntl
import hashlib
import itertools
import os
import re
import secrets
import tempfile
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import BinaryIO

from texloom.stages.declare import InputError

_TEMPORARY = re.compile(r"\.new-[0-9a-f]{8}-.+")


@contextlib.contextmanager
def atomic_path(path: Path, durable: bool = True) -> Iterator[Path]:
    """A temporary path to write to, which is renamed to ``path`` at the end of the ``with`` block.

    The file is thus complete or absent; if it is ``durable``, also after a power failure. A temporary file of a
    process that was killed is removed by `remove_abandoned`.
    """
    temporary, handle = _owned_file(lambda: path.with_name(f".new-{secrets.token_hex(4)}-{path.name}"))
    try:
        yield temporary
        if durable:
            with temporary.open("r+b") as file:
                os.fsync(file.fileno())
        temporary.replace(path)
    finally:
        temporary.unlink(missing_ok=True)
        os.close(handle)


@contextlib.contextmanager
def owned_file(folder: Path) -> Iterator[Path]:
    """A new empty file for the ``with`` block; if the process is killed, `remove_abandoned` removes it."""
    path, handle = _owned_file(lambda: folder / f".new-{secrets.token_hex(4)}-owned")
    try:
        yield path
    finally:
        path.unlink(missing_ok=True)
        os.close(handle)


def _owned_file(new_path: Callable[[], Path]) -> tuple[Path, int]:
    """A new file with a lock that lasts as long as its open handle: the kernel closes it with the process."""
    while True:
        path = new_path()
        handle = os.open(path, os.O_RDWR | os.O_CREAT | os.O_EXCL, 0o666)
        with contextlib.suppress(
            OSError
        ):  # a file system without locks: then it cannot be removed by others either
            fcntl.flock(handle, fcntl.LOCK_EX)
        if os.fstat(handle).st_nlink:
            return path, handle
        os.close(handle)  # it was taken for abandoned before it was locked


def remove_abandoned(folder: Path) -> list[Path]:
    """Remove the temporary files in a folder that no living process holds; those that others hold are returned."""
    held = []
    for path in folder.glob(".new-*"):
        if _TEMPORARY.fullmatch(path.name):
            with contextlib.suppress(OSError):
                handle = os.open(path, os.O_RDWR | os.O_NOFOLLOW | os.O_NONBLOCK)
                try:
                    fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
                    path.unlink()
                except OSError:
                    held.append(path)
                finally:
                    os.close(handle)
    return held


def probe_folder(folder: Path) -> None:
    """`OSError` where no file can be created in a folder."""
    with tempfile.TemporaryFile(dir=folder):
        pass


def write_atomically(path: Path, content: bytes, durable: bool = True) -> None:
    """Write a file so that it is complete or absent; if it is ``durable``, also after a power failure."""
    with atomic_path(path, durable) as temporary:
        temporary.write_bytes(content)


def file_digest(file: Path | BinaryIO) -> str:
    """SHA-256 of a file's content, 64 hexadecimal digits; an open file is read from its start."""
    if isinstance(file, Path):
        with file.open("rb") as opened:
            return file_digest(opened)
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


def check_folder(option: str, path: Path) -> None:
    """`InputError` where the folder ``path`` cannot be created or written; creates nothing."""
    existing = path.absolute()
    while not existing.exists() and existing != existing.parent:
        existing = existing.parent
    if not existing.is_dir():
        raise InputError(f"{option} {path}: {existing} is not a folder")
    if not os.access(existing, os.W_OK | os.X_OK):
        raise InputError(f"{option} {path}: {existing} cannot be written: permission denied")
