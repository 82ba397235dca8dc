"""The log of runs: what each was, and which results it used. It serves listings only, and may be deleted."""

from __future__ import annotations

import contextlib
import dataclasses
import hashlib
import json
import re
from collections.abc import Collection, Mapping
from pathlib import Path
from typing import Any

from texloom.pipelines.store.folders import Folder

_FOLDER = "log"
_NAME = re.compile(r"[0-9a-f]{32}\.json")
_MAX_SIZE = 1 << 28  # bytes of an entry that is read


@dataclasses.dataclass(frozen=True)
class LoggedRun:
    """A run that used results of the store."""

    flow: str
    sources: Mapping[str, str]
    """name to file or pattern"""
    seeds: tuple[int, ...]
    steps: Mapping[str, str]
    """step, after its item's name over a set, to the key of its result"""
    used: float = 0.0
    """when it was last run, in seconds since 1970"""


def write(root: Path, run: LoggedRun) -> None:
    """Log a run in the store at ``root``, if that is possible; one that is repeated keeps its entry."""
    content = {"flow": run.flow, "sources": dict(run.sources), "seeds": run.seeds, "steps": dict(run.steps)}
    text = json.dumps(content).encode()
    name = f"{hashlib.sha256(text).hexdigest()[:32]}.json"
    with contextlib.suppress(OSError), Folder.at(root, _FOLDER, create=True) as folder:
        if folder.status(name) is not None:
            folder.touch(name)
        else:
            folder.write(name, text)


def read(root: Path) -> list[LoggedRun]:
    """The logged runs, the last one first; what cannot be read is left out."""
    try:
        with Folder.at(root, _FOLDER) as folder:
            runs = [run for name in folder.names() if _NAME.fullmatch(name) and (run := _read(folder, name))]
    except OSError:
        return []
    return sorted(runs, key=lambda run: -run.used)


def forget(root: Path, kept: Collection[str], oldest: float) -> None:
    """Remove the runs before ``oldest`` of whose results none is among the keys ``kept``."""
    with contextlib.suppress(FileNotFoundError), Folder.at(root, _FOLDER) as folder:
        for name in filter(_NAME.fullmatch, folder.names()):
            run = _read(folder, name)
            if run is None or (run.used < oldest and not any(key in kept for key in run.steps.values())):
                folder.unlink_file(name)


def _read(folder: Folder, name: str) -> LoggedRun | None:
    try:
        used = folder.time(name)
        content: Any = json.loads(folder.read(name, _MAX_SIZE))
        flow, sources, seeds, steps = (content[name] for name in ("flow", "sources", "seeds", "steps"))
        texts = [flow, *sources.keys(), *sources.values(), *steps.keys(), *steps.values()]
        if all(isinstance(text, str) for text in texts) and all(type(seed) is int for seed in seeds):
            return LoggedRun(flow, sources, tuple(seeds), steps, used)
    except (OSError, ValueError, KeyError, TypeError, AttributeError, RecursionError):
        pass
    return None
