"""What was read of picture files before, so that those of a large set need not be opened again.

A file is as it was if its path, inode, size and both times of change are; the second one, of the inode, no program
sets. A file that changed so shortly before it was read that another change might have the same time is read again.
"""

from __future__ import annotations

import contextlib
import dataclasses
import os
import stat
import time
from collections.abc import Iterable, Iterator, Mapping
from contextvars import ContextVar
from pathlib import Path
from typing import Any

from texloom.pipelines.media.headers import Header

_RESOLUTION = 2 * 10**9  # ns, of times of the coarsest file systems
_HAS_CHANGE_TIME = os.name == "posix"


@dataclasses.dataclass(frozen=True)
class Inspected(Header):
    """What a picture file's header and content tell."""

    digest: str
    """SHA-256 of the content and of the version of the decoding, 64 hexadecimal digits"""
    note: str = ""
    """what was assumed of its colour, for the user"""
    original_bits: Mapping[str, int] = dataclasses.field(default_factory=dict)
    """as ``bits``, of what texloom made each map, by its role, in a file of floats from, where that is known"""
    facts: Mapping[str, Any] = dataclasses.field(default_factory=dict)
    """what texloom has written into it, see `Facts.record`"""
    texel_size: float | None = None
    """side of a pixel, m, where texloom has written it"""
    names: Mapping[str, str] = dataclasses.field(default_factory=dict)
    """of the files that maps came from, by role, without suffix, where texloom has written it"""


class KnownFiles:
    """A table of files, as JSON has it; ``code`` tells versions of the decoding apart."""

    def __init__(self, entries: dict[str, Any], code: str):
        self.entries = entries
        self.is_new = False
        """whether entries were added"""
        self._code = code

    def find(self, path: Path, how: str) -> tuple[Inspected | None, str]:
        """What is known of a file that was read as ``how``, and its state, for `add`; empty: not to be kept."""
        status = path.stat()
        changed = max(status.st_mtime_ns, status.st_ctime_ns)
        if not (stat.S_ISREG(status.st_mode) and changed < time.time_ns() - _RESOLUTION):
            return None, ""
        numbers = (status.st_dev, status.st_ino, status.st_size, status.st_mtime_ns, status.st_ctime_ns)
        state = f"{self._code} {how} {numbers}"
        entry = self.entries.get(os.path.abspath(path))  # noqa: PTH100 (as text, as there are thousands)
        if entry is None or entry[0] != state:
            return None, state
        height, width, channels, *others = entry[1:]
        return Inspected(height, width, tuple(channels), *others), state

    def told(self, digest: str) -> tuple[str, ...] | None:
        """What was told of the material of this digest; None where it is not known."""
        entry = self.entries.get(digest)
        return tuple(entry[1:]) if entry is not None and entry[0] == self._code else None

    def tell(self, digest: str, notes: Iterable[str]) -> None:
        """Keep what is told of a material."""
        self.entries[digest] = [self._code, *notes]
        self.is_new = True

    def add(self, path: Path, state: str, inspected: Inspected) -> None:
        """Keep what was read of a file, unless it has changed since `find`."""
        if state:
            self.entries[os.path.abspath(path)] = [state, *dataclasses.astuple(inspected)]  # noqa: PTH100
            self.is_new = True


_current: ContextVar[KnownFiles | None] = ContextVar("_current", default=None)


@contextlib.contextmanager
def using(known: KnownFiles | None) -> Iterator[None]:
    """Use and fill a table inside the ``with`` block; none: read every file."""
    token = _current.set(known if _HAS_CHANGE_TIME else None)
    try:
        yield
    finally:
        _current.reset(token)


def current() -> KnownFiles | None:
    """The table that is in use."""
    return _current.get()
