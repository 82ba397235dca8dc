"""The log of runs: what each was, and which results it used. It serves listings only, and may be deleted."""

from __future__ import annotations

import contextlib
import dataclasses
import hashlib
import json
import os
from collections.abc import Collection, Mapping
from pathlib import Path
from typing import Any

from texloom.pipelines.store.atomic import write_atomically

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
    path = _folder(root) / f"{hashlib.sha256(text).hexdigest()[:32]}.json"
    with contextlib.suppress(OSError):
        if path.exists():
            os.utime(path)
        else:
            path.parent.mkdir(parents=True, exist_ok=True)
            write_atomically(path, text, durable=False)


def read(root: Path) -> list[LoggedRun]:
    """The logged runs, the last one first; what cannot be read is left out."""
    runs = [run for path in _folder(root).glob("*.json") if (run := _read(path)) is not None]
    return sorted(runs, key=lambda run: -run.used)


def forget(root: Path, kept: Collection[str], oldest: float) -> None:
    """Remove the runs before ``oldest`` of whose results none is among the keys ``kept``."""
    for path in _folder(root).glob("*.json"):
        run = _read(path)
        is_old = run is None or (run.used < oldest and not any(key in kept for key in run.steps.values()))
        if is_old:
            path.unlink(missing_ok=True)


def _folder(root: Path) -> Path:
    return root / "log"


def _read(path: Path) -> LoggedRun | None:
    try:
        status = path.stat()
        if status.st_size > _MAX_SIZE:
            return None
        content: Any = json.loads(path.read_bytes())
        flow, sources, seeds, steps = (content[name] for name in ("flow", "sources", "seeds", "steps"))
        texts = [flow, *sources.keys(), *sources.values(), *steps.keys(), *steps.values()]
        if all(isinstance(text, str) for text in texts) and all(type(seed) is int for seed in seeds):
            return LoggedRun(flow, sources, tuple(seeds), steps, status.st_mtime)
    except (OSError, ValueError, KeyError, TypeError, AttributeError, RecursionError):
        pass
    return None
