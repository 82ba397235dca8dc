"""The artifact store: results on disk, complete or absent.

::

    artifacts/
      cache/<stage>/<key>/             one result: result.exr, tables.json, previews, manifest.json
      checkpoints/<stage>/<key>/<level>/   the same for the scales of a long step, without previews
      records/<stage>-<key>            the record of a finished step; a result without one is ignored
      locks/                           one file a key; its lock is released when the holding process ends
      history/<flow>                   what a flow's last runs used, see `texloom.pipelines.store.history`
      log/<digest>.json                a run and the results that it used, see `texloom.pipelines.store.run_log`
      running/                         one file for each run that is going on, see `Store.used_by_run`
      markers/<key id>                 whose store it is, see `texloom.pipelines.store.ownership`
      settings.json                    the limit of the size, see `texloom.pipelines.store.housekeeping`
      size.json                        the running total, see `texloom.pipelines.store.usage`
      result_sizes                     the size of each result, see `texloom.pipelines.store.result_sizes`
      sources/                         arrays given by a Python program, see `texloom.pipelines.media.array_sources`
      exports/<key>                    digests of exported files, see `texloom.pipelines.engine.exports`
      runs/<flow>-<time>/              exports
      written/<flow>-<time>            digests of these, see `texloom.pipelines.store.written`
      identity                         distinguishes this folder from others of the same path on other machines

A result is written under a temporary name, flushed and renamed; its manifest, which lists the files with their
digests, is written last. Files are compared with the digests when they are read.
"""

from __future__ import annotations

import contextlib
import dataclasses
import hashlib
import json
import os
import re
from collections.abc import Collection, Iterator, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

from texloom.pipelines.errors import UnreachableError, is_unreachable, refused
from texloom.pipelines.memory import memory_limit
from texloom.pipelines.store import ownership, removal, usage
from texloom.pipelines.store.atomic import check_folder, free_space, probe_folder
from texloom.pipelines.store.folders import CAN_LOCK, Folder, LinkError
from texloom.pipelines.store.lease import Lease
from texloom.pipelines.store.record import (
    ForeignRecordError,
    decode_record,
    encode_record,
    left_out_of,
    record_name,
)
from texloom.pipelines.store.result_files import (
    MANIFEST,
    NOT_AS_EXPECTED,
    BrokenArtifactError,
    Download,
    check_files,
    checked_entries,
    keep_manifest,
    read_manifest,
    read_result,
    receive_result,
    small_file,
    write_result,
)
from texloom.pipelines.store.stored_checkpoints import StoredCheckpoints
from texloom.stages.vocabulary.declare import InputError, Stage
from texloom.stages.vocabulary.scratch import Scratch, using

if TYPE_CHECKING:
    import filelock

T = TypeVar("T")

_LOCK = re.compile(r"[\w-]+-[0-9a-f]{64}\.lock|size\.lock")
_SCRATCH_SHARE = 1 / 32  # of the memory limit; larger arrays are in files
_CAN_TOUCH_LINKS = os.utime in os.supports_follow_symlinks


class BrokenStoreError(OSError):
    """A result is broken again each time after it was recomputed."""


@dataclasses.dataclass(frozen=True)
class Artifact:
    """A complete result in the store."""

    stage: str
    key: str
    place: str
    """of its folder"""
    outputs: Mapping[str, str]
    """output name to content digest"""
    manifest: str = ""
    """SHA-256 of its manifest, 64 hexadecimal digits; empty where only its location is used"""
    warnings: tuple[str, ...] = ()
    """what its stage warned of when it was computed"""
    tables: Mapping[str, Any] | None = None
    """its tables, where it is not in this store but in a shared one"""
    left_out: int = 0
    """bytes of its files, where only the manifest is kept of them, see `Store.leave_out`"""

    @property
    def folder(self) -> Path:
        """Where its files are."""
        return Path(self.place)

    @property
    def record(self) -> dict[str, Any]:
        """Its record."""
        record = {"stage": self.stage, "key": self.key, "outputs": dict(self.outputs), "manifest": self.manifest}
        return record | ({"left_out": self.left_out} if self.left_out else {})


class Store:
    """A folder of artifacts. Nothing is created before something is written."""

    def __init__(self, root: Path, remote: str = ""):
        """``remote``: address of a shared store, see `texloom.pipelines.store.exchange`; none if empty."""
        try:
            self.root = root.expanduser().resolve()
        except RuntimeError as error:
            raise InputError(f"--store {root}: {error}") from None
        except OSError as error:
            raise refused(f"--store {root}: {str(error.strerror).lower()}") from None
        self.remote = remote
        self.distrusted: set[str] = set()
        """keys whose results turned out to be broken, which are not taken from the shared store again"""
        self.records = self.root / "records"
        self.locks = self.root / "locks"
        self.exports = self.root / "exports"
        self.running = self.root / "running"
        self._cache = f"{self.root}/cache"
        self._records = f"{self.root}/records"
        self._lease: Lease | None = None
        self._is_claimed = False
        self._was_there = False

    def __reduce__(self) -> Any:
        return Store, (self.root, self.remote)

    def folder(self, stage: str, key: str) -> Path:
        """Folder of the result of ``key``, if there is one."""
        return Path(self._place(stage, key))

    def _place(self, stage: str, key: str) -> str:
        """The same as text: of a cached result no `Path` is made, as there are thousands."""
        return f"{self._cache}/{stage}/{key}"

    def location(self, stage: str, key: str) -> Artifact:
        """The result of ``key``, which must be there, by its location alone."""
        return Artifact(stage, key, self._place(stage, key), {})

    def record(self, artifact: Artifact) -> str:
        """The file of its record."""
        return f"{self._records}/{record_name(artifact.stage, artifact.key)}"

    def inside(self, *names: str, create: bool = False) -> Folder:
        """A folder of the store, reached without following a link; errors as of `Folder.at` and `check_there`."""
        if create:
            self.check_there()
        return Folder.at(self.root, *names, create=create)

    def check_owned(self) -> None:
        """`InputError` where this user may not use the folder, see `texloom.pipelines.store.ownership`."""
        ownership.check(self.root)
        self._was_there = self._identity.exists()

    @property
    def _identity(self) -> Path:
        return self.root / "identity"

    def check_there(self) -> None:
        """`UnreachableError` where the store was there once, and does not answer or is not there any more.

        Otherwise what a run makes would be written to the folder on which a disk was mounted, or where the store
        was before it was moved.
        """
        if not self._was_there:
            return
        try:
            self._identity.stat()
        except (FileNotFoundError, NotADirectoryError):
            self._remove_left_locks()
            problem = "is not there any more; was it moved, or its disk unmounted?"
        except OSError as error:
            problem = f"does not answer: {str(error.strerror).lower()}"
        else:
            return
        raise UnreachableError(f"--store {self.root}: {problem}")

    def _remove_left_locks(self) -> None:
        """Remove the folder that `filelock` made where the store was, if it was moved just before."""
        with contextlib.suppress(OSError), Folder.at(self.root) as folder:
            if folder.names() == ["locks"]:
                folder.remove_flat("locks", _LOCK.fullmatch)

    def is_there(self) -> bool:
        """Whether `check_there` finds nothing."""
        try:
            self.check_there()
        except UnreachableError:
            return False
        return True

    def _claim(self) -> None:
        """Make an empty or new folder a store of this user; `InputError` where it is neither that nor one already.

        Workers do not call it: the run that they work for has done so, and `check_identity` compares.
        """
        self.check_there()
        if not self._is_claimed and ownership.marked(self.root) is None:
            self.root.mkdir(parents=True, exist_ok=True)
            self.check_owned()
            ownership.mark(self.root)
        self._is_claimed = True
        self._was_there = self._was_there or self._identity.exists()

    def adopt(self) -> None:
        """Make a store that another user or machine made one of this user too; `InputError` if that fails."""
        try:
            ownership.refuse_links(self.root)
            ownership.mark(self.root)
        except OSError as error:
            raise refused(f"--store {self.root}: cannot be written: {error.strerror}") from None

    def ready(self, name: str) -> Path:
        """A folder of the store to write to, which is made if need be."""
        self._claim()
        with self.inside(name, create=True):
            return self.root / name

    def create(self) -> None:
        """Create the folders; `InputError` where that is not permitted."""
        try:
            self._claim()
            with self.inside() as folder:
                for name in ("cache", "checkpoints", "records", "locks", "history", "exports"):
                    with folder.child(name, create=True):
                        pass
            probe_folder(self.root)
        except LinkError as error:
            raise refused(f"--store {self.root}: {error.filename} {error.strerror}") from None
        except OSError as error:
            self.check_there()
            if self._was_there and is_unreachable(error):
                raise
            raise InputError(f"--store {self.root}: cannot be written: {error.strerror}") from None
        self.hold()

    def identity(self) -> str:
        """A unique name of this folder, by which processes on other machines recognise it."""
        self.create()
        return self._identity.read_text()

    def check_identity(self, identity: str) -> None:
        """`InputError` unless this folder is the one that a run on another machine calls by the same path."""
        try:
            problem = "" if self._identity.read_text() == identity else "is another folder there"
        except OSError as error:
            if is_unreachable(error):
                raise
            problem = "is not there"
        if problem:
            raise InputError(f"the store {self.root} {problem}; all workers must see the same one")
        self._was_there = True

    def lock(self, name: str, timeout: float = -1) -> filelock.BaseFileLock:
        """A lock shared by all processes that see the folder; the kernel releases it when its process ends."""
        import filelock

        self.check_there()  # as `filelock` makes folders
        path = self.locks / f"{name}.lock"
        for one in (self.locks, path):  # `filelock` follows links, and empties the file
            if one.is_symlink():
                raise LinkError(str(one))
        return filelock.FileLock(path, timeout=timeout, thread_local=False, fallback_to_soft=False)

    @contextlib.contextmanager
    def used_by_run(self) -> Iterator[Lease]:
        """Keep what is used from now on from being removed by other processes, until the ``with`` block ends."""
        with Lease(self.root) as lease:
            self._lease = lease
            try:
                yield lease
            finally:
                self._lease = None

    def hold(self) -> None:
        """Take the lease of `used_by_run`, if there is one; called before a run writes anything."""
        if self._lease is not None:
            with contextlib.suppress(OSError):  # then nothing can be written
                self._claim()
                self._lease.take()

    def check_writable(self) -> None:
        """`InputError` where `create` would fail; creates nothing."""
        check_folder("--store", self.root)

    def scratch(self) -> contextlib.AbstractContextManager[None]:
        """Let arrays that are large for the memory limit be in files of this folder inside the ``with`` block."""
        return using(Scratch(self.root, int(_SCRATCH_SHARE * memory_limit())))

    # -- results

    def find(self, stage: str, key: str, thorough: bool = False) -> Artifact | None:
        """The result of ``key``, see `check_record`; `BrokenArtifactError` if it has a record and is not whole."""
        record = self.read_record(record_name(stage, key))
        return None if record is None else self.check_record(record, stage, key, thorough)

    def read_record(self, name: str) -> dict[str, Any] | None:
        """The record called ``name``, if there is one; `BrokenArtifactError` if it cannot be read."""
        try:
            return decode_record(small_file(f"{self._records}/{name}"))
        except (FileNotFoundError, NotADirectoryError):
            return None
        except ForeignRecordError as error:
            raise BrokenArtifactError(str(error)) from None
        except NOT_AS_EXPECTED as error:
            if is_unreachable(error):
                self.check_there()  # else it is this file alone that the disk cannot read
            raise BrokenArtifactError("its record cannot be read") from None

    def write_record(self, name: str, content: bytes) -> None:
        """Write the record called ``name``, complete or not at all; its caller holds the lock of that name."""
        with self.inside() as root, root.child("records") as folder:
            folder.write(name, content, beside=root)  # a small folder, which the end of each run looks through

    def check_record(self, record: Mapping[str, Any], stage: str, key: str, thorough: bool = False) -> Artifact:
        """The artifact of ``key`` by its record; `BrokenArtifactError` if it is another's or not complete.

        Files are compared by digest, those whose size and time match the manifest only if ``thorough``. What was
        left out is whole by its manifest.
        """
        try:
            if (record["stage"], record["key"]) != (stage, key):
                raise BrokenArtifactError("its record is that of another result")
            outputs = dict(record["outputs"])
            place = self._place(stage, key)
            manifest, digest = read_manifest(place)
            if digest != record["manifest"]:
                raise BrokenArtifactError(f"{MANIFEST} has been altered")
            if outputs != manifest["outputs"] or not all(isinstance(value, str) for value in outputs.values()):
                raise BrokenArtifactError("its record has been altered")
        except NOT_AS_EXPECTED:
            raise BrokenArtifactError("its record cannot be read") from None
        left_out = left_out_of(record)
        if not left_out:
            check_files(place, manifest["files"], thorough)
        warnings = tuple(map(str, manifest.get("warnings", ())))
        return Artifact(stage, key, place, outputs, digest, warnings, left_out=left_out)

    def save(
        self, stage: Stage, key: str, result: Any, provenance: Mapping[str, Any], seconds: float = 0.0
    ) -> Artifact:
        """Write a result that took ``seconds`` to compute. The caller holds the lock of ``key``.

        An existing record belongs to another result and is removed. `UnreachableError` where the store has gone.
        """
        self.forget(stage.name, key)
        folder = self.folder(stage.name, key)
        with self.inside("cache", stage.name, create=True) as parent:
            outputs, digest = write_result(
                parent, key, result, {**provenance, "stage": stage.name, "key": key}, seconds
            )
        usage.add(self, folder)
        return Artifact(stage.name, key, str(folder), outputs, digest)

    def receive(
        self, stage: str, key: str, manifest: bytes, names: Collection[str], download: Download
    ) -> Artifact:
        """File a result of a shared store by its manifest, as `save`. The caller holds the lock of ``key``.

        Parameters
        ----------
        names : of the outputs of the stage.
        download : writes a file of the result.

        Raises
        ------
        BrokenArtifactError : manifest or files are not as they should be; nothing is left of them.
        """
        outputs, entries = checked_entries(manifest, stage, key, names)
        size, free = sum(entry["bytes"] for entry in entries.values()), free_space(self.root)
        if size > free:
            raise BrokenArtifactError(f"its files have {size} bytes, and {free} are free here")
        self.forget(stage, key)
        with self.inside("cache", stage, create=True) as parent:
            receive_result(parent, key, manifest, entries, outputs, download)
        usage.add(self, self.folder(stage, key))
        return Artifact(stage, key, self._place(stage, key), outputs, hashlib.sha256(manifest).hexdigest())

    def load(self, artifact: Artifact, kind: type[Any], names: Collection[str] | None = None) -> dict[str, Any]:
        """The outputs called ``names``, or all; `BrokenArtifactError` if a file was altered."""
        return read_result(artifact.folder, kind, names)

    def table(self, artifact: Artifact, output: str) -> Any:
        """A table for people to look at, not compared with its digest; none where it cannot be read."""
        try:
            return dict(artifact.tables or json.loads(small_file(artifact.folder / "tables.json")))[output]
        except NOT_AS_EXPECTED:
            return None

    def provenance(self, artifact: Artifact) -> dict[str, Any]:
        """Provenance of the result: program, stage, version, params, seed, digests of the inputs, times."""
        try:
            manifest, _ = read_manifest(artifact.folder)
        except BrokenArtifactError as error:
            problem = f"{artifact.stage}: the stored result is broken ({error})"
            raise BrokenArtifactError(problem, artifact.key) from None
        return {name: value for name, value in manifest.items() if name not in ("files", "outputs")}

    def forget(self, stage: str, key: str) -> None:
        """Remove the record, so that the result is computed again."""
        with contextlib.suppress(FileNotFoundError), self.inside("records") as folder:
            folder.remove(record_name(stage, key))

    def drop_checkpoints(self, stage: str, key: str) -> None:
        """Remove the checkpoints of a step, whose result is complete."""
        removal.remove_checkpoints(self.root, stage, key)

    def remove(self, stage: str, key: str) -> bool:
        """Remove a result, whose key the caller has locked; whether its folder is gone."""
        outputs: Collection[str] = ()
        with contextlib.suppress(BrokenArtifactError, *NOT_AS_EXPECTED):
            outputs = dict((self.read_record(record_name(stage, key)) or {})["outputs"])
        self.forget(stage, key)
        with self.inside("cache", stage) as folder:
            is_gone = removal.remove_result(folder, key, outputs)
        self.drop_checkpoints(stage, key)
        return is_gone

    def leave_out(self, artifact: Artifact, now: int) -> Artifact | None:
        """Remove the files of a result but its manifest, so that those made of it are still found by their keys.

        Parameters
        ----------
        now : when the run began that used it, in ns since 1970.

        Returns
        -------
        what is left of it; None where all stays, as a later run uses it, or files are there that nobody knows.
        """
        with self.try_lock(artifact.stage, artifact.key) as is_locked:
            if not is_locked or self.used(artifact) * 1e9 > now + 1000:  # a float has steps of 240 ns
                return None
            with (
                contextlib.suppress(BrokenArtifactError, *NOT_AS_EXPECTED),
                self.inside("cache", artifact.stage) as parent,
            ):
                files = read_manifest(artifact.place)[0]["files"]
                with parent.child(artifact.key) as folder:
                    if not set(folder.names()) <= {*files, MANIFEST}:
                        return None
                size = sum(int(entry["bytes"]) for entry in files.values())
                left = dataclasses.replace(artifact, left_out=max(size, 1))
                name = record_name(artifact.stage, artifact.key)
                self.write_record(name, encode_record(left.record, name))  # first: what is there still is no harm
                keep_manifest(parent, artifact.key, artifact.outputs)
                self.touch(left, now)
                usage.change(self, -size)
                return left
        return None

    def touch(self, artifact: Artifact, now: int) -> None:
        """Mark the artifact as used now, in ns since 1970, by the time of its record."""
        with contextlib.suppress(OSError):
            os.utime(self.record(artifact), ns=(now, now), follow_symlinks=not _CAN_TOUCH_LINKS)

    def used(self, artifact: Artifact) -> float:
        """When it was used last, in seconds since 1970; if it has no record, when it was written; else 0."""
        for path in (self.record(artifact), f"{artifact.place}/{MANIFEST}"):
            with contextlib.suppress(OSError):
                return os.stat(path).st_mtime  # noqa: PTH116 (as text, as there are thousands)
        return 0.0

    def checkpoints(self, stage: str, key: str) -> StoredCheckpoints:
        """The checkpoints of the step of ``key``."""
        return StoredCheckpoints(self.root, stage, key)

    @contextlib.contextmanager
    def try_lock(self, stage: str, key: str) -> Iterator[bool]:
        """Lock ``key`` for the ``with`` block unless another process holds it; whether it is locked now."""
        name, is_locked = record_name(stage, key), True
        with contextlib.ExitStack() as stack:
            try:
                if CAN_LOCK:
                    folder = stack.enter_context(self.inside("locks", create=True))
                    is_locked = stack.enter_context(folder.locked(f"{name}.lock"))
                else:
                    stack.enter_context(self.lock(name, timeout=0))
            except OSError:  # also `filelock.Timeout`
                is_locked = False
            yield is_locked
