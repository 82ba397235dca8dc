"""Results shared through object storage: looked up there before they are computed, and uploaded after.

::

    <url>/files/<sha256>               a file of a result, named by what it holds
    <url>/records/<stage>/<key>.json   the manifest of a result, which is written last, and unless there is one

Of two machines that compute a key at the same time the first to write the record wins; the files of the other one
have names of their own, so that no result is torn. What comes from there is data: files with names that texloom
gives, of the size and digest that the record says; nothing of it is unpickled or called.
"""

from __future__ import annotations

import contextlib
import dataclasses
import io
import json
from collections.abc import Collection, Iterator, Mapping
from typing import Any, BinaryIO

from texloom.pipelines.store import housekeeping
from texloom.pipelines.store.codec import TABLES
from texloom.pipelines.store.remote import RemoteError, RestingError, remote_at
from texloom.pipelines.store.result_files import (
    MANIFEST,
    MAX_JSON_SIZE,
    NOT_AS_EXPECTED,
    BrokenArtifactError,
    checked_entries,
    read_manifest,
    small_file,
)
from texloom.pipelines.store.store import Artifact, Store
from texloom.stages.lookup.registry import find_stage


class Exchange:
    """What passes between a store and a shared one for one result. Nothing of it makes a run fail."""

    def __init__(self, url: str, stage: str, key: str, is_distrusted: bool = False):
        """``is_distrusted``: the shared store's result has turned out to be broken, and is to be replaced."""
        self._remote = remote_at(url)
        self._stage, self._key = stage, key
        self._record = f"records/{stage}/{key}.json"
        self._replaces = is_distrusted
        self.fetched = self.uploaded = False
        self.outage = ""
        """why the storage could not be used"""
        self.is_known = False
        """whether that says nothing new of the storage, which was not asked, or is not at fault"""
        self.refusal = ""
        """why what it has is not used"""

    def fetch(self, store: Store) -> Artifact | None:
        """The result, if the shared store has it, put in place here; the caller holds the lock of its key."""
        with self._keeping_problems():
            there = self._found()
            if there is not None:
                artifact = store.receive(self._stage, self._key, *there, self._download)
                self.fetched = True
                return artifact
        return None

    def look(self, store: Store, with_tables: bool = False) -> tuple[Artifact, int] | None:
        """What `fetch` would return, by its record alone, and the bytes of its files; nothing is written.

        ``with_tables``: its tables are read too, as what runs depends on them.
        """
        with self._keeping_problems():
            there = self._found()
            if there is not None:
                outputs, entries = checked_entries(there[0], self._stage, self._key, there[1])
                tables = self._tables(entries[TABLES]) if with_tables and TABLES in entries else None
                artifact = store.location(self._stage, self._key)
                size = sum(entry["bytes"] for entry in entries.values())
                return dataclasses.replace(artifact, outputs=outputs, tables=tables), size
        return None

    def _found(self) -> tuple[bytes, Collection[str]] | None:
        """The record in the shared store, if it is to be asked and has one, and the names of the outputs."""
        if self._replaces or self.outage:
            return None
        try:
            outputs = find_stage(self._stage).outputs
        except KeyError:  # of a plug-in that this machine lacks, which its caller says
            return None
        record = self._remote.read(self._record, 0, MAX_JSON_SIZE + 1)
        return None if record is None else (record, outputs)

    def _download(self, entry: Mapping[str, Any], file: BinaryIO) -> str | None:
        return self._remote.download(f"files/{entry['sha256']}", entry["bytes"], file)

    def _tables(self, entry: Mapping[str, Any]) -> dict[str, Any]:
        if entry["bytes"] > MAX_JSON_SIZE:
            raise BrokenArtifactError(f"{TABLES} is too large")
        content = io.BytesIO()
        if self._download(entry, content) != entry["sha256"]:
            raise BrokenArtifactError(f"{TABLES} is missing, or not what its record says")
        try:
            return dict(json.loads(content.getvalue()))
        except NOT_AS_EXPECTED:
            raise BrokenArtifactError(f"{TABLES} cannot be read") from None

    @contextlib.contextmanager
    def _keeping_problems(self) -> Iterator[None]:
        """End the ``with`` block where the storage does not answer, or has what is not as it should be."""
        try:
            yield
        except RemoteError as error:
            self.outage, self.is_known = str(error), isinstance(error, RestingError)
        except BrokenArtifactError as error:
            self._replaces = True
            self.refusal = f"{self._remote.url}: {self._record} is refused: {error}"

    @property
    def told(self) -> dict[str, Any]:
        """What has passed, as plain data."""
        return {
            "fetched": self.fetched, "uploaded": self.uploaded, "outage": self.outage, "is_known": self.is_known,
            "refusal": self.refusal,
        }  # fmt: skip

    def is_there(self) -> bool:
        """Whether the shared store has a record of the result."""
        return self._remote.read(self._record, 0, 1) is not None

    def upload(self, store: Store) -> None:
        """Upload the result, which this store has, unless the shared one has it by now."""
        if self.outage:
            return
        folder = store.folder(self._stage, self._key)
        try:
            files = read_manifest(folder)[0]["files"]
            record = small_file(folder / MANIFEST)
            for name, entry in files.items():
                if entry["bytes"]:
                    object_name = f"files/{entry['sha256']}"
                    self._remote.upload(object_name, folder / name, entry["bytes"], self._replaces)
            self.uploaded = self._remote.write(self._record, record, self._replaces)
        except (RemoteError, BrokenArtifactError, OSError) as error:  # it may have been removed meanwhile
            self.outage = str(error)
            self.is_known = isinstance(error, RestingError) or not isinstance(error, RemoteError)


def exchange_of(store: Store, stage: str, key: str, outage: str = "") -> Exchange | None:
    """The exchange of a result with the shared store, if the run has one; ``outage``: why it is not to be asked."""
    if not store.remote:
        return None
    exchange = Exchange(store.remote, stage, key, key in store.distrusted)
    exchange.outage, exchange.is_known = outage, bool(outage)
    return exchange


@dataclasses.dataclass
class Pushed:
    """How many results of a store were uploaded, were in the shared one, or are broken and were left out."""

    uploaded: int = 0
    present: int = 0
    broken: int = 0
    left_out: int = 0
    """of which the store has only the manifests"""
    outage: str = ""
    """why it ended before the last one"""


def push(store: Store) -> Pushed:
    """Upload the results that the shared store lacks, after comparing them with their digests."""
    pushed = Pushed()
    for entry in housekeeping.entries(store):
        exchange = Exchange(store.remote, str(entry.stage), str(entry.key))
        try:
            if exchange.is_there():
                pushed.present += 1
                continue
        except RemoteError as error:
            pushed.outage = str(error)
            break
        problem, left_out = housekeeping.checked(store, entry)
        if problem is not None or left_out:
            pushed.broken += problem is not None
            pushed.left_out += left_out > 0
            continue
        exchange.upload(store)
        pushed.uploaded += exchange.uploaded
        pushed.outage = exchange.outage
        if pushed.outage:
            break
    return pushed
