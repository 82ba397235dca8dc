"""Where compiled kernels are kept: a folder that no other process writes to."""

from __future__ import annotations

import contextlib
import hashlib
import itertools
import os
import shutil
from pathlib import Path
from typing import Any

_BASE = "TEXLOOM_KERNELS"  # tells processes started from here the folder that all have in common
_held: Any = None


def keep_kernels() -> None:
    """Keep compiled kernels in the user's cache, by the digest of all kernels, or below ``NUMBA_CACHE_DIR``.

    Numba by itself sees a change in a kernel's own file only, not in those that it calls. Nor does it expect two
    processes to add to the same entry: so the first process takes the folder, and others take ones inside it, which
    start as copies. A folder is free again when its process has ended, however it did.
    """
    global _held  # noqa: PLW0603 (the lock belongs to the process)
    if _held is not None:
        return
    _held = False
    base = str(kernel_folder())
    with contextlib.suppress(OSError, NotImplementedError):
        folder, _held = _take(Path(base))
        os.environ[_BASE] = base
        os.environ["NUMBA_CACHE_DIR"] = str(folder)


def kernel_folder() -> Path:
    """The folder that the first process takes."""
    return Path(os.environ.get(_BASE) or os.environ.get("NUMBA_CACHE_DIR") or _default())


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
        if number:
            _copy(base, folder)
        return folder, lock
    raise AssertionError


def _copy(base: Path, folder: Path) -> None:
    """Take over the kernels that are compiled in ``base`` alone.

    Their indices come first: what an index names and is not there is compiled again.
    """
    indices = [path for path in base.glob("*/*.nbi") if not (folder / path.parent.name / path.name).exists()]
    code = [path for index in indices for path in index.parent.glob(f"{index.stem}.*.nbc")]
    for path in [*indices, *code]:
        with contextlib.suppress(OSError):
            (folder / path.parent.name).mkdir(exist_ok=True)
            shutil.copy2(path, folder / path.parent.name / path.name)


def _default() -> Path:
    import platformdirs

    return platformdirs.user_cache_path("texloom") / f"kernels-{_kernel_digest()}"


def _kernel_digest() -> str:
    import texloom.stages.kernels

    files = sorted(Path(next(iter(texloom.stages.kernels.__path__))).rglob("*.py"))
    return hashlib.sha256(b"".join(path.read_bytes() for path in files)).hexdigest()[:16]
