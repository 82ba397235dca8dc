"""The files that a run reads, which nothing that it writes may replace."""

from __future__ import annotations

import os
from collections.abc import Iterator
from pathlib import Path

from texloom.pipelines.flow.items import Item
from texloom.pipelines.flow.model import Flow
from texloom.pipelines.flow.step_params import document_params, file_params
from texloom.pipelines.media import locate as picture_files
from texloom.pipelines.media import material_set, stack
from texloom.pipelines.media.headers import Refusal
from texloom.stages.vocabulary.declare import Params

_FileIdentity = tuple[int, int]  # device and inode: the same under all names and links


class FilesRead:
    """The files that a run reads, told apart by what they are and not by their names.

    No picture is opened, so that it costs little also where there are thousands.
    """

    def __init__(self, flow: Flow, items: list[Item]):
        self._files: dict[_FileIdentity, str] = {}
        folders: set[str] = set()
        given = [source for source in flow.sources.values() if isinstance(source, str)]
        given += [path for item in items for path in item.sources.values()]
        for reference in dict.fromkeys(given):
            for path in _files_of(reference):
                self._add(path, "a source of the flow")
                # As text, as there may be thousands.
                folders.add(os.path.dirname(path) or ".")  # noqa: PTH120
                if os.path.isdir(path):  # noqa: PTH112
                    folders.add(path)
        self._source_folders = {there for folder in folders if (there := _file(folder)) is not None}
        for file in (flow.path, *flow.more_paths):
            self._add(file, "the flow file")
        for step in flow.steps.values():
            for param, file in _files_of_params(step.params):
                self._add(file, f"a file of steps.{step.name}.params.{param}")

    def _add(self, path: str | Path, what: str) -> None:
        file = _file(path)
        if file is not None:
            self._files.setdefault(file, what)

    def at(self, path: str | Path) -> str | None:
        """What stands at ``path``, in words, if it is one of them."""
        file = _file(path)
        return None if file is None else self._files.get(file)

    def in_folder(self, folder: Path) -> str | None:
        """What maps that are written into ``folder`` would replace, if anything."""
        if (file := _file(folder)) is None:
            return None
        if file in self._source_folders:
            return "a source of the flow"
        names = (entry for entry in folder.iterdir() if entry.suffix.lower() in (".png", ".exr", ".mtlx"))
        return next((what for path in names if (what := self.at(path)) is not None), None)


def _file(path: str | Path) -> _FileIdentity | None:
    """What is at ``path``; nothing if there is none, or it cannot be known."""
    try:
        status = os.stat(path)  # noqa: PTH116
    except (OSError, ValueError):
        return None
    return status.st_dev, status.st_ino


def _files_of(reference: str) -> Iterator[str]:
    try:
        if stack.is_stack(reference):
            yield from (_located(one) for one in (stack.path_of(reference), *stack.files_of(reference)))
            return
        yield _located(reference)
        if material_set.is_map_set(reference):
            yield from map(str, material_set.files_of(reference))
    except (Refusal, OSError):
        return  # what is wrong with it is told where it is opened


def _located(reference: str) -> str:
    return reference if picture_files.is_path(reference) else str(picture_files.locate(reference))


def _files_of_params(params: Params) -> Iterator[tuple[str, Path]]:
    for name in file_params(type(params)):
        if (path := getattr(params, name)) is not None:
            yield name, path
    for name in document_params(type(params)):
        if (document := getattr(params, name)) is not None:
            yield name, document.file
            yield from ((name, picture) for picture in document.pictures.values())
