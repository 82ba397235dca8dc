"""JSON files that begin with the digest of what follows, so that one that was altered is as good as absent."""

from __future__ import annotations

import contextlib
import hashlib
import json
from pathlib import Path
from typing import Any

from texloom.pipelines.store.atomic import write_atomically

_MAX_SIZE = 2**28  # bytes


def read(path: Path) -> dict[str, Any]:
    """What `write` wrote; empty where it is not there, or not as it was written."""
    with contextlib.suppress(OSError, ValueError, TypeError, RecursionError):  # whoever can write it knows the form
        if path.is_file() and path.stat().st_size <= _MAX_SIZE:
            digest, _, content = path.read_bytes().partition(b"\n")
            if hashlib.sha256(content).hexdigest().encode() == digest:
                return dict(json.loads(content))
    return {}


def write(path: Path, entries: dict[str, Any]) -> None:
    """Write a file, complete or not at all, if that is possible. Of two processes at once one is not heard."""
    content = json.dumps(entries).encode()
    with contextlib.suppress(OSError):
        path.parent.mkdir(parents=True, exist_ok=True)
        write_atomically(path, hashlib.sha256(content).hexdigest().encode() + b"\n" + content, durable=False)
