"""The artifact store: what has been computed, on disk, whole or not there.

::

    artifacts/
      cache/<stage>/<key>/             one result: result.exr, tables.json, previews, manifest.json
      checkpoints/<stage>/<key>/<level>/   the same for the scales of a long step
      records/<stage>-<key>            Prefect's record of a finished step; without it a result does not count
      locks/                           one file a key; the lock on it goes with the process that holds it
      history/<flow>.json              what the keys of a flow's last run were made of
      exports/<key>                    digests of exported files, see `texloom.pipelines.engine.exports`
      runs/<flow>-<time>/              exports
      identity                         tells this folder from others of the same path on other machines

A result is written under a temporary name, flushed and renamed; its manifest, which lists the files with their
digests, is written last. What is read is compared with the digests.
"""

from __future__ import annotations

import contextlib
import dataclasses
import datetime
import hashlib
import importlib.metadata
import json
import os
import re
import secrets
import shutil
import stat
import time
from collections.abc import Collection, Iterator, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

from texloom.pipelines.store.atomic import check_folder, file_digest, write_atomically
from texloom.stages.declare import InputError, Stage

if TYPE_CHECKING:
    import filelock

T = TypeVar("T")

SERIALIZER = "texloom-artifact"
"""what a record calls the form that its result is in.

No other is read, see `texloom.pipelines.engine.prefect.records`
"""

_MANIFEST = "manifest.json"
_KEY = re.compile(r"[0-9a-f]{64}")
_LARGEST_JSON = 1 << 24
_NOT_AS_EXPECTED = (OSError, ValueError, KeyError, TypeError, AttributeError, RecursionError)
"""what JSON raises that somebody else has written"""


class BrokenArtifactError(Exception):
    """A result that the records speak of is missing, cut or altered; ``key`` says which, where that is known."""

    def __init__(self, problem: str, key: str = ""):
        super().__init__(problem)
        self.key = key


class BrokenStoreError(OSError):
    """A result is broken each time that it has been computed again."""


@dataclasses.dataclass(frozen=True)
class Artifact:
    """A whole result in the store."""

    stage: str
    key: str
    folder: Path
    outputs: Mapping[str, str]
    """output name to content digest"""
    manifest: str = ""
    """SHA-256 of its manifest, 64 hexadecimal digits; empty where only its place counts"""

    @property
    def record(self) -> dict[str, Any]:
        """What the record says of it."""
        return {
            "stage": self.stage,
            "key": self.key,
            "outputs": dict(self.outputs),
            "manifest": self.manifest,
        }


@dataclasses.dataclass(frozen=True)
class Entry:
    """One line of the store's listing."""

    stage: str
    key: str
    folder: Path
    size: int
    """bytes, with its checkpoints"""
    used: float
    """seconds since 1970"""


class Store:
    """A folder of artifacts. Nothing is created before something is written."""

    def __init__(self, root: Path):
        try:
            self.root = root.expanduser().resolve()
        except RuntimeError as error:
            raise InputError(f"--store {root}: {error}") from None

    @property
    def records(self) -> Path:
        """Where Prefect keeps its records."""
        return self.root / "records"

    @property
    def locks(self) -> Path:
        """Where the lock files are."""
        return self.root / "locks"

    @property
    def exports(self) -> Path:
        """Where it is noted what exported files hold."""
        return self.root / "exports"

    def folder(self, stage: str, key: str) -> Path:
        """Where the result of ``key`` lies, if there is one."""
        return self.root / "cache" / stage / key

    def create(self) -> None:
        """Make the folders; `InputError` where that is not allowed."""
        try:
            for name in ("cache", "checkpoints", "records", "locks", "history", "exports"):
                (self.root / name).mkdir(parents=True, exist_ok=True)
            probe = self.root / f".probe-{secrets.token_hex(4)}"
            probe.touch()
            probe.unlink()
        except OSError as error:
            raise InputError(f"--store {self.root}: cannot be written: {error.strerror}") from None

    def identity(self) -> str:
        """A name of this very folder, by which a process on another machine can tell that it sees the same one."""
        path = self.root / "identity"
        if not path.exists():
            self.create()
            with self.lock("identity"):
                if not path.exists():
                    write_atomically(path, secrets.token_hex(16).encode())
        return path.read_text()

    def lock(self, name: str, timeout: float = -1) -> filelock.BaseFileLock:
        """A lock that all processes share which see the folder; the kernel releases it when its process dies."""
        import filelock

        path = self.locks / f"{name}.lock"
        return filelock.FileLock(path, timeout=timeout, thread_local=False, fallback_to_soft=False)

    def check_writable(self) -> None:
        """`InputError` where `create` would fail; creates nothing."""
        check_folder("--store", self.root)

    # -- results

    def find(self, stage: str, key: str) -> Artifact | None:
        """The result of ``key``; `BrokenArtifactError` if the records speak of one that is not whole."""
        record = self.read_record(record_name(stage, key))
        return None if record is None else self.check_record(record, stage, key)

    def read_record(self, name: str) -> dict[str, Any] | None:
        """What the record called ``name`` says, if there is one; `BrokenArtifactError` if it cannot be read.

        Only JSON is read: a record that names another form than `SERIALIZER` is refused.
        """
        try:
            content = _small_json(self.records / name)
            form = content["metadata"]["serializer"]
            if content.keys() != {"metadata", "result"} or form != {"type": SERIALIZER}:
                raise BrokenArtifactError("its record is not one that texloom wrote")
            return dict(json.loads(content["result"]))
        except (FileNotFoundError, NotADirectoryError):
            return None
        except _NOT_AS_EXPECTED:
            raise BrokenArtifactError("its record cannot be read") from None

    def check_record(self, record: Mapping[str, Any], stage: str, key: str) -> Artifact:
        """The artifact of ``key`` that a record speaks of; `BrokenArtifactError` if it is another's or not whole.

        Files whose size and time are those of the manifest are taken as they are, others are compared by digest.
        """
        try:
            if (record["stage"], record["key"]) != (stage, key):
                raise BrokenArtifactError("its record is that of another result")
            outputs = dict(record["outputs"])
            folder = self.folder(stage, key)
            if not (folder / _MANIFEST).is_file():
                raise BrokenArtifactError("its files are missing")
            manifest, digest = _read_manifest(folder)
            if digest != record["manifest"]:
                raise BrokenArtifactError(f"{_MANIFEST} has been altered")
            if outputs != manifest["outputs"] or not all(isinstance(value, str) for value in outputs.values()):
                raise BrokenArtifactError("its record has been altered")
        except _NOT_AS_EXPECTED:
            raise BrokenArtifactError("its record cannot be read") from None
        _check_files(folder, manifest["files"], thorough=False)
        return Artifact(stage, key, folder, outputs, digest)

    def save(
        self, stage: Stage, key: str, result: Any, provenance: Mapping[str, Any], seconds: float = 0.0
    ) -> Artifact:
        """File a result that took ``seconds`` to compute. Whoever calls holds the lock of ``key``.

        A record that is there by now is of another result; it goes.
        """
        self.forget(stage.name, key)
        folder = self.folder(stage.name, key)
        outputs, digest = _write(folder, result, {**provenance, "stage": stage.name, "key": key}, seconds)
        return Artifact(stage.name, key, folder, outputs, digest)

    def load(self, artifact: Artifact, kind: type[Any], names: Collection[str] | None = None) -> dict[str, Any]:
        """The outputs called ``names``, or all; `BrokenArtifactError` if a file is not what was written."""
        return _read(artifact.folder, kind, names)

    def provenance(self, artifact: Artifact) -> dict[str, Any]:
        """How the result came to be: program, stage, version, params, seed, digests of the inputs, times."""
        try:
            manifest, _ = _read_manifest(artifact.folder)
        except BrokenArtifactError as error:
            raise BrokenArtifactError(
                f"{artifact.stage}: the stored result is broken ({error})", artifact.key
            ) from None
        return {name: value for name, value in manifest.items() if name not in ("files", "outputs")}

    def forget(self, stage: str, key: str) -> None:
        """Remove the record, so that the result will be computed again."""
        (self.records / record_name(stage, key)).unlink(missing_ok=True)

    def touch(self, artifact: Artifact) -> None:
        """Remember that the artifact was of use today."""
        with contextlib.suppress(OSError):
            os.utime(artifact.folder / _MANIFEST)

    def checkpoints(self, stage: str, key: str) -> StoredCheckpoints:
        """Where the step of ``key`` keeps its scales."""
        return StoredCheckpoints(self.root / "checkpoints" / stage / key, {"stage": stage, "key": key})

    # -- the last run of a flow

    def last_run(self, flow: str) -> dict[str, Any]:
        """Step name to the parts of its key in the last run; without those that cannot be read."""
        try:
            found = dict(_small_json(self.root / "history" / f"{flow}.json"))
        except _NOT_AS_EXPECTED:
            return {}
        return {name: parts for name, parts in found.items() if _is_parts(parts)}

    def remember_run(self, flow: str, parts: Mapping[str, Any]) -> None:
        """Keep what the keys of this run were made of."""
        self.create()
        write_atomically(self.root / "history" / f"{flow}.json", json.dumps(parts).encode())

    # -- housekeeping

    def entries(self) -> list[Entry]:
        """All results, by stage and then the least recently used first."""
        found = []
        for folder in sorted((self.root / "cache").glob("*/*")):
            if _KEY.fullmatch(folder.name):
                stage = folder.parent.name
                manifest = folder / _MANIFEST
                used = manifest.stat().st_mtime if manifest.exists() else 0.0
                size = _size(folder) + _size(self.root / "checkpoints" / stage / folder.name)
                found.append(Entry(stage, folder.name, folder, size, used))
        return sorted(found, key=lambda entry: (entry.stage, entry.used))

    def verify(self) -> Iterator[tuple[Entry, str | None]]:
        """Every result with what is wrong with it, comparing every byte."""
        for entry in self.entries():
            try:
                artifact = self.find(entry.stage, entry.key)
                if artifact is None:
                    raise BrokenArtifactError("it has no record")
                manifest, _ = _read_manifest(entry.folder)
                _check_files(entry.folder, manifest["files"], thorough=True)
            except BrokenArtifactError as error:
                yield entry, str(error)
            else:
                yield entry, None

    def prune(self, days: float, dry_run: bool = False) -> list[Entry]:
        """Remove the results that no run has used for ``days`` days, and what killed runs have left behind.

        A step that is at work is left alone.
        """
        oldest = time.time() - days * 86400
        pruned = [entry for entry in self.entries() if entry.used < oldest]
        if dry_run:
            return pruned
        removed = []
        for entry in pruned:
            with self._locked(entry.stage, entry.key) as locked:
                if locked:
                    self.forget(entry.stage, entry.key)
                    shutil.rmtree(entry.folder, ignore_errors=True)
                    shutil.rmtree(self.root / "checkpoints" / entry.stage / entry.key, ignore_errors=True)
                    removed.append(entry)
        self._sweep(oldest)
        return removed

    def _sweep(self, oldest: float) -> None:
        """Remove half-written results, checkpoints without a result, and notes of exports, that are older."""
        for path in (self.root / "cache").glob("*/.new-*"):
            if path.stat().st_mtime < oldest:
                shutil.rmtree(path, ignore_errors=True)
        for path in (self.root / "checkpoints").glob("*/*"):
            if not self.folder(path.parent.name, path.name).exists() and path.stat().st_mtime < oldest:
                with self._locked(path.parent.name, path.name) as locked:
                    if locked:
                        shutil.rmtree(path, ignore_errors=True)
        for path in self.exports.glob("*"):
            with contextlib.suppress(OSError):
                if path.stat().st_mtime < oldest:
                    path.unlink()

    @contextlib.contextmanager
    def _locked(self, stage: str, key: str) -> Iterator[bool]:
        """Whether nobody else was at work on ``key``; then it is ours meanwhile."""
        import filelock

        lock = self.lock(record_name(stage, key), timeout=0)
        try:
            lock.acquire()
        except filelock.Timeout:
            yield False
            return
        try:
            yield True
        finally:
            lock.release()


class StoredCheckpoints:
    """The scales of one step, see `texloom.stages.checkpoints.Checkpoints`."""

    def __init__(self, folder: Path, provenance: Mapping[str, Any]):
        self.folder = folder
        self.provenance = provenance

    def levels(self) -> list[int]:
        """The levels that are there, highest first."""
        return sorted(
            (int(path.name) for path in self.folder.glob("[0-9]*") if path.name.isdecimal()), reverse=True
        )

    def latest(self, state: type[T]) -> tuple[int, T] | None:
        """The highest whole checkpoint and its level."""
        for level in self.levels():
            with contextlib.suppress(BrokenArtifactError):
                return level, state(**_read(self.folder / f"{level:02d}", state, None))
        return None

    def save(self, level: int, state: Any) -> None:
        """Keep ``state``."""
        _write(self.folder / f"{level:02d}", state, {**self.provenance, "level": level})


def record_name(stage: str, key: str) -> str:
    """The name of a record and of its lock. A dot in it would make Prefect's records share one lock."""
    return f"{stage.replace('.', '-')}-{key}"


def _write(
    folder: Path, result: Any, provenance: Mapping[str, Any], seconds: float = 0.0
) -> tuple[dict[str, str], str]:
    """File ``result`` as ``folder``; content digests of its outputs, and the manifest's."""
    from texloom.pipelines.store import codec

    folder.parent.mkdir(parents=True, exist_ok=True)
    prefix = f".new-{folder.name[:16]}-"
    for left in folder.parent.glob(f"{prefix}*"):  # by a process that was killed, as the lock is ours
        shutil.rmtree(left, ignore_errors=True)
    temporary = folder.with_name(prefix + secrets.token_hex(4))
    temporary.mkdir()
    try:
        made = {"program": f"texloom {importlib.metadata.version('texloom')}", **provenance}
        files = {}
        for name in codec.write(result, temporary, made):
            _flush(temporary / name)
            status = (temporary / name).stat()
            digest = file_digest(temporary / name)
            files[name] = {"sha256": digest, "bytes": status.st_size, "mtime_ns": status.st_mtime_ns}
        outputs = codec.digests(result)
        times = {"created": _now(), "seconds": round(seconds, 3)}
        manifest = json.dumps({**made, **times, "outputs": outputs, "files": files}, indent=2).encode()
        write_atomically(temporary / _MANIFEST, manifest)
        _flush(temporary)
        if folder.exists():  # broken, or it would not be computed again
            shutil.rmtree(folder)
        temporary.rename(folder)
        _flush(folder.parent)
    except BaseException:
        shutil.rmtree(temporary, ignore_errors=True)
        raise
    return outputs, hashlib.sha256(manifest).hexdigest()


def _read(folder: Path, kind: type[Any], names: Collection[str] | None) -> dict[str, Any]:
    from texloom.pipelines.store import codec

    manifest, _ = _read_manifest(folder)
    files = manifest["files"]
    _check_files(folder, {name: entry for name, entry in files.items() if not name.endswith(".png")}, thorough=True)
    try:
        return codec.read(kind, folder, names)
    except codec.ArtifactError as error:
        raise BrokenArtifactError(str(error)) from None


def _read_manifest(folder: Path) -> tuple[dict[str, Any], str]:
    """What it says, and its digest."""
    try:
        content = _small(folder / _MANIFEST)
        manifest = json.loads(content)
        if not all(isinstance(entry, dict) for entry in manifest["files"].values()):
            raise TypeError
    except _NOT_AS_EXPECTED:
        raise BrokenArtifactError(f"{_MANIFEST} cannot be read") from None
    return dict(manifest), hashlib.sha256(content).hexdigest()


def _check_files(folder: Path, files: Mapping[str, Mapping[str, Any]], thorough: bool) -> None:
    for name, entry in files.items():
        path = folder / name
        try:
            status = path.stat()
            if Path(name).name != name or status.st_size != entry.get("bytes"):
                raise BrokenArtifactError(f"{name} has {status.st_size} bytes, not {entry.get('bytes')}")
            same_time = status.st_mtime_ns == entry.get("mtime_ns")
            if (thorough or not same_time) and file_digest(path) != entry.get("sha256"):
                raise BrokenArtifactError(f"{name} has been altered")
        except (OSError, ValueError):
            raise BrokenArtifactError(f"{name} is missing") from None


def _small_json(path: Path) -> Any:
    return json.loads(_small(path))


def _is_parts(found: Any) -> bool:
    """Whether this is what a key was made of, as far as its shape goes."""
    return isinstance(found, dict) and all(isinstance(found.get(name), dict) for name in ("params", "inputs"))


def _small(path: Path) -> bytes:
    status = path.stat()
    if not stat.S_ISREG(status.st_mode):  # reading a pipe would wait for its writer
        raise ValueError("not a file")
    if status.st_size > _LARGEST_JSON:
        raise ValueError("too large")
    return path.read_bytes()


def _flush(path: Path) -> None:
    handle = os.open(path, os.O_RDONLY)
    try:
        os.fsync(handle)
    finally:
        os.close(handle)


def _size(folder: Path) -> int:
    return sum(path.stat().st_size for path in folder.rglob("*") if path.is_file())


def _now() -> str:
    return datetime.datetime.now(datetime.UTC).isoformat(timespec="seconds")
