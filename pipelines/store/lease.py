"""Leases: which runs are going on, so that nobody removes from the store what they use."""

from __future__ import annotations

import contextlib
import time
from pathlib import Path
from typing import Any

from texloom.pipelines.store.folders import Folder

_FOLDER = "running"
_MARGIN = 60.0  # seconds before its beginning in which a run may have touched what it uses


class Lease:
    """A file that exists while a run goes on, and whose time is that of the run's beginning."""

    def __init__(self, root: Path):
        """``root``: of the store."""
        self.root = root
        self.began = time.time()
        self.is_taken = False
        """whether the run has written to the store"""
        self._stack = contextlib.ExitStack()

    def take(self) -> None:
        """Write the file, if that is possible. A run does so before it writes anything else."""
        if not self.is_taken:
            with contextlib.suppress(OSError):
                folder = self._stack.enter_context(Folder.at(self.root, _FOLDER, create=True))
                name, _ = self._stack.enter_context(folder.owned("owned"))
                self.is_taken = True
                folder.touch(name, int(self.began * 1e9))

    def __enter__(self) -> Lease:
        return self

    def __exit__(self, *_: Any) -> None:
        with contextlib.suppress(OSError):  # of a store that does not answer, which matters less than why it ends
            self._stack.close()


def protected_since(root: Path) -> float:
    """What was used since then may be in use by a run, in seconds since 1970; infinite if no run is going on."""
    try:
        with Folder.at(root, _FOLDER) as folder:
            times = [folder.time(name) - _MARGIN for name in folder.remove_abandoned()]
    except FileNotFoundError:
        return float("inf")
    return min((one for one in times if one > 0), default=float("inf"))  # not those that have just ended
