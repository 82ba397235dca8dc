"""What the last runs of a flow used: it explains why results are computed again, and spares large sets their files.

To read the records, manifests and exports of thousands of finished items takes long where the system does not have
them in memory. So a result is looked up here if its record has the time that the last run gave to all records that
it used, and its folder is the same one; and an export if its files are. The files in a result's folder are compared
with its manifest when they are read.
"""

from __future__ import annotations

import contextlib
import os
import re
import time
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from texloom.pipelines.store import checked_json
from texloom.pipelines.store.record import left_out_of
from texloom.pipelines.store.store import Artifact, Store

State = list[int]
_KEY = re.compile(r"[0-9a-f]{64}")
_OF_RESULT = {"key", "outputs", "manifest", "warnings", "left_out", "folder"}
_MOST_STEPS = 200_000  # beyond them those that the last run did not use are forgotten; 120 MB


class History:
    """Of one flow in one store."""

    def __init__(self, store: Store, flow: str):
        self.steps: dict[str, Any]
        """step, after its item's name, to the parts of its key and its result in the last run that had it"""
        self.exports: dict[str, Any]
        """path to what `texloom.pipelines.engine.exports.States` says at the end of the last run of a large set"""
        self.used: dict[str, str] = {}
        """step to the key of its result in this run"""
        self.now = time.time_ns()
        self._store = store
        self._path = store.root / "history" / flow
        self._last = _change(self._path)
        self._is_new = False
        document: dict[str, Any] = {}
        with contextlib.suppress(OSError), store.inside("history") as folder:
            document = checked_json.read_in(folder, flow)
        self.steps = _of_form(document.get("steps"), _is_result)
        self.exports = _of_form(document.get("exports"), _is_export)

    def find(self, step: str, parts: Mapping[str, Any]) -> Artifact | None:
        """The result that a step had in the last run, if its key has the same parts and it was left alone since."""
        known = self.steps.get(step)
        if known is None or not self._last or any(known.get(name) != value for name, value in parts.items()):
            return None
        artifact = self._store.location(known["stage"], known["key"])
        folder, used = file_state(artifact.place), _change(self._store.record(artifact))
        if folder is None or folder != known["folder"] or used not in (self._last, self.now):
            return None
        self.used[step] = artifact.key
        warnings = tuple(known.get("warnings", ()))
        return Artifact(
            artifact.stage, artifact.key, artifact.place, known["outputs"], known["manifest"], warnings,
            left_out=left_out_of(known),
        )  # fmt: skip

    def add(self, step: str, parts: Mapping[str, Any], artifact: Artifact, is_new: bool) -> None:
        """Note that this run uses a result; one that is not new may be in use by a run that began later."""
        if is_new or _change(self._store.record(artifact)) < self.now:
            self._store.touch(artifact, self.now)
        if step in self.used:
            return
        self._note(step, parts, artifact)

    def replace(self, step: str, artifact: Artifact) -> None:
        """Note that the files of a result that this run uses were left out."""
        known = self.steps[step]
        self._note(step, {name: known[name] for name in known.keys() - _OF_RESULT}, artifact)

    def _note(self, step: str, parts: Mapping[str, Any], artifact: Artifact) -> None:
        self.used[step] = artifact.key
        result: dict[str, Any] = {
            "key": artifact.key,
            "outputs": dict(artifact.outputs),
            "manifest": artifact.manifest,
        }
        result |= {"warnings": list(artifact.warnings)} if artifact.warnings else {}
        result |= {"left_out": artifact.left_out} if artifact.left_out else {}
        known = {**parts, **result, "folder": file_state(artifact.place)}
        if known != self.steps.get(step):
            self.steps[step], self._is_new = known, True

    def save(self, exports: dict[str, Any] | None = None) -> None:
        """Keep it, if that is possible; ``exports`` replace those of the last run."""
        if exports is not None and exports != self.exports:
            self.exports, self._is_new = exports, True
        if len(self.steps) > _MOST_STEPS:
            self.steps = {step: self.steps[step] for step in self.used}
        with contextlib.suppress(OSError), self._store.inside("history", create=True) as folder:
            if self._is_new:
                checked_json.write_in(folder, self._path.name, {"steps": self.steps, "exports": self.exports})
            folder.touch(self._path.name, self.now)


def file_state(path: str | Path) -> State | None:
    """What tells that a file or folder is another one, or was changed: inode, size, both times of change.

    None where it is not there or the times do not tell: on a file system that only has whole seconds.
    """
    try:
        status = os.stat(path)  # noqa: PTH116 (as text, as there are thousands)
    except (OSError, ValueError):  # a null character in a name
        return None
    if os.name != "posix" or status.st_ctime_ns % 10**9 == 0:
        return None
    return [status.st_ino, status.st_size, status.st_mtime_ns, status.st_ctime_ns]


def _change(path: str | Path) -> int:
    """When a file was written or touched, ns; 0 where it is not there, or the time is in whole seconds."""
    try:
        time_ns = os.stat(path).st_mtime_ns  # noqa: PTH116
    except OSError:
        return 0
    return time_ns if time_ns % 10**9 else 0


def _of_form(entries: Any, is_whole: Callable[[Any], bool]) -> dict[str, Any]:
    """The entries that have the form in which they are kept, as others may write into a store."""
    return {name: entry for name, entry in entries.items() if is_whole(entry)} if isinstance(entries, dict) else {}


def _is_result(entry: Any) -> bool:
    return (
        isinstance(entry, dict)
        and all(isinstance(entry.get(name), str) for name in ("stage", "key", "manifest"))
        and _KEY.fullmatch(entry["key"]) is not None
        and all(isinstance(entry.get(name, {}), dict) for name in ("params", "inputs", "outputs"))
        and all(isinstance(digest, str) for digest in entry.get("outputs", {}).values())
        and isinstance(entry.get("warnings", []), list)
        and all(isinstance(text, str) for text in entry.get("warnings", []))
        and entry.keys() >= {"outputs", "folder"}
    )


def _is_export(entry: Any) -> bool:
    return (
        isinstance(entry, dict)
        and isinstance(entry.get("key"), str)
        and isinstance(entry.get("files"), dict)
        and isinstance(entry.get("told", []), list)
    )
