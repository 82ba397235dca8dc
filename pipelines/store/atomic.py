"""Files: written whole or not at all, told apart by what they hold."""

from __future__ import annotations

import contextlib
import hashlib
import itertools
import os
import secrets
from collections.abc import Iterator
from pathlib import Path

from texloom.stages.declare import InputError


@contextlib.contextmanager
def appearing(path: Path, durable: bool = True) -> Iterator[Path]:
    """A name to write a file under, which gets the name ``path`` at the end of the ``with`` block.

    So the file is there whole or not at all; if it is ``durable``, also after a power cut.
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
    """Write a file so that it is there whole or not at all; if it is ``durable``, also after a power cut."""
    with appearing(path, durable) as temporary:
        temporary.write_bytes(content)


def file_digest(path: Path) -> str:
    """SHA-256 of a file's content."""
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def make_new_folder(first: Path) -> Path:
    """Make a folder that nobody else has: ``first``, or where that is there already, one with a number after it."""
    for count in itertools.count(1):
        path = first if count == 1 else first.with_name(f"{first.name}-{count}")
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            path.mkdir()
        except FileExistsError:
            if not path.parent.is_dir():
                raise
        else:
            return path
    raise AssertionError  # the numbers do not end


def check_folder(option: str, path: Path) -> None:
    """`InputError` where ``path`` is no folder that can be written or made; creates nothing."""
    existing = path.absolute()
    while not existing.exists() and existing != existing.parent:
        existing = existing.parent
    if not existing.is_dir():
        raise InputError(f"{option} {path}: {existing} is not a folder")
    if not os.access(existing, os.W_OK | os.X_OK):
        raise InputError(f"{option} {path}: {existing} cannot be written: permission denied")
