"""Leases: which runs are going on, so that nobody removes from the store what they use."""

from __future__ import annotations

import contextlib
import os
import time
from pathlib import Path
from typing import Any

from texloom.pipelines.store.atomic import owned_file, remove_abandoned

_MARGIN = 60.0  # seconds before its beginning in which a run may have touched what it uses


class Lease:
    """A file that exists while a run goes on, and whose time is that of the run's beginning."""

    def __init__(self, folder: Path):
        self.folder = folder
        self.began = time.time()
        self.path: Path | None = None
        self._stack = contextlib.ExitStack()

    def take(self) -> None:
        """Write the file, if that is possible. A run does so before it writes anything else."""
        if self.path is None:
            with contextlib.suppress(OSError):
                self.folder.mkdir(exist_ok=True)
                self.path = self._stack.enter_context(owned_file(self.folder))
                os.utime(self.path, (self.began, self.began))

    @property
    def is_taken(self) -> bool:
        """Whether the run has written to the store."""
        return self.path is not None

    def __enter__(self) -> Lease:
        return self

    def __exit__(self, *_: Any) -> None:
        self._stack.close()


def protected_since(folder: Path) -> float:
    """What was used since then may be in use by a run, in seconds since 1970; infinite if no run is going on."""
    times = []
    for path in remove_abandoned(folder):
        with contextlib.suppress(OSError):  # it has just ended
            times.append(path.stat().st_mtime - _MARGIN)
    return min(times, default=float("inf"))
