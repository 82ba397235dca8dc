"""Removing from a store what texloom wrote, and nothing else.

Results and checkpoints are removed by the names that their manifests list, as only texloom has folders named by
keys. Exports and arrays, which a user sees, are removed only if they still hold what was written: exports by the
digests of `texloom.pipelines.store.written`, arrays and dropped pictures by their own names, which are the digests
of what they hold. A folder is removed only if nothing else is in it. No link is followed.
"""

from __future__ import annotations

import contextlib
import hashlib
import json
import re
from collections.abc import Iterable, Iterator
from pathlib import Path

from texloom.pipelines.store import written
from texloom.pipelines.store.folders import Folder

MANIFEST = "manifest.json"
MAPS = "maps.yaml"
"""lists the maps of a material that a program gave as arrays"""
SOURCE = re.compile(r"[0-9a-f]{64}(\.(png|exr))?|[0-9a-f]{16}")
"""what texloom calls an array, the folder of a material, and that of what was dropped into the studio"""
_FIXED = {"result.exr", "tables.json"}
_MADE = re.compile(r"result\.exr|tables\.json|manifest\.json|\w+\.(png|html|csv)|\.new-[0-9a-f]{8}-.+")
_LEVEL = re.compile(r"\d+|\.new-\d+-[0-9a-f]{8}")
_MOST = 1 << 24  # bytes of a manifest


def names_of(outputs: Iterable[str]) -> set[str]:
    """The names that files of a result with these outputs may have, but for its manifest."""
    return _FIXED | {f"{output}.{suffix}" for output in outputs for suffix in ("png", "html", "csv")}


def remove_result(stage: Folder, key: str, outputs: Iterable[str] = ()) -> bool:
    """Remove a result from the folder of its stage; ``outputs``: known of it, as its manifest may be damaged.

    Returns
    -------
    whether its folder is gone.
    """
    with contextlib.suppress(OSError), stage.child(key) as folder:
        names = names_of(outputs)
        with contextlib.suppress(OSError, ValueError, KeyError, TypeError, RecursionError):
            names |= set(json.loads(folder.read(MANIFEST, _MOST))["files"])
        for name in folder.names():
            if name in names and name != MANIFEST:
                folder.unlink_file(name)
        folder.unlink_file(MANIFEST)  # last, as it names the others
    return stage.rmdir(key)


def remove_temporary(folder: Folder, name: str) -> bool:
    """Remove a folder with a name at random, in which a process was writing a result; whether it is gone."""
    return folder.remove_flat(name, _MADE.fullmatch)


def remove_checkpoints(root: Path, stage: str, key: str) -> None:
    """Remove the checkpoints of a step."""
    with contextlib.suppress(OSError), Folder.at(root, "checkpoints", stage) as folder:
        with contextlib.suppress(OSError), folder.child(key) as levels:
            for level in levels.names():
                if _LEVEL.fullmatch(level):
                    remove_temporary(levels, level)
        folder.rmdir(key)


def remove_run(root: Path, run: str) -> bool:
    """Remove the exports of a run without ``--out``; whether its folder is gone. What was changed is the user's."""
    files = written.read(root, run)
    folders = _folders_of(run, files)
    for path, digest in files.items():
        *parents, name = path.split("/")
        with contextlib.suppress(OSError, ValueError), Folder.at(root, "runs", run, *parents) as folder:
            if folder.digest(name) == digest:
                folder.unlink(name)
    gone = False
    for folders_parts in folders:
        with contextlib.suppress(OSError), Folder.at(root, "runs", *folders_parts) as folder:
            folder.remove_abandoned()
        with contextlib.suppress(OSError), Folder.at(root, "runs", *folders_parts[:-1]) as folder:
            gone = folder.rmdir(folders_parts[-1])
    written.forget(root, run)
    return gone


def sweep_run(root: Path, run: str) -> None:
    """Remove the temporary files of a run that was killed."""
    for parts in _folders_of(run, written.read(root, run)):
        with contextlib.suppress(OSError), Folder.at(root, "runs", *parts) as folder:
            folder.remove_abandoned()


def _folders_of(run: str, files: Iterable[str]) -> list[tuple[str, ...]]:
    """The folders of a run's files, the deepest first, its own last."""
    parts = {(run, *path.split("/")[:depth]) for path in files for depth in range(path.count("/") + 1)}
    return sorted({*parts, (run,)}, key=lambda one: -len(one))


def remove_source(root: Path, name: str) -> bool:
    """Remove arrays or what was dropped, if they hold what their name says; whether nothing is left."""
    try:
        with Folder.at(root, "sources") as sources:
            return _remove_array(sources, name) if "." in name else _remove_arrays(root, sources, name)
    except (OSError, ValueError, TypeError, AttributeError, RecursionError):
        return False


def _remove_array(sources: Folder, name: str) -> bool:
    is_ours = sources.digest(name) == name.partition(".")[0]
    if is_ours:
        sources.unlink(name)
    return is_ours


def _remove_arrays(root: Path, sources: Folder, name: str) -> bool:
    files = _files_of(sources, name)
    for parts in files:
        with Folder.at(root, "sources", *parts[:-1]) as folder:
            folder.unlink(parts[-1])
    for inner in {parts[:-1] for parts in files} - {(name,)}:
        with Folder.at(root, "sources", *inner[:-1]) as folder:
            folder.rmdir(inner[-1])
    return sources.rmdir(name)


def _files_of(sources: Folder, name: str) -> list[tuple[str, ...]]:
    """The files of a folder that is named by the digest of what they hold; none where it is not."""
    with sources.child(name) as folder:
        if len(name) == 64:
            listing = folder.read(MAPS, _MOST)
            digest, files = hashlib.sha256(listing), []
            for role, file in json.loads(listing).items():
                if file in (f"{role}.png", f"{role}.exr") and "/" not in file:
                    digest.update(file.encode() + bytes.fromhex(folder.digest(file)))
                    files.append((name, file))
            return [*files, (name, MAPS)] if digest.hexdigest() == name else []
        found = sorted(_walk(folder))
        listed = "".join(f"{parts[-1]}:{digest};" for parts, digest in found)
        digests = {hashlib.sha256(listed.encode()).hexdigest(), *(digest for _, digest in found if len(found) == 1)}
        return [(name, *parts) for parts, _ in found] if any(one.startswith(name) for one in digests) else []


def _walk(folder: Folder, depth: int = 1) -> Iterator[tuple[tuple[str, ...], str]]:
    """Files, and those of folders inside, with their digests; `ValueError` or `OSError` where there are others."""
    for name in folder.names():
        try:
            yield (name,), folder.digest(name)
        except (ValueError, IsADirectoryError):
            if not depth:
                raise
            with folder.child(name) as inner:
                for parts, digest in _walk(inner, depth - 1):
                    yield (name, *parts), digest
