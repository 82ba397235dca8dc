"""Tables in the user's cache folder, for what would take a while to find out again. They may vanish at any time."""

from __future__ import annotations

import contextlib
import hashlib
import json
from pathlib import Path
from typing import Any

from texloom.pipelines.store.atomic import write_atomically

_MOST = 1000  # entries of a table


def load(name: str) -> dict[str, Any]:
    """The table called ``name``; an empty one where it is not there, or not as it was written."""
    try:
        digest, _, content = _file(name).read_bytes().partition(b"\n")
        if hashlib.sha256(content).hexdigest().encode() == digest:
            return dict(json.loads(content))
    except OSError:
        pass
    return {}


def save(name: str, entries: dict[str, Any]) -> None:
    """Keep the newest entries, if that is possible. Of two processes that do so at once, one is not heard."""
    content = json.dumps(dict(list(entries.items())[-_MOST:])).encode()
    with contextlib.suppress(OSError):
        path = _file(name)
        path.parent.mkdir(parents=True, exist_ok=True)
        write_atomically(path, hashlib.sha256(content).hexdigest().encode() + b"\n" + content, durable=False)


def _file(name: str) -> Path:
    import platformdirs

    return platformdirs.user_cache_path("texloom") / f"{name}.json"
