"""JSON files that begin with the digest of what follows, so that one that was altered is as good as absent."""

from __future__ import annotations

import contextlib
import hashlib
import json
from pathlib import Path
from typing import Any

from texloom.pipelines.store.folders import Folder

_MAX_SIZE = 2**28  # bytes


def read(path: Path) -> dict[str, Any]:
    """What `write` wrote; empty where it is not there, or not as it was written."""
    with contextlib.suppress(OSError), Folder.at(path.parent) as folder:
        return read_in(folder, path.name)
    return {}


def read_in(folder: Folder, name: str) -> dict[str, Any]:
    """As `read`."""
    with contextlib.suppress(OSError, ValueError, TypeError, RecursionError):  # whoever can write it knows the form
        digest, _, content = folder.read(name, _MAX_SIZE).partition(b"\n")
        if hashlib.sha256(content).hexdigest().encode() == digest:
            return dict(json.loads(content))
    return {}


def write(path: Path, entries: dict[str, Any]) -> None:
    """Write a file, complete or not at all, if that is possible. Of two processes at once one is not heard."""
    with contextlib.suppress(OSError), Folder.at(path.parent, create=True) as folder:
        write_in(folder, path.name, entries)


def write_in(folder: Folder, name: str, entries: dict[str, Any]) -> None:
    """As `write`; `OSError` where it is not possible."""
    content = json.dumps(entries).encode()
    folder.write(name, hashlib.sha256(content).hexdigest().encode() + b"\n" + content)
