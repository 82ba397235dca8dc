"""What is known to be wrong with a run before it begins: places, memory, disk, and the files it would replace."""

from __future__ import annotations

import os
import stat
from collections.abc import Mapping
from functools import cached_property
from pathlib import Path
from typing import Any

from texloom.pipelines.byte_size import format_byte_size
from texloom.pipelines.engine.exporter import check_same
from texloom.pipelines.engine.exports import is_noted
from texloom.pipelines.engine.input_files import FilesRead
from texloom.pipelines.engine.run import Run
from texloom.pipelines.errors import one_line
from texloom.pipelines.flow.runner import check_environment, require_installed
from texloom.pipelines.media.writers.writer_registry import writer_of
from texloom.pipelines.store.atomic import check_folder, free_space, too_long
from texloom.pipelines.store.history import file_state
from texloom.stages.vocabulary.declare import InputError
from texloom.stages.vocabulary.sizes import format_size, size_value


class Preflight:
    """Checks of a run that write nothing."""

    def __init__(self, run: Run):
        self.run = run

    def check(self, out: Path, force: bool = False) -> None:
        """`InputError` where it is known before a run with exports into the folder ``out`` that it would fail.

        Exports must be writable and replace nothing that the run reads, and unless ``force`` nothing but what the
        store's notes of exports know. Nothing is written.
        """
        require_installed(self.run.flow.runner)
        check_environment()
        self._check_store()
        check_folder("--out", out)
        self._check_footprint()
        for file, reference in self.run.flow.exports.items():
            is_folder, writer = file.endswith("/"), writer_of(file)
            is_set = self.run.scope_of(reference) == "item"
            for name in [f"{item.name}/{file}" for item in self.run.items] if is_set else [file]:
                problem = self._problem_with(f"{out}/{name}", is_folder, force)
                if problem is None and writer is not None and writer.companions:
                    companions = f"{out}/{name.removesuffix(writer.suffix)}{writer.companions}"
                    problem = self._problem_with(companions, True, force)
                if problem is not None:
                    raise InputError(one_line(f"--out {out}: {problem}"))
        self._check_tiles()
        exports = self.run.flow.exports.items()
        of_items = any(file.endswith("/") and self.run.scope_of(one) == "item" for file, one in exports)
        if self.run.flow.delivery.material is not None and of_items and len(self.run.items) > 1:
            raise InputError("--material: names one material, and the flow runs over a set; leave it out")
        for scope in self.run.sample_scopes():
            for file, reference in self.run.flow.exports.items():
                if (self.run.scope_of(reference) == "item") == (scope.name is not None):
                    check_same(self.run, scope, file)

    def _check_tiles(self) -> None:
        """`InputError` where a result of a size that is known cannot be cut into equal UDIM tiles."""
        if self.run.flow.delivery.udim is None:
            return
        rows, columns = self.run.flow.delivery.udim
        for file, reference in self.run.flow.exports.items():
            step = self.run.flow.steps.get(reference.name) if file.endswith("/") else None
            size = getattr(step.params, "size", None) if step is not None else None
            if isinstance(size, tuple) and (size[0] % rows or size[1] % columns):
                tiles = size_value(self.run.flow.delivery.udim)
                raise InputError(
                    f"--udim: {format_size(size)} cannot be cut into {tiles} equal tiles; change --size"
                )

    def _check_footprint(self) -> None:
        """`InputError` where memory or disk do not suffice for a large result, unless a store has it."""
        taken = self.run.footprint()
        if taken is None or all(step.state in ("cached", "fetch") for step in self.run.first_plan):
            return
        if taken.problem:
            raise InputError(taken.problem)
        root = self.run.store.root
        free = free_space(root)
        if free < taken.disk:
            raise InputError(
                f"--store {root}: a result of this size {taken}; {format_byte_size(free)} are free there"
            )

    def _check_store(self) -> None:
        """`InputError` where the store cannot be written, unless every result is in it."""
        try:
            self.run.store.check_writable()
        except InputError:
            if any(step.state != "cached" for step in self.run.first_plan):
                raise

    def _problem_with(self, path: str, is_folder: bool, force: bool) -> str | None:
        """Why an export cannot be written to ``path``, which is text, as there are thousands."""
        if (problem := too_long(path)) is not None:
            return problem
        try:
            there = os.stat(path)  # noqa: PTH116
        except FileNotFoundError:
            return None
        except OSError as error:
            return f"{Path(path)}: {str(error.strerror or error).lower()}"
        if stat.S_ISDIR(there.st_mode) != is_folder:
            return f"{Path(path)} is {'not ' if is_folder else ''}a folder"
        what = self.files_read.in_folder(Path(path)) if is_folder else self.files_read.at(path)
        if what is not None:
            return f"{Path(path)} would replace {what}; give another folder"
        foreign = None if force else self._foreign(path, is_folder)
        if foreign is None:
            return None
        return f"{Path(foreign)} was not written by texloom, or was changed since; give another place, or --force"

    def _foreign(self, path: str, is_folder: bool) -> str | None:
        """A file at ``path``, or a picture in that folder, that the store does not know as an export."""
        path = path.rstrip("/")
        known = self._known_states.get(path, {}).get("files", {})
        files = sorted(map(str, Path(path).rglob("*.*"))) if is_folder else [path]
        for file in files:
            of_file = known.get(file[len(path) + 1 :] if is_folder else "")
            is_left = of_file is not None and of_file == file_state(file)
            if not is_left and os.path.isfile(file) and not is_noted(self.run.store, file):  # noqa: PTH113
                return file
        return None

    @cached_property
    def _known_states(self) -> Mapping[str, Any]:
        """Path to the state of an export of a large set, as the last run left it."""
        return self.run.history().exports if self.run.has_many_items else {}

    def check_file(self, option: str, path: Path) -> None:
        """`InputError` where the file ``path`` cannot be written or would replace what the run reads."""
        check_folder(option, path.parent)
        if path.is_dir():
            raise InputError(one_line(f"{option} {path}: is a folder, not a file"))
        what = self.files_read.at(path)
        if what is not None:
            raise InputError(one_line(f"{option} {path}: would replace {what}; give another file"))

    @cached_property
    def files_read(self) -> FilesRead:
        """What nothing that is written may replace; found only where there is something to be replaced."""
        return FilesRead(self.run.flow, self.run.items)
