"""Tables in the user's cache folder, for what would take a while to find out again. They may vanish at any time."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from texloom.pipelines.store import checked_json

_MOST = 1000  # entries of a table


def load(name: str) -> dict[str, Any]:
    """The table called ``name``; an empty one where it is not there, or not as it was written."""
    return checked_json.read(_file(name))


def save(name: str, entries: dict[str, Any], most: int = _MOST) -> None:
    """Keep the newest entries, at most so many, if that is possible."""
    checked_json.write(_file(name), dict(list(entries.items())[-most:]))


def _file(name: str) -> Path:
    import platformdirs

    return platformdirs.user_cache_path("texloom") / f"{name}.json"
