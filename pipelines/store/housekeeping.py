"""Looking after a store: listing, verifying, and removing what has not been used, within a limit of its size.

Nothing is removed while it is in use: a result is removed under the lock of its key, a temporary file or folder
only if no living process writes it, and whatever may be used by a run that is going on is kept, see
`texloom.pipelines.store.lease`.
"""

from __future__ import annotations

import contextlib
import dataclasses
import json
import os
import re
import time
from collections.abc import Collection, Iterator
from pathlib import Path

from texloom.pipelines.store import run_log, usage
from texloom.pipelines.store.atomic import remove, remove_abandoned, write_atomically
from texloom.pipelines.store.lease import protected_since
from texloom.pipelines.store.record import record_name
from texloom.pipelines.store.store import (
    NOT_AS_EXPECTED,
    BrokenArtifactError,
    Store,
    check_files,
    read_manifest,
    small_file,
)

_KEY = re.compile(r"[0-9a-f]{64}")
_NEW_FOLDER = re.compile(r"\.new-([0-9a-f]{64})-[0-9a-f]{8}")
_SETTINGS = "settings.json"
_HISTORY_DAYS = 30
_ROOM = 10  # part of the limit that is made free at once


@dataclasses.dataclass(frozen=True)
class Entry:
    """A result, or something else that takes space in the store."""

    stage: str | None
    """None where it is not a result but exports of a run or arrays given by a program"""
    key: str | None
    folder: Path
    """where it is; a file, if it is an array"""
    size: int
    """bytes, with its checkpoints"""
    used: float
    """seconds since 1970"""


def entries(store: Store) -> list[Entry]:
    """All results, by stage, the least recently used first."""
    unfinished = set(_keys(store, "checkpoints"))
    found = []
    for stage, key in _keys(store, "cache"):
        folder = store.folder(stage, key)
        size = usage.size_of(folder)
        if (stage, key) in unfinished:
            size += usage.size_of(store.root / "checkpoints" / stage / key)
        found.append(Entry(stage, key, folder, size, store.used(store.location(stage, key))))
    return sorted(found, key=lambda entry: (str(entry.stage), entry.used))


def _keys(store: Store, kind: str) -> Iterator[tuple[str, str]]:
    """Stage and key of each folder in ``cache`` or ``checkpoints``, from the names alone."""
    for stage in usage.names(store.root / kind):
        for name in usage.names(store.root / kind / stage):
            if _KEY.fullmatch(name):
                yield stage, name


def other_entries(store: Store) -> list[Entry]:
    """Exports of runs without ``--out``, and arrays given by programs, the least recently used first."""
    paths = [*(store.root / "runs").glob("*"), *(store.root / "sources").glob("*")]
    found = [Entry(None, None, path, usage.size_of(path), _last_time(path)) for path in paths]
    return sorted(found, key=lambda entry: entry.used)


# -- verifying


def verify(store: Store) -> Iterator[tuple[Entry, str | None]]:
    """Every result and its problem, if any; every byte is compared. What is being computed is left out."""
    for entry in entries(store):
        problem = _problem(store, entry)
        if problem is not None:
            with store.try_lock(str(entry.stage), str(entry.key)) as is_locked:
                if is_locked:
                    problem = _problem(store, entry) if entry.folder.exists() else None
                elif store.locks.is_dir() and os.access(store.locks, os.W_OK):
                    continue  # a run is writing it
        if entry.folder.exists():
            yield entry, problem


def _problem(store: Store, entry: Entry) -> str | None:
    try:
        if store.find(str(entry.stage), str(entry.key)) is None:
            return "it has no record"
        manifest, _ = read_manifest(entry.folder)
        check_files(entry.folder, manifest["files"], thorough=True)
    except BrokenArtifactError as error:
        return str(error)
    return None


# -- removing


def prune(store: Store, days: float, dry_run: bool = False) -> list[Entry]:
    """Remove what no run has used for ``days`` days, and what nothing needs any more.

    What is at work is kept.
    """
    oldest = min(time.time() - days * 86400, protected_since(store.running))
    old = [entry for entry in (*entries(store), *other_entries(store)) if entry.used < oldest]
    if dry_run:
        return old
    removed = [entry for entry in old if _remove(store, entry, oldest)]
    _sweep(store, oldest)
    usage.forget(store)
    return removed


def limit(store: Store) -> int | None:
    """The most bytes that the store is to hold after a run, if there is a limit."""
    try:
        size = json.loads(small_file(store.root / _SETTINGS))["limit"]
    except NOT_AS_EXPECTED:
        return None
    return size if type(size) is int and size >= 0 else None


def set_limit(store: Store, size: int | None) -> None:
    """Set the limit, in bytes, that later runs obey at their end."""
    store.create()
    usage.forget(store)
    write_atomically(store.root / _SETTINGS, json.dumps({"limit": size}).encode())


def keep_limit(store: Store, measure: bool = True) -> list[Entry]:
    """Remove the least recently used results, exports and arrays until the store is within its limit.

    Parameters
    ----------
    measure : look at all files. Otherwise that is done only where the running total exceeds the limit, and then
        room is made for a tenth of it, as every run that writes calls this.
    """
    most = limit(store)
    if most is None:
        return []
    if not measure and (known := usage.total(store)) is not None and known <= most:
        return []
    size = usage.size_of(store.root)
    removed = []
    if size > most:
        goal = most if measure else most - most // _ROOM
        protected = protected_since(store.running)
        for entry in sorted((*entries(store), *other_entries(store)), key=lambda entry: entry.used):
            if size <= goal or entry.used >= protected:
                break
            if _remove(store, entry, protected):
                removed.append(entry)
                size -= entry.size
        _sweep(store, min(protected, removed[-1].used if removed else 0.0))
    usage.measured(store, size)
    return removed


def tidy(store: Store) -> None:
    """Remove the temporary files of runs that were killed."""
    for folder in (store.root, store.exports, store.running, store.root / "history", store.root / "log"):
        remove_abandoned(folder)
    for folder in (store.root / "runs").glob("*/"):
        remove_abandoned(folder)


def _remove(store: Store, entry: Entry, oldest: float) -> bool:
    """Remove an entry that was last used before ``oldest``; whether nobody uses it."""
    if entry.stage is None or entry.key is None:
        if _last_time(entry.folder) >= oldest:
            return False
        remove(entry.folder)
        return True
    with store.try_lock(entry.stage, entry.key) as is_locked:
        if not is_locked or store.used(store.location(entry.stage, entry.key)) >= oldest:  # it was used meanwhile
            return False
        store.forget(entry.stage, entry.key)
        remove(entry.folder)
        store.drop_checkpoints(entry.stage, entry.key)
    return True


def _sweep(store: Store, oldest: float) -> None:
    """Remove what nothing needs any more: what killed runs left, and the rest if it is older than ``oldest``."""
    tidy(store)
    for folder in (store.root / "runs").rglob("*/"):
        remove_abandoned(folder)
    _sweep_unfinished(store, oldest)
    keys = {key: record_name(stage, key) for stage, key in _keys(store, "cache")}
    kept = set(keys.values())
    waiting = {record_name(stage, key) for stage, key in _keys(store, "checkpoints")}
    _unlink_old(store.records, oldest, kept)
    _unlink_old(store.exports, oldest)
    # explains for a while why results are computed again
    _unlink_old(store.root / "history", min(oldest, time.time() - _HISTORY_DAYS * 86400))
    kept |= waiting
    for name in usage.names(store.locks):
        of_key = "-" in name and name.endswith(".lock") and name.removesuffix(".lock") not in kept
        if of_key and _time(f"{store.locks}/{name}") < oldest:
            _remove_lock(store, store.locks / name)
    run_log.forget(store.root, keys.keys(), oldest)


def _sweep_unfinished(store: Store, oldest: float) -> None:
    """Remove results that were never finished, and checkpoints that are done with or old; not those in use."""
    for path in (store.root / "cache").glob("*/.new-*"):
        named = _NEW_FOLDER.fullmatch(path.name)
        with store.try_lock(path.parent.name, named[1]) if named else contextlib.nullcontext(True) as is_locked:
            if is_locked and (named or _time(path) < oldest):
                remove(path)
    for stage, key in list(_keys(store, "checkpoints")):
        path = store.root / "checkpoints" / stage / key
        with store.try_lock(stage, key) as is_locked:
            is_done = (store.records / record_name(stage, key)).exists()
            if is_locked and (is_done or _last_time(path) < oldest):
                remove(path)


def _unlink_old(folder: Path, oldest: float, kept: Collection[str] = ()) -> None:
    """Remove the files of a folder that are older than ``oldest``, but those named in ``kept``."""
    for name in usage.names(folder):
        if name not in kept and _time(f"{folder}/{name}") < oldest:
            (folder / name).unlink(missing_ok=True)


def _remove_lock(store: Store, path: Path) -> None:
    """Remove a lock's file unless it is held. A process that waits for it then sees that, and makes a new one."""
    import filelock

    with contextlib.suppress(filelock.Timeout, OSError), store.lock(path.stem, timeout=0):
        path.unlink()


def _time(path: str | Path) -> float:
    """When a file was written or touched, in seconds since 1970; 0 if it is not there."""
    try:
        return os.lstat(path).st_mtime
    except OSError:
        return 0.0


def _last_time(path: Path) -> float:
    """The latest time of a file, or of a folder and all that is in it."""
    return max((status.st_mtime for status in usage.statuses(path)), default=0.0)
