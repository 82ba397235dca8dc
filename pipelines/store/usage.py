"""How much a store holds: sizes of files, and a running total, so that not every run has to look at all of them.

The total is in ``size.json`` from the first run under a limit on. It is what was measured last and what has been
written since. What killed runs leave is missing in it, and what was removed by hand is not, so it is measured anew
after a day.
"""

from __future__ import annotations

import contextlib
import json
import os
import stat
import time
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from texloom.pipelines.store.store import Store

_NAME = "size.json"
_MOST = 4096  # bytes of it
_MAX_AGE = 86400  # seconds since it was measured
_BESIDE = 2000  # bytes: the record of a result, notes of its exports


def total(store: Store) -> int | None:
    """Bytes of the store, if it was measured within a day."""
    try:
        content = _read(store)
        size, measured = int(content["bytes"]), float(content["measured"])
    except (OSError, ValueError, KeyError, TypeError, OverflowError, RecursionError):
        return None
    return size if abs(time.time() - measured) < _MAX_AGE else None


def measured(store: Store, size: int) -> None:
    """Keep the size that all files together have now."""
    _write(store, {"bytes": size, "measured": time.time()})


def add(store: Store, path: Path) -> None:
    """Count a result or an export that has just been written, if there is a total."""
    if (store.root / _NAME).exists():
        change(store, size_of(path) + _BESIDE)


def change(store: Store, size: int) -> None:
    """Count so many bytes more, if there is a total."""
    if not (store.root / _NAME).exists():
        return
    with contextlib.suppress(OSError, ValueError, KeyError, TypeError), store.lock("size"):
        content = _read(store)
        _write(store, {**content, "bytes": max(0, content["bytes"] + size)})


def forget(store: Store) -> None:
    """Let the next run under a limit measure the store."""
    with store.inside() as folder:
        folder.unlink_file(_NAME)


def _read(store: Store) -> Any:
    with store.inside() as folder:
        return json.loads(folder.read(_NAME, _MOST))


def _write(store: Store, content: dict[str, float]) -> None:
    with contextlib.suppress(OSError), store.inside() as folder:
        folder.write(_NAME, json.dumps(content).encode())


def size_of(path: str | Path) -> int:
    """Bytes of a file, or of all files in a folder; links, and what vanishes meanwhile, are left out."""
    total = 0
    try:
        with os.scandir(path) as found:
            for entry in found:
                try:
                    if entry.is_file(follow_symlinks=False):
                        total += entry.stat(follow_symlinks=False).st_size
                    elif entry.is_dir(follow_symlinks=False):
                        total += size_of(entry.path)
                except OSError:  # `contextlib.suppress` would take a tenth of the time
                    pass
    except NotADirectoryError:
        return sum(status.st_size for status in statuses(path) if stat.S_ISREG(status.st_mode))
    except OSError:
        pass
    return total


def inodes(folder: str | Path) -> Iterator[tuple[str, int]]:
    """The names in a folder, of which there may be a million, and their inodes, from listing it alone."""
    with contextlib.suppress(OSError), os.scandir(folder) as entries:
        for entry in entries:
            yield entry.name, entry.inode()


def times(folder: str | Path) -> dict[str, float]:
    """When each file of a folder, of perhaps a million, was written or touched, in seconds since 1970."""
    found: dict[str, float] = {}
    with contextlib.suppress(OSError), os.scandir(folder) as entries:
        for entry in entries:
            try:  # noqa: SIM105 (as in `size_of`)
                found[entry.name] = entry.stat(follow_symlinks=False).st_mtime
            except OSError:
                pass
    return found


def statuses(path: str | Path) -> Iterator[os.stat_result]:
    """Of a file or folder and all that is in it; what vanishes meanwhile is left out."""
    try:
        status = os.lstat(path)
    except OSError:
        return
    yield status
    if stat.S_ISDIR(status.st_mode):
        for name in names(path):
            yield from statuses(f"{path}/{name}")


def names(folder: str | Path) -> list[str]:
    """The names in a folder, of which there may be a million; none where there is no folder."""
    try:
        return os.listdir(folder)  # noqa: PTH208
    except OSError:
        return []
