"""Atomic writes, and digests of files."""

from __future__ import annotations

import contextlib
import hashlib
import itertools
import os
import secrets
from collections.abc import Iterator
from pathlib import Path
from typing import BinaryIO

from texloom.stages.declare import InputError


@contextlib.contextmanager
def atomic_path(path: Path, durable: bool = True) -> Iterator[Path]:
    """A temporary path to write to, which is renamed to ``path`` at the end of the ``with`` block.

    The file is thus complete or absent; if it is ``durable``, also after a power failure.
    """
    temporary = path.with_name(f".new-{secrets.token_hex(4)}-{path.name}")
    try:
        yield temporary
        if durable:
            with temporary.open("r+b") as file:
                os.fsync(file.fileno())
        temporary.replace(path)
    finally:
        temporary.unlink(missing_ok=True)


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
