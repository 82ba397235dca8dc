"""The scales of a long step in the store."""

from __future__ import annotations

import contextlib
from pathlib import Path
from typing import Any, TypeVar

from texloom.pipelines.store.folders import Folder
from texloom.pipelines.store.result_files import BrokenArtifactError, read_result, write_result

T = TypeVar("T")


class StoredCheckpoints:
    """The checkpoints of one step, see `texloom.stages.vocabulary.checkpoints.Checkpoints`."""

    def __init__(self, root: Path, stage: str, key: str):
        self.folder = root / "checkpoints" / stage / key
        self._root, self._stage, self._key = root, stage, key

    def levels(self) -> list[int]:
        """The stored levels, highest first."""
        names = (path.name for path in self.folder.glob("[0-9]*"))
        return sorted((int(name) for name in names if name.isdecimal()), reverse=True)

    def latest(self, state: type[T]) -> tuple[int, T] | None:
        """The highest complete checkpoint and its level."""
        for level in self.levels():
            with contextlib.suppress(BrokenArtifactError):
                return level, state(**read_result(self.folder / f"{level:02d}", state, None))
        return None

    def save(self, level: int, state: Any) -> None:
        """Store ``state``; after a power failure it may be broken, and then an earlier one is the latest."""
        provenance = {"stage": self._stage, "key": self._key, "level": level}
        with Folder.at(self._root, "checkpoints", self._stage, self._key, create=True) as folder:
            write_result(folder, f"{level:02d}", state, provenance, is_checkpoint=True)
