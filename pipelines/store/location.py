"""Where the store is unless a caller names it."""

from __future__ import annotations

import os
from pathlib import Path

from texloom.pipelines.store import ownership

PROJECT_STORE = "artifacts"
"""a working folder with such a folder in it is a project, and that folder its store if nothing else is in it"""


def default_store() -> Path:
    """TEXLOOM_STORE, else the project's store, else one in the user's cache folder that all programs share."""
    chosen = os.environ.get("TEXLOOM_STORE")
    if chosen:
        return Path(chosen)
    project = Path(PROJECT_STORE)
    return project if project.is_dir() and ownership.is_usable(project) else cache_store()


def shared_store(given: str | None) -> str:
    """Address of the shared store: what is given, else TEXLOOM_REMOTE; empty where there is none.

    Raises
    ------
    InputError : it is none, or what reaches it is not installed.
    """
    url, option = given, "--remote"
    if url is None:
        url, option = os.environ.get("TEXLOOM_REMOTE", ""), "TEXLOOM_REMOTE"
        if not url:
            return ""
    from texloom.pipelines.store.remote import check_url

    check_url(url, option)
    return url


def cache_store() -> Path:
    """The store in the user's cache folder."""
    import platformdirs

    return platformdirs.user_cache_path("texloom") / "store"


def passed_over(root: Path) -> str | None:
    """A line on a folder ``artifacts`` here that is not used, where ``root`` is used in its place."""
    project = Path(PROJECT_STORE)
    if os.environ.get("TEXLOOM_STORE") or not project.is_dir():
        return None
    if project.resolve() == root or root != cache_store().resolve():
        return None
    why, remedy = "holds other files", "--store chooses a folder"
    if ownership.has_form(project):
        why, remedy = "was made by another user or machine", "`texloom store adopt` takes it over"
    return f"{PROJECT_STORE} {why} and is left alone, results are in {root}; {remedy}"
