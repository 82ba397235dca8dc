"""Where the store is unless a caller names it."""

from __future__ import annotations

import os
from pathlib import Path

PROJECT_STORE = "artifacts"
"""a working folder with such a folder in it is a project, and that folder its store"""


def default_store() -> Path:
    """TEXLOOM_STORE, else the project's store, else one in the user's cache folder that all programs share."""
    chosen = os.environ.get("TEXLOOM_STORE")
    if chosen:
        return Path(chosen)
    return Path(PROJECT_STORE) if Path(PROJECT_STORE).is_dir() else cache_store()


def cache_store() -> Path:
    """The store in the user's cache folder."""
    import platformdirs

    return platformdirs.user_cache_path("texloom") / "store"
