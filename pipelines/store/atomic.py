"""Atomic writes, and digests of files."""

from __future__ import annotations

import contextlib
import hashlib
import importlib.util
import itertools
import os
import re
import secrets
import shutil
import tempfile
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import BinaryIO

from texloom.stages.declare import InputError

_CAN_LOCK = importlib.util.find_spec("fcntl") is not None
"""not on Windows, which moreover cannot rename an open file: there, its age tells that a file is abandoned"""
if _CAN_LOCK:
    import fcntl

_TEMPORARY = re.compile(r"\.new-[0-9a-f]{8}-.+")
_MAX_AGE = 7 * 86400  # seconds, of a temporary file where files are not locked
_SMALL = 2**18  # bytes of a file that is read at once


@contextlib.contextmanager
def atomic_path(path: Path, durable: bool = True, folder: Path | None = None) -> Iterator[Path]:
    """A temporary path to write to, which is renamed to ``path`` at the end of the ``with`` block.

    The file is thus complete or absent; if it is ``durable``, also after a power failure. A temporary file of a
    process that was killed is removed by `remove_abandoned`. It is made beside ``path``, or in ``folder``, of the
    same file system.
    """
    folder = folder or path.parent
    temporary, owned = _owned_file(lambda: folder / f".new-{secrets.token_hex(4)}-{path.name}")
    try:
        with named(path):
            yield temporary
            if durable:
                with temporary.open("r+b") as file:
                    os.fsync(file.fileno())
            temporary.replace(path)
    finally:
        temporary.unlink(missing_ok=True)
        owned.close()


@contextlib.contextmanager
def named(path: Path) -> Iterator[None]:
    """Name ``path`` in an `OSError` that names no file, as that of a full disk."""
    try:
        yield
    except OSError as error:
        if error.errno is None or error.filename is not None:
            raise
        raise OSError(error.errno, error.strerror, str(path)) from None


@contextlib.contextmanager
def owned_file(folder: Path) -> Iterator[Path]:
    """A new empty file for the ``with`` block; if the process is killed, `remove_abandoned` removes it."""
    path, owned = _owned_file(lambda: folder / f".new-{secrets.token_hex(4)}-owned")
    try:
        yield path
    finally:
        path.unlink(missing_ok=True)
        owned.close()


def _owned_file(new_path: Callable[[], Path]) -> tuple[Path, BinaryIO]:
    """A new file with a lock that lasts as long as it is open: the kernel closes it with the process."""
    while True:
        path = new_path()
        file = path.open("x+b")
        if not _CAN_LOCK:
            file.close()
            return path, file
        with contextlib.suppress(OSError):  # a file system without locks: then others cannot remove it either
            fcntl.flock(file, fcntl.LOCK_EX)
        if os.fstat(file.fileno()).st_nlink:
            return path, file
        file.close()  # it was taken for abandoned before it was locked


def remove_abandoned(folder: Path) -> list[Path]:
    """Remove the temporary files in a folder that no living process holds; those that others hold are returned."""
    held = []
    for path in folder.glob(".new-*"):
        if _TEMPORARY.fullmatch(path.name):
            with contextlib.suppress(OSError):
                if not _remove_if_abandoned(path):
                    held.append(path)
    return held


def _remove_if_abandoned(path: Path) -> bool:
    if not _CAN_LOCK:
        old = time.time() - path.stat().st_mtime > _MAX_AGE
        if old:
            path.unlink()
        return old
    handle = os.open(path, os.O_RDWR | os.O_NOFOLLOW | os.O_NONBLOCK)
    try:
        fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
        path.unlink()  # while it is locked, so that its owner cannot take it now
    except OSError:
        return False
    finally:
        os.close(handle)
    return True


def remove(path: Path) -> None:
    """Remove a file, a link, or a folder with all that is in it, if it is there."""
    if path.is_dir() and not path.is_symlink():
        shutil.rmtree(path, ignore_errors=True)
    else:
        path.unlink(missing_ok=True)


def probe_folder(folder: Path) -> None:
    """`OSError` where no file can be created in a folder."""
    with tempfile.TemporaryFile(dir=folder):
        pass


def write_atomically(path: Path, content: bytes, durable: bool = True, folder: Path | None = None) -> None:
    """Write a file so that it is complete or absent, see `atomic_path`."""
    with atomic_path(path, durable, folder) as temporary:
        temporary.write_bytes(content)


def file_digest(file: Path | BinaryIO) -> str:
    """SHA-256 of a file's content, 64 hexadecimal digits; an open file is read from its start."""
    if isinstance(file, Path):
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


def _existing(path: Path) -> Path:
    """The folder ``path``, or the nearest one above that exists."""
    existing = path.absolute()
    while not existing.exists() and existing != existing.parent:
        existing = existing.parent
    return existing


def free_space(path: Path) -> int:
    """Bytes that are free where the folder ``path`` is, or would be."""
    return shutil.disk_usage(_existing(path)).free


def check_folder(option: str, path: Path) -> None:
    """`InputError` where the folder ``path`` cannot be created or written; leaves nothing behind."""
    existing = _existing(path)
    if not existing.is_dir():
        raise InputError(f"{option} {path}: {existing} is not a folder")
    try:
        probe_folder(existing)  # the superuser has permission where nothing can be written, as in /proc
    except OSError as error:
        why = "" if isinstance(error, FileNotFoundError) else f": {str(error.strerror or error).lower()}"
        raise InputError(f"{option} {path}: {existing} cannot be written{why}") from None
