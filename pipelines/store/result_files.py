"""The files of one result: written whole or not at all, with a manifest, and checked when they are read."""

from __future__ import annotations

import datetime
import errno
import functools
import hashlib
import importlib.metadata
import json
import os
import secrets
import stat
from collections.abc import Callable, Collection, Mapping
from pathlib import Path
from typing import Any

from texloom.pipelines.store import removal
from texloom.pipelines.store.atomic import file_digest, write_atomically
from texloom.pipelines.store.folders import Folder, named
from texloom.stages.kernels.core.threads import run_all

MANIFEST = removal.MANIFEST
_MAX_JSON_SIZE = 1 << 24  # bytes
_AT_ONCE = os.O_RDONLY | getattr(os, "O_NONBLOCK", 0) | getattr(os, "O_NOFOLLOW", 0) | getattr(os, "O_BINARY", 0)
"""how files are opened: to open a pipe without it would wait for its writer; links are not followed"""
NOT_AS_EXPECTED = (OSError, ValueError, KeyError, TypeError, AttributeError, RecursionError)
"""raised by reading JSON of unexpected form"""


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
    from texloom.pipelines.store.outputs import outputs_of

    result = outputs_of(result)
    with named(f"{parent.path}/{name}"):
        return _write_as(parent, name, result, provenance, seconds, is_checkpoint)


def _write_as(
    parent: Folder, name: str, result: Any, provenance: Mapping[str, Any], seconds: float, is_checkpoint: bool
) -> tuple[dict[str, str], str]:
    from texloom.pipelines.store import codec

    prefix = f".new-{name}-"
    for left in parent.names():
        if left.startswith(prefix):  # by a process that was killed, as the lock is ours
            removal.remove_temporary(parent, left)
    temporary = prefix + secrets.token_hex(4)
    parent.mkdir(temporary)
    folder = Path(parent.path, temporary)
    try:
        made = {"program": program_version(), **provenance}
        names = codec.write(result, folder, made, previews=not is_checkpoint)
        # the digests of the outputs are computed while others wait for the disk
        work: list[Callable[[], Any]] = [functools.partial(codec.digests, result)]
        work += [functools.partial(_entry, folder / file, not is_checkpoint) for file in names]
        outputs, *entries = run_all(lambda one: one(), [(one,) for one in work])
        files = dict(zip(names, entries, strict=True))
        times = {"created": _now(), "seconds": round(seconds, 3)}
        manifest = json.dumps({**made, **times, "outputs": outputs, "files": files}, indent=2).encode()
        write_atomically(folder / MANIFEST, manifest, not is_checkpoint)
        if not is_checkpoint:
            _flush(folder)
        _make_room(parent, name, outputs)
        parent.rename(temporary, name)
        if not is_checkpoint:
            _flush(Path(parent.path))
    except BaseException:
        removal.remove_temporary(parent, temporary)
        raise
    return outputs, hashlib.sha256(manifest).hexdigest()


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
        manifest = json.loads(content)
        if not all(isinstance(entry, dict) for entry in manifest["files"].values()):
            raise TypeError
    except NOT_AS_EXPECTED:
        raise BrokenArtifactError(f"{MANIFEST} cannot be read") from None
    return dict(manifest), hashlib.sha256(content).hexdigest()


def check_files(folder: str | Path, files: Mapping[str, Mapping[str, Any]], thorough: bool) -> None:
    """`BrokenArtifactError` unless the files of a manifest are there; ``thorough``: and hold what was written."""
    for name, entry in files.items():
        try:
            if os.path.basename(name) != name:  # noqa: PTH119 (paths as text, as there are thousands)
                raise ValueError(name)
            status = os.stat(f"{folder}/{name}")  # noqa: PTH116
            if status.st_size != entry.get("bytes"):
                raise BrokenArtifactError(f"{name} has {status.st_size} bytes, not {entry.get('bytes')}")
            same_time = status.st_mtime_ns == entry.get("mtime_ns")
            if (thorough or not same_time) and file_digest(Path(folder, name)) != entry.get("sha256"):
                raise BrokenArtifactError(f"{name} has been altered")
        except (OSError, ValueError):
            raise BrokenArtifactError(f"{name} is missing") from None


def small_file(path: str | Path) -> bytes:
    """The content of a file of JSON; `OSError` or `ValueError` if it cannot be one."""
    handle = os.open(path, _AT_ONCE)
    try:
        status = os.fstat(handle)
        if not stat.S_ISREG(status.st_mode):
            raise ValueError("not a file")
        if status.st_size > _MAX_JSON_SIZE:
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
