"""Prefect's records of finished steps, as texloom keeps them: keys, content, locks.

A record holds no result; it says which artifact of the store the result is, and reading it checks that artifact. So
a broken artifact is a missing record to Prefect, and the step runs again.

A record also says how its result is to be read, and Prefect would obey: it can be told to unpickle, or to import
and call what the record names. So Prefect never sees the file: `RecordFolder` reads it as plain JSON, refuses what
is not in texloom's form, and hands on a record that it makes itself from what has been checked.
"""

from __future__ import annotations

import json
import os
import threading
from pathlib import Path
from typing import Any

os.environ.setdefault("DO_NOT_TRACK", "1")
os.environ.setdefault("PREFECT_SERVER_ANALYTICS_ENABLED", "false")

import filelock
from prefect.cache_policies import CachePolicy
from prefect.context import TaskRunContext
from prefect.filesystems import LocalFileSystem
from prefect.locking.protocol import LockManager
from prefect.serializers import Serializer
from pydantic import Field

from texloom.pipelines.store.record import SERIALIZER, encode_record, record_name
from texloom.pipelines.store.store import BrokenArtifactError, Store


class ArtifactSerializer(Serializer):
    """Keeps of what a task returns the ``record``, as JSON; nothing of an exception."""

    type: str = Field(default=SERIALIZER, frozen=True)

    def dumps(self, obj: Any) -> bytes:
        """The record of an artifact as JSON."""
        return json.dumps(None if isinstance(obj, BaseException) else obj["record"]).encode()

    def loads(self, blob: bytes) -> Any:
        """What a task would return."""
        return {"record": json.loads(blob)}


class RecordFolder(LocalFileSystem):
    """A store's folder of records. Reading one raises `BrokenArtifactError` unless its artifact is whole."""

    _block_type_name = "texloom records"

    def _resolve_path(self, path: str) -> None:  # type: ignore[override]
        """None: states then hold a record's name, not the path of a file, which Prefect would read by itself."""

    def _store(self) -> Store:
        return Store(Path(str(self.basepath)).parent)

    def read_path(self, path: str, _sync: bool = True) -> bytes:  # type: ignore[override]
        """A record like the one in the file, which says nothing but which artifact it is."""
        name = Path(path).name
        store = self._store()
        record = store.read_record(name)
        if record is None:
            raise BrokenArtifactError("it has no record", name)
        stage, key = str(record.get("stage")), str(record.get("key"))
        if record_name(stage, key) != name:
            raise BrokenArtifactError("its record is that of another result", name)
        store.check_record(record, stage, key)
        return encode_record(record, name)

    async def aread_path(self, path: str) -> bytes:
        """As `read_path`."""
        return self.read_path(path)

    def write_path(self, path: str, content: bytes, _sync: bool = True) -> str:  # type: ignore[override]
        """Write a record, complete or not at all; those of exceptions, which nobody reads, are omitted."""
        name = Path(path).name
        if "-" not in name:  # exceptions have a random key of hexadecimal digits
            return ""
        self._store().write_record(name, content)
        return name

    async def awrite_path(self, path: str, content: bytes) -> str:
        """As `write_path`."""
        return self.write_path(path, content)


def folder(store: Store) -> RecordFolder:
    """The records of ``store``."""
    return RecordFolder(basepath=str(store.records))


class StepKey(CachePolicy):
    """The key is computed by `texloom.pipelines.engine.keys` before the task is called, and handed to it."""

    def compute_key(
        self,
        task_ctx: TaskRunContext,  # noqa: ARG002
        inputs: dict[str, Any],
        flow_parameters: dict[str, Any],  # noqa: ARG002
        **kwargs: Any,  # noqa: ARG002
    ) -> str:
        """The task's argument ``key``."""
        return str(inputs["key"])


class FileLocks(LockManager):
    """Locks on files, which the kernel releases when a process dies; the files stay."""

    def __init__(self, store: Store, identity: str | None = None):
        """``identity``: of the store, checked before a lock is taken where its path may mean another folder."""
        self._store = store
        self._identity = identity
        self._held: dict[str, tuple[str, filelock.BaseFileLock]] = {}
        self._guard = threading.Lock()

    def __deepcopy__(self, memo: Any) -> FileLocks:
        return self  # policies are copied with what they hold

    def __reduce__(self) -> Any:
        return FileLocks, (self._store, self._identity)

    def acquire_lock(
        self,
        key: str,
        holder: str,
        acquire_timeout: float | None = None,
        hold_timeout: float | None = None,  # noqa: ARG002
    ) -> bool:
        """Wait for the lock, for ever if there is no time-out; whether it is ours now."""
        if self.is_lock_holder(key, holder):
            return True
        if self._identity is not None:
            self._store.check_identity(self._identity)
        lock = self._store.lock(key)
        try:
            lock.acquire(timeout=-1 if acquire_timeout is None else acquire_timeout)
        except filelock.Timeout:
            return False
        with self._guard:
            self._held[key] = (holder, lock)
        return True

    async def aacquire_lock(
        self, key: str, holder: str, acquire_timeout: float | None = None, hold_timeout: float | None = None
    ) -> bool:
        """As `acquire_lock`."""
        return self.acquire_lock(key, holder, acquire_timeout, hold_timeout)

    def release_lock(self, key: str, holder: str) -> None:
        """Give the lock back; `ValueError` if it is not the holder's."""
        with self._guard:
            if self._held.get(key, ("", None))[0] != holder:
                raise ValueError(f"the lock on {key} is not held by {holder}")
            _, lock = self._held.pop(key)
        lock.release()

    def discard(self, key: str) -> None:
        """Release the lock of a task that has failed: Prefect keeps it where a record cannot be read."""
        with self._guard:
            _, lock = self._held.pop(key, ("", None))
        if lock is not None:
            lock.release()

    def is_locked(self, key: str) -> bool:
        """Whether any process holds the lock."""
        return key in self._held or not self.wait_for_lock(key, 0)

    def is_lock_holder(self, key: str, holder: str) -> bool:
        """Whether ``holder`` in this process holds the lock."""
        return self._held.get(key, ("", None))[0] == holder

    def wait_for_lock(self, key: str, timeout: float | None = None) -> bool:
        """Wait until the lock is free; whether it was in time."""
        lock = self._store.lock(key)
        try:
            lock.acquire(timeout=-1 if timeout is None else timeout)
        except filelock.Timeout:
            return False
        lock.release()
        return True

    async def await_for_lock(self, key: str, timeout: float | None = None) -> bool:
        """As `wait_for_lock`."""
        return self.wait_for_lock(key, timeout)
