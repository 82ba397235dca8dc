"""The files of one result: written whole or not at all, with a manifest, and checked when they are read."""

from __future__ import annotations

import contextlib
import datetime
import errno
import functools
import hashlib
import importlib.metadata
import json
import os
import re
import secrets
import stat
from collections.abc import Callable, Collection, Iterator, Mapping
from pathlib import Path
from typing import Any, BinaryIO

from texloom.pipelines.errors import shown
from texloom.pipelines.store import removal
from texloom.pipelines.store.atomic import file_digest, write_atomically
from texloom.pipelines.store.folders import Folder, named
from texloom.stages.kernels.core.threads import run_all

MANIFEST = removal.MANIFEST
MAX_JSON_SIZE = 1 << 24
"""bytes"""
_DIGEST = re.compile(r"[0-9a-f]{64}")
_NAME = re.compile(r"[^/\\\0]+")
_MOST = 1 << 62  # bytes, and ns since 1970
_SMALL = 2**16  # bytes of a file that is read at once
_NO_LINK = getattr(os, "O_NOFOLLOW", 0)
_AT_ONCE = os.O_RDONLY | getattr(os, "O_NONBLOCK", 0) | _NO_LINK | getattr(os, "O_BINARY", 0)
"""how files are opened: to open a pipe without it would wait for its writer; links are not followed"""
NOT_AS_EXPECTED = (OSError, ValueError, KeyError, TypeError, AttributeError, RecursionError)
"""raised by reading JSON of unexpected form"""
Download = Callable[[Mapping[str, Any], BinaryIO], str | None]
"""writes what the entry of a manifest names into a file; SHA-256 of what was written, None if it is not there"""


class BrokenArtifactError(Exception):
    """A result that has a record is missing, truncated or altered; ``key`` is its key, where known."""

    def __init__(self, problem: str, key: str = ""):
        super().__init__(problem)
        self.key = key


def write_result(
    parent: Folder,
    name: str,
    result: Any,
    provenance: Mapping[str, Any],
    seconds: float = 0.0,
    is_checkpoint: bool = False,
) -> tuple[dict[str, str], str]:
    """File ``result`` as a folder in ``parent``; content digests of its outputs, and the manifest's.

    A checkpoint is not flushed to the disk and has no previews.
    """
    from texloom.pipelines.store import codec
    from texloom.pipelines.store.outputs import outputs_of

    result = outputs_of(result)
    with new_result(parent, name, not is_checkpoint) as (folder, outputs):
        made = {"program": program_version(), **provenance}
        names = codec.write(result, folder, made, previews=not is_checkpoint)
        # the digests of the outputs are computed while others wait for the disk
        work: list[Callable[[], Any]] = [functools.partial(codec.digests, result)]
        work += [functools.partial(_entry, folder / file, not is_checkpoint) for file in names]
        digests, *entries = run_all(lambda one: one(), [(one,) for one in work])
        outputs.update(digests)
        files = dict(zip(names, entries, strict=True))
        times = {"created": _now(), "seconds": round(seconds, 3)}
        manifest = json.dumps({**made, **times, "outputs": outputs, "files": files}, indent=2).encode()
        write_atomically(folder / MANIFEST, manifest, not is_checkpoint)
    return outputs, hashlib.sha256(manifest).hexdigest()


def receive_result(
    parent: Folder,
    name: str,
    manifest: bytes,
    entries: Mapping[str, Mapping[str, Any]],
    outputs: Mapping[str, str],
    download: Download,
) -> None:
    """File a result of a shared store as a folder in ``parent``, see `checked_entries`.

    `BrokenArtifactError` where a file is not what its entry says.
    """
    with new_result(parent, name) as (folder, digests):
        digests.update(outputs)
        for file_name, entry in entries.items():
            with (folder / file_name).open("xb") as file:
                if download(entry, file) != entry["sha256"]:
                    raise BrokenArtifactError(f"{file_name} is missing, or not what its record says")
                file.flush()
                os.fsync(file.fileno())
            os.utime(folder / file_name, ns=(entry["mtime_ns"], entry["mtime_ns"]))
        write_atomically(folder / MANIFEST, manifest)


def checked_entries(
    manifest: bytes, stage: str, key: str, names: Collection[str]
) -> tuple[dict[str, Any], dict[str, Any]]:
    """The outputs and the entries of files of a manifest from elsewhere, all that is used of it.

    `BrokenArtifactError` where it is not that of this ``stage`` and ``key`` with outputs of all ``names``, or lists
    what cannot be a file of such a result.
    """
    if len(manifest) > MAX_JSON_SIZE:
        raise BrokenArtifactError("it is too large")
    try:
        found = json.loads(manifest)
        outputs, files = dict(found["outputs"]), dict(found["files"])
        if (found["stage"], found["key"]) != (stage, key):
            raise BrokenArtifactError("it is that of another result")
        if outputs.keys() != set(names) or not all(isinstance(digest, str) for digest in outputs.values()):
            raise BrokenArtifactError("its outputs are not those of the stage")
        known = removal.names_of(names)
        for file, entry in files.items():
            if file not in known:
                raise BrokenArtifactError(f"it lists {shown(file)}, which no such result has")
            times = entry["bytes"], entry["mtime_ns"]
            if not _DIGEST.fullmatch(entry["sha256"]) or not all(type(n) is int and 0 <= n < _MOST for n in times):
                raise BrokenArtifactError(f"its entry of {file} is not one")
    except NOT_AS_EXPECTED:
        raise BrokenArtifactError("it cannot be read") from None
    return outputs, files


@contextlib.contextmanager
def new_result(parent: Folder, name: str, is_durable: bool = True) -> Iterator[tuple[Path, dict[str, str]]]:
    """A new folder for the files of a result, which the ``with`` block writes, and the digests of its outputs.

    It is put in place at the end, or removed if the block fails.
    """
    prefix = f".new-{name}-"
    outputs: dict[str, str] = {}
    with named(f"{parent.path}/{name}"):
        for left in parent.names():
            if left.startswith(prefix):  # by a process that was killed, as the lock is ours
                removal.remove_temporary(parent, left)
        temporary = prefix + secrets.token_hex(4)
        parent.mkdir(temporary)
        folder = Path(parent.path, temporary)
        try:
            yield folder, outputs
            if is_durable:
                _flush(folder)
            _make_room(parent, name, outputs)
            parent.rename(temporary, name)
            if is_durable:
                _flush(Path(parent.path))
        except BaseException:
            removal.remove_temporary(parent, temporary)
            raise


def keep_manifest(parent: Folder, name: str, outputs: Mapping[str, str]) -> None:
    """Remove the files of a result but its manifest, which is in another folder then, as after every change."""
    with parent.child(name) as folder:
        manifest = folder.read(MANIFEST, MAX_JSON_SIZE)
    with new_result(parent, name, is_durable=False) as (place, digests):
        digests.update(outputs)
        write_atomically(place / MANIFEST, manifest, durable=False)


def _make_room(parent: Folder, name: str, outputs: Collection[str]) -> None:
    """Remove what is in place of a result: it is broken, or it would not be computed again."""
    status = parent.status(name)
    if status is None:
        return
    if not stat.S_ISDIR(status.st_mode):
        parent.unlink(name)
    elif not removal.remove_result(parent, name, outputs):
        raise OSError(
            errno.ENOTEMPTY, "holds files that texloom did not write; move them away", f"{parent.path}/{name}"
        )


def _entry(path: Path, is_durable: bool) -> dict[str, Any]:
    """A file's entry in the manifest; first it is flushed if it is to outlast a power failure."""
    if is_durable:
        _flush(path)
    status = path.stat()
    return {"sha256": file_digest(path), "bytes": status.st_size, "mtime_ns": status.st_mtime_ns}


def read_result(folder: Path, kind: type[Any], names: Collection[str] | None) -> dict[str, Any]:
    """The outputs called ``names``, or all, of a folder; `BrokenArtifactError` if a file was altered."""
    from texloom.pipelines.store import codec

    manifest, _ = read_manifest(folder)
    files = manifest["files"]
    check_files(folder, {name: entry for name, entry in files.items() if not name.endswith(".png")}, thorough=True)
    try:
        return codec.read(kind, folder, names)
    except codec.ArtifactError as error:
        raise BrokenArtifactError(str(error)) from None


@functools.cache
def program_version() -> str:
    """The program that results name as their maker."""
    return f"texloom {importlib.metadata.version('texloom')}"


def read_manifest(folder: str | Path) -> tuple[dict[str, Any], str]:
    """The manifest of a result, and its digest."""
    try:
        content = small_file(f"{folder}/{MANIFEST}")
    except (FileNotFoundError, NotADirectoryError):
        raise BrokenArtifactError("its files are missing") from None
    except NOT_AS_EXPECTED:
        raise BrokenArtifactError(f"{MANIFEST} cannot be read") from None
    try:
        manifest = json.loads(content.decode())
        if not all(isinstance(entry, dict) for entry in manifest["files"].values()):
            raise TypeError
    except NOT_AS_EXPECTED:
        raise BrokenArtifactError(f"{MANIFEST} cannot be read") from None
    return dict(manifest), hashlib.sha256(content).hexdigest()


def check_files(folder: str | Path, files: Mapping[str, Mapping[str, Any]], thorough: bool) -> None:
    """`BrokenArtifactError` unless the files of a manifest are there; ``thorough``: and hold what was written."""
    for name, entry in files.items():
        try:
            if not _NAME.fullmatch(name):
                raise ValueError(name)
            path, size, digest = f"{folder}/{name}", entry.get("bytes"), entry.get("sha256")
            if thorough and _holds(path, size, digest):
                continue
            status = os.stat(path)  # noqa: PTH116
            if status.st_size != size:
                raise BrokenArtifactError(f"{name} has {status.st_size} bytes, not {size}")
            same_time = status.st_mtime_ns == entry.get("mtime_ns")
            if (thorough or not same_time) and file_digest(path) != digest:
                raise BrokenArtifactError(f"{name} has been altered")
        except (OSError, ValueError):
            raise BrokenArtifactError(f"{name} is missing") from None


def _holds(path: str, size: Any, digest: Any) -> bool:
    """Whether a small file has this size and digest, at a third of what `os.stat` and `file_digest` take."""
    if type(size) is not int or not 0 <= size < _SMALL:
        return False
    handle = os.open(path, _AT_ONCE & ~_NO_LINK)
    try:
        content = os.read(handle, size + 1)
    finally:
        os.close(handle)
    return len(content) == size and hashlib.sha256(content).hexdigest() == digest


def small_file(path: str | Path) -> bytes:
    """The content of a file of JSON; `OSError` or `ValueError` if it cannot be one."""
    handle = os.open(path, _AT_ONCE)
    try:
        status = os.fstat(handle)
        if not stat.S_ISREG(status.st_mode):
            raise ValueError("not a file")
        if status.st_size > MAX_JSON_SIZE:
            raise ValueError("too large")
        content = os.read(handle, status.st_size)
        if len(content) != status.st_size:
            raise ValueError("has changed while it was read")
        return content
    finally:
        os.close(handle)


def _flush(path: Path) -> None:
    handle = os.open(path, os.O_RDONLY)
    try:
        os.fsync(handle)
    finally:
        os.close(handle)


def _now() -> str:
    return datetime.datetime.now(datetime.UTC).isoformat(timespec="seconds")
