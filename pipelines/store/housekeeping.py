"""Looking after a store: listing, verifying, and removing what has not been used, within a limit of its size.

Nothing is removed while it is in use: a result is removed under the lock of its key, a temporary file or folder
only if no living process writes it, and whatever may be used by a run that is going on is kept, see
`texloom.pipelines.store.lease`.
"""

from __future__ import annotations

import contextlib
import hmac
import itertools
import json
import operator
import os
import re
import time
from collections import defaultdict
from collections.abc import Collection, Iterator
from pathlib import Path
from typing import NamedTuple

from texloom.pipelines.byte_size import format_byte_size
from texloom.pipelines.errors import refused
from texloom.pipelines.store import ownership, removal, result_sizes, run_log, usage, written
from texloom.pipelines.store.lease import protected_since
from texloom.pipelines.store.record import record_name
from texloom.pipelines.store.result_files import NOT_AS_EXPECTED, BrokenArtifactError
from texloom.pipelines.store.store import Store

_KEY = re.compile(r"[0-9a-f]{64}")
_NEW_FOLDER = re.compile(r"\.new-([0-9a-f]{64})-[0-9a-f]{8}")
_RECORD = re.compile(r"[\w-]+-[0-9a-f]{64}")
_RUN = re.compile(r".+-\d{8}-\d{6}(-\d+)?")
_ANY = re.compile(r"[^.].*")
_SETTINGS = "settings.json"
_MOST = 4096  # bytes of it
_HISTORY_DAYS = 30
_ROOM = 10  # part of the limit that is made free at once
_USED = operator.itemgetter(4)


class StoreEntry(NamedTuple):
    """A result, or something else that takes space in the store."""

    stage: str | None
    """None where it is not a result but exports of a run or arrays given by a program"""
    key: str | None
    place: str
    """where it is, as text, as there may be a million"""
    size: int
    """bytes, with its record and checkpoints"""
    used: float
    """seconds since 1970"""
    left_out: int = 0
    """bytes of its files that are not kept, as `verify` finds"""

    @property
    def folder(self) -> Path:
        """Where it is; a file, if it is an array."""
        return Path(self.place)


def entries(store: Store, measured: bool = False) -> list[StoreEntry]:
    """All results, by stage, the least recently used first; see `results` for ``measured``."""
    unfinished = set(_keys(store, "checkpoints"))
    used, root = usage.times(store.records), str(store.root)
    sizes: dict[str, dict[str, int]] = defaultdict(dict)
    for stage, key, size in results(store, measured):
        sizes[stage][key] = size
    for stage, key in unfinished:
        if key in sizes[stage]:
            sizes[stage][key] += usage.size_of(f"{root}/checkpoints/{stage}/{key}")
    found: list[StoreEntry] = []
    for stage, known in sorted(sizes.items()):
        place, record = f"{root}/cache/{stage}/", record_name(stage, "")
        times = [used.get(record + key) or store.used(store.location(stage, key)) for key in known]
        listed = map(StoreEntry, itertools.repeat(stage), known, map(place.__add__, known), known.values(), times)
        found += sorted(listed, key=_USED)
    return found


def results(store: Store, measured: bool = False) -> Iterator[tuple[str, str, int]]:
    """Stage, key, and bytes with the record of each result; ``measured``: without the index of sizes."""
    known = {} if measured else result_sizes.read(store)
    found: dict[int, int] = {}
    for stage in usage.names(store.root / "cache"):
        place, record = f"{store.root}/cache/{stage}", f"{store.records}/{record_name(stage, '')}"
        for key, inode in usage.inodes(place):
            if not _KEY.fullmatch(key):
                continue
            token = result_sizes.token(key, inode)
            size, is_settled = known.get(token), True
            if size is None:
                of_record = sum(status.st_size for status in usage.statuses(record + key))
                size = usage.size_of(f"{place}/{key}") + of_record
                is_settled = of_record > 0 and inode not in result_sizes.UNKNOWN  # else it is just being written
            if is_settled:
                found[token] = size
            yield stage, key, size
    if not measured:
        result_sizes.keep(store, known, found)


def total_size(store: Store, measured: bool = False) -> int:
    """Bytes of all files; unless ``measured`` by the index of sizes."""
    if measured:
        return usage.size_of(store.root)
    others = set(usage.names(store.root)) - {"cache", "records", "locks"}  # locks are empty
    return sum(usage.size_of(store.root / name) for name in others) + sum(size for *_, size in results(store))


def _keys(store: Store, kind: str) -> Iterator[tuple[str, str]]:
    """Stage and key of each folder in ``cache`` or ``checkpoints``, from the names alone."""
    for stage in usage.names(store.root / kind):
        for name in usage.names(store.root / kind / stage):
            if _KEY.fullmatch(name):
                yield stage, name


def other_entries(store: Store) -> list[StoreEntry]:
    """Exports of runs without ``--out``, and arrays given by programs, the least recently used first."""
    runs = [store.root / "runs" / name for name in written.runs(store.root)]
    arrays = filter(removal.SOURCE.fullmatch, usage.names(store.root / "sources"))
    paths = [*(path for path in runs if path.is_dir()), *(store.root / "sources" / name for name in arrays)]
    found = [StoreEntry(None, None, str(path), usage.size_of(path), _last_time(path)) for path in paths]
    return sorted(found, key=lambda entry: entry.used)


# -- verifying


def verify(store: Store) -> Iterator[tuple[StoreEntry, str | None]]:
    """Every result and its problem, if any; every byte is compared. What is being computed is passed over."""
    for entry in entries(store):
        problem, left_out = checked(store, entry)
        if problem is not None:
            with store.try_lock(str(entry.stage), str(entry.key)) as is_locked:
                if is_locked:
                    problem, left_out = checked(store, entry) if entry.folder.exists() else (None, 0)
                elif store.locks.is_dir() and os.access(store.locks, os.W_OK):
                    continue  # a run is writing it
        if problem is None or entry.folder.exists():
            yield entry._replace(left_out=left_out), problem


def checked(store: Store, entry: StoreEntry) -> tuple[str | None, int]:
    """What is wrong with a result, and bytes of its files that were left out; every byte is compared."""
    try:
        found = store.find(str(entry.stage), str(entry.key), thorough=True)
    except BrokenArtifactError as error:
        return str(error), 0
    return ("it has no record", 0) if found is None else (None, found.left_out)


# -- removing


def prune(store: Store, days: float, dry_run: bool = False) -> list[StoreEntry]:
    """Remove what no run has used for ``days`` days, and what nothing needs any more.

    What is at work is kept.
    """
    problem = removes_nothing(store)
    if problem is not None:
        raise refused(f"--store {store.root}: {problem}")
    oldest = min(time.time() - days * 86400, protected_since(store.root))
    old = [entry for entry in (*entries(store), *other_entries(store)) if entry.used < oldest]
    if dry_run:
        return old
    removed = [entry for entry in old if _remove(store, entry, oldest)]
    _sweep(store, oldest)
    usage.forget(store)
    return removed


def removes_nothing(store: Store) -> str | None:
    """Why nothing may be removed from a store, in a line."""
    if ownership.marked(store.root) is not None:
        return None
    return ownership.keeps_no_key() or "it is not a store that texloom made for this user, so nothing is removed"


def limit(store: Store) -> int | None:
    """The most bytes that the store is to hold after a run, if this user has set a limit."""
    size, mac = _settings(store)
    if size is None or (ours := ownership.signature(store.root, f"limit {size}")) is None:
        return None
    return size if hmac.compare_digest(ours, mac) else None


def foreign_limit(store: Store) -> str | None:
    """A line on a limit that does not apply, as another user or program wrote it."""
    size, _ = _settings(store)
    if size is None or limit(store) is not None:
        return None
    return (
        f"--store {store.root}: its limit of {format_byte_size(size)} was not set by this user and does not apply; "
        "`texloom store limit SIZE` sets one"
    )


def _settings(store: Store) -> tuple[int | None, str]:
    """The limit, whoever wrote it, and the HMAC that came with it."""
    try:
        with store.inside() as folder:
            document = json.loads(folder.read(_SETTINGS, _MOST))
        size, mac = document["limit"], document.get("hmac")
    except NOT_AS_EXPECTED:
        return None, ""
    is_limit = type(size) is int and size >= 0
    return size if is_limit else None, mac if isinstance(mac, str) and mac.isascii() else ""


def set_limit(store: Store, size: int | None) -> None:
    """Set the limit, in bytes, that later runs of this user obey at their end."""
    store.create()
    usage.forget(store)
    settings = {"limit": size, "hmac": ownership.signature(store.root, f"limit {size}")}
    with store.inside() as folder:
        folder.write(_SETTINGS, json.dumps(settings).encode(), durable=True)


def keep_limit(store: Store, measure: bool = True) -> list[StoreEntry]:
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
    size, removed = total_size(store), []
    if size > most:
        size = total_size(store, measured=True)
    if size > most:
        goal = most if measure else most - most // _ROOM
        protected = protected_since(store.root)
        for entry in _unprotected(store, protected):
            if size <= goal:
                break
            if _remove(store, entry, protected):
                removed.append(entry)
                size -= entry.size
        _sweep(store, min(protected, removed[-1].used if removed else 0.0))
    usage.measured(store, size)
    return removed


def over(store: Store, most: int | None) -> list[StoreEntry]:
    """What `keep_limit` would remove under a limit of so many bytes."""
    found: list[StoreEntry] = []
    if most is None or total_size(store) <= most:
        return found
    size = total_size(store, measured=True)
    for entry in _unprotected(store, protected_since(store.root)):
        if size <= most:
            break
        found.append(entry)
        size -= entry.size
    return found


def _unprotected(store: Store, protected: float) -> Iterator[StoreEntry]:
    """All that was last used before a time, what was least recently used first."""
    for entry in sorted((*entries(store, measured=True), *other_entries(store)), key=_USED):
        if entry.used >= protected:
            break
        yield entry


def tidy(store: Store) -> None:
    """Remove the temporary files of runs that were killed."""
    for names in ((), ("exports",), ("running",), ("history",), ("log",)):
        with contextlib.suppress(FileNotFoundError), store.inside(*names) as folder:
            folder.remove_abandoned()
    for run in written.runs(store.root):
        with contextlib.suppress(OSError), store.inside("runs", run) as folder:
            folder.remove_abandoned()


def _remove(store: Store, entry: StoreEntry, oldest: float) -> bool:
    """Remove an entry that was last used before ``oldest``; whether it is gone, so that nobody uses it."""
    if entry.stage is None or entry.key is None:
        if _last_time(entry.folder) >= oldest:
            return False
        name = entry.folder.name
        is_run = entry.folder.parent.name == "runs"
        return removal.remove_run(store.root, name) if is_run else removal.remove_source(store.root, name)
    with store.try_lock(entry.stage, entry.key) as is_locked:
        if not is_locked or store.used(store.location(entry.stage, entry.key)) >= oldest:  # it was used meanwhile
            return False
        with contextlib.suppress(OSError):
            is_gone = store.remove(entry.stage, entry.key)
            if is_gone:
                _unlink_lock(store, f"{record_name(entry.stage, entry.key)}.lock")
            return is_gone
    return False


def _sweep(store: Store, oldest: float) -> None:
    """Remove what nothing needs any more: what killed runs left, and the rest if it is older than ``oldest``."""
    tidy(store)
    for run in written.runs(store.root):
        removal.sweep_run(store.root, run)
    with contextlib.suppress(OSError), store.inside("runs") as folder:
        for name in folder.names():
            if _RUN.fullmatch(name) and folder.time(name) < oldest:
                folder.rmdir(name)  # of a run that wrote nothing
    _sweep_unfinished(store, oldest)
    keys = {key: record_name(stage, key) for stage, key in _keys(store, "cache")}
    kept = set(keys.values())
    waiting = {record_name(stage, key) for stage, key in _keys(store, "checkpoints")}
    _unlink_old(store, "records", oldest, _RECORD, kept)
    _unlink_old(store, "exports", oldest, _KEY)
    # explains for a while why results are computed again
    _unlink_old(store, "history", min(oldest, time.time() - _HISTORY_DAYS * 86400), _ANY)
    kept |= waiting
    for name in usage.names(store.locks):
        of_key = name.endswith(".lock") and _RECORD.fullmatch(name.removesuffix(".lock"))
        if of_key and name.removesuffix(".lock") not in kept and _time(f"{store.locks}/{name}") < oldest:
            _remove_lock(store, name)
    run_log.forget(store.root, keys.keys(), oldest)


def _sweep_unfinished(store: Store, oldest: float) -> None:
    """Remove results that were never finished, and checkpoints that are done with or old; not those in use."""
    for stage in usage.names(store.root / "cache"):
        with contextlib.suppress(OSError), store.inside("cache", stage) as folder:
            for name in folder.names():
                found = _NEW_FOLDER.fullmatch(name)
                if found:
                    with store.try_lock(stage, found[1]) as is_locked:
                        if is_locked:
                            removal.remove_temporary(folder, name)
    for stage, key in list(_keys(store, "checkpoints")):
        path = store.root / "checkpoints" / stage / key
        with store.try_lock(stage, key) as is_locked:
            is_done = (store.records / record_name(stage, key)).exists()
            if is_locked and (is_done or _last_time(path) < oldest):
                removal.remove_checkpoints(store.root, stage, key)


def _unlink_old(
    store: Store, kind: str, oldest: float, pattern: re.Pattern[str], kept: Collection[str] = ()
) -> None:
    """Remove the files of a folder that are named as texloom does and older than ``oldest``, but not ``kept``."""
    with contextlib.suppress(FileNotFoundError), store.inside(kind) as folder:
        for name in folder.names():
            if name not in kept and pattern.fullmatch(name) and folder.time(name) < oldest:
                folder.unlink_file(name)


def _remove_lock(store: Store, name: str) -> None:
    """Remove a lock's file unless it is held."""
    import filelock

    held = store.lock(name.removesuffix(".lock"), timeout=0)
    with contextlib.suppress(filelock.Timeout, OSError), held:
        _unlink_lock(store, name)


def _unlink_lock(store: Store, name: str) -> None:
    """Remove the file of a lock that is held here. A process that waits for it sees that, and makes a new one."""
    with contextlib.suppress(OSError), store.inside("locks") as folder:
        folder.unlink_file(name)


def _time(path: str | Path) -> float:
    """When a file was written or touched, in seconds since 1970; 0 if it is not there."""
    try:
        return os.lstat(path).st_mtime
    except OSError:
        return 0.0


def _last_time(path: Path) -> float:
    """The latest time of a file, or of a folder and all that is in it."""
    return max((status.st_mtime for status in usage.statuses(path)), default=0.0)
