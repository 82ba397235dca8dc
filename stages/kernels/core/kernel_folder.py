"""Where compiled kernels are kept: a folder that no other process writes to.

It is in the user's cache and named by the digest of all kernels, or it is ``NUMBA_CACHE_DIR``. Numba does not
expect two processes to add to the same entry: so the first process takes the folder, and others take ones inside
it. All read from all of them. A folder is free again when its process has ended, however it did.
"""

from __future__ import annotations

import hashlib
import itertools
import logging
import os
import threading
from functools import cache
from pathlib import Path
from typing import Any

_LOG = logging.getLogger(__name__)

_taking = threading.Lock()
_taken: list[tuple[Path | None, Any]] = []  # with the lock, which belongs to the process


def taken_folder() -> Path | None:
    """The folder that this process has taken; none if it cannot be written to."""
    with _taking:
        if not _taken:
            base = kernel_folder()
            try:
                _taken.append(_take(base))
            except (OSError, NotImplementedError) as error:
                _LOG.warning("compiled kernels cannot be kept in %s: %s", base, error)
                _taken.append((None, None))
        return _taken[0][0]


def other_folders() -> list[Path]:
    """Those that other processes have taken, now or earlier."""
    base = kernel_folder()
    return [folder for folder in (base, *sorted(base.glob("beside-*"))) if folder != taken_folder()]


def kernel_folder() -> Path:
    """The folder that the first process takes."""
    return Path(os.environ.get("NUMBA_CACHE_DIR") or _default())


@cache
def kernel_digest() -> str:
    """Of the sources of all kernels: Numba by itself sees a change in a kernel's own file, not in what it calls."""
    import texloom.stages.kernels

    files = sorted(Path(next(iter(texloom.stages.kernels.__path__))).rglob("*.py"))
    return hashlib.sha256(b"".join(path.read_bytes() for path in files)).hexdigest()[:16]


def _take(base: Path) -> tuple[Path, Any]:
    """The first folder that is free, and the lock on it."""
    import filelock

    for number in itertools.count():
        folder = base / f"beside-{number}" if number else base
        folder.mkdir(parents=True, exist_ok=True)
        lock = filelock.FileLock(folder / ".taken", fallback_to_soft=False, thread_local=False)
        try:
            lock.acquire(timeout=0)
        except filelock.Timeout:
            continue
        return folder, lock
    raise AssertionError


def _default() -> Path:
    import platformdirs

    return platformdirs.user_cache_path("texloom") / f"kernels-{kernel_digest()}"
