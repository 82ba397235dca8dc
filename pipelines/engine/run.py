"""A flow and its store: which steps are cached and why, what a step takes, what is exported. Runs nothing."""

from __future__ import annotations

import contextlib
import dataclasses
import hashlib
import os
import stat
import time
from collections.abc import Iterator, Mapping
from functools import cached_property
from pathlib import Path
from typing import Any, Literal, NoReturn

from texloom.pipelines.byte_size import format_byte_size
from texloom.pipelines.engine import user_cache
from texloom.pipelines.engine.code_digest import code_digest
from texloom.pipelines.engine.exports import Export, States, is_noted
from texloom.pipelines.engine.footprint import Footprint, expectation, footprint
from texloom.pipelines.engine.input_files import FilesRead
from texloom.pipelines.engine.keys import KeyParts, canonical_json, fixed_parts, key_parts
from texloom.pipelines.engine.scope import Scope, ScopeInputs, used_sources
from texloom.pipelines.engine.stage_log import logging_to
from texloom.pipelines.engine.task import Given, Output, TaskSpec, Upstream
from texloom.pipelines.errors import closest, format_error, one_line, refused
from texloom.pipelines.flow.command import command_of
from texloom.pipelines.flow.feeding import feeding
from texloom.pipelines.flow.items import Item, items_of
from texloom.pipelines.flow.model import Each, Flow, Reference, Step
from texloom.pipelines.flow.runner import check_environment, require_installed
from texloom.pipelines.media.delivery import SAME
from texloom.pipelines.media.known_files import KnownFiles
from texloom.pipelines.media.writers.registry import writer_of
from texloom.pipelines.store import run_log, usage
from texloom.pipelines.store.atomic import check_folder, free_space, make_new_folder, remove_abandoned, too_long
from texloom.pipelines.store.history import History, file_state
from texloom.pipelines.store.location import passed_over
from texloom.pipelines.store.ownership import keeps_no_key
from texloom.pipelines.store.run_log import LoggedRun
from texloom.pipelines.store.store import Artifact, BrokenArtifactError, Store
from texloom.pipelines.store.types import Hint
from texloom.stages.common.grids.working_size import reduction
from texloom.stages.vocabulary.arrays import Image
from texloom.stages.vocabulary.declare import InputError
from texloom.stages.vocabulary.sizes import format_size, size_value

State = Literal["cached", "run", "wait", "refused", "skipped"]

_MANY = 100  # items of a set whose files are not opened again
_CHOICE = "evaluation.choice"
_FILES = "files"
_MOST_FILES = 30_000  # 7 MB


@dataclasses.dataclass(frozen=True)
class StepPlan:
    """What would become of a step."""

    name: str
    stage: str
    state: State
    """``wait``: its inputs will be computed first; if they come out as before, it is cached after all.
    ``refused``: its item's files are wrong; ``skipped``: an optional source is not given"""
    reasons: tuple[str, ...]
    """why it is not cached, or skipped"""
    key: str | None
    """unknown while it waits; none of what is skipped"""
    item: str | None = None
    """the item of a set that it would run for"""


class StepFailedError(Exception):
    """A stage raised an exception, which is the cause of this one."""

    def __init__(self, step: str, cause: BaseException):
        super().__init__(step)
        self.step = step
        self.__cause__ = cause

    @property
    def reason(self) -> str:
        """The cause in words."""
        return format_error(self.__cause__)

    def __str__(self) -> str:
        return one_line(f"{self.step} failed: {self.reason}")


class Run:
    """One flow and its store; over a set, all its items."""

    def __init__(self, flow: Flow, store: Store):
        """Find the items, open the sources that they share and check what stages say of those.

        Raises
        ------
        InputError : a source or param is not usable, or the folder of the store is not this user's store.
        """
        store.check_owned()
        flow.check_sources()
        self.flow = flow
        self.store = store
        self.items = items_of(flow) if flow.is_set else []
        if flow.item is not None:
            self.items = [item for item in self.items if item.name == flow.item] or _no_item(flow, self.items)
        for item in self.items:
            if item.name in flow.exports and self._scope_of(flow.exports[item.name]) != "item":
                raise InputError(f"{flow.where('exports', item.name)}: an item and its folder have this name")
        self._known_files = _known_files() if len(self.items) >= _MANY else None
        self.shared = Scope(flow, store, known=self._known_files)
        self.scopes: dict[str, Scope | None] = {}
        """item to where its steps find what they take; none if its files are refused"""
        self._fixed: dict[str, tuple[str, Mapping[str, Any]]] = {}
        self._new_out: Path | None = None
        self._made_out: Path | None = None
        self.told: list[str] = []
        """what writers of exports have told, such as of values that a file cannot hold"""

    @property
    def notes(self) -> list[str]:
        """What there is to know of the store, and of the sources that are open by now."""
        return [*self.notes_before, *(note for scope in self.known_scopes for note in scope.notes)]

    @cached_property
    def store_notes(self) -> list[str]:
        """What there is to know of the store."""
        return [note for note in (passed_over(self.store.root), keeps_no_key()) if note is not None]

    @cached_property
    def notes_before(self) -> list[str]:
        """What there is to know before anything runs: of the store, and of what a large exemplar takes."""
        first = next(iter(self.flow.sources), None)
        for scope in self.sample_scopes():
            if first is None or not scope.has_source(first):
                continue
            exemplar = scope.source(first)
            is_large = exemplar.kind == "picture" and reduction(exemplar.height, exemplar.width) > 1
            if is_large and any(step.state in ("run", "wait") for step in self.plan()):
                return [*self.store_notes, expectation(self.flow.steps, scope, exemplar)]
        return self.store_notes

    @property
    def known_scopes(self) -> list[Scope]:
        """The shared scope and those of the items that are open by now."""
        return [self.shared, *(scope for scope in self.scopes.values() if scope is not None)]

    def sample_scopes(self) -> list[Scope]:
        """The same; of a set at least the first item's, whose sizes stand for those of all."""
        known = self.known_scopes
        if self.items and len(known) == 1:
            with contextlib.suppress(InputError):  # which is told when the item's turn comes
                known.append(Scope(self.flow, self.store, self.items[0], self.shared))
        return known

    def new_out(self) -> Path:
        """A name for a new folder of exports in the store, made when the first is written; see `out_folder`."""
        name = f"{self.flow.name}-{time.strftime('%Y%m%d-%H%M%S')}"
        self._new_out, self._made_out = self.store.root / "runs" / name, None
        return self._new_out

    def out_folder(self, out: Path) -> Path:
        """Where the exports for ``out`` are: elsewhere if it came from `new_out` and another run was first."""
        return self._made_out if out == self._new_out and self._made_out is not None else out

    def _ready_out(self, out: Path, reference: Reference, scope: Scope) -> Path:
        """`out_folder`, which no other run gets if it is the default one; ``reference`` is about to be written."""
        if out == self._new_out and self._made_out is None:
            self.store.hold()
            if reference.output is None:
                scope.decoded(scope.source(reference.name))  # a broken source is found before anything is written
            self.store.ready("runs")
            self._made_out = make_new_folder(out)
        return self.out_folder(out)

    def check(self, out: Path, force: bool = False) -> None:
        """`InputError` where it is known before a run with exports into the folder ``out`` that it would fail.

        Exports must be writable and replace nothing that the run reads, and unless ``force`` nothing but what the
        store's notes of exports know. Nothing is written.
        """
        require_installed(self.flow.runner)
        check_environment()
        self._check_store()
        check_folder("--out", out)
        self._check_footprint()
        for file, reference in self.flow.exports.items():
            is_folder, writer = file.endswith("/"), writer_of(file)
            is_set = self._scope_of(reference) == "item"
            for name in [f"{item.name}/{file}" for item in self.items] if is_set else [file]:
                problem = self._problem_with(f"{out}/{name}", is_folder, force)
                if problem is None and writer is not None and writer.companions:
                    companions = f"{out}/{name.removesuffix(writer.suffix)}{writer.companions}"
                    problem = self._problem_with(companions, True, force)
                if problem is not None:
                    raise InputError(one_line(f"--out {out}: {problem}"))
        self._check_tiles()

    def _check_tiles(self) -> None:
        """`InputError` where a result of a size that is known cannot be cut into equal UDIM tiles."""
        if self.flow.delivery.udim is None:
            return
        rows, columns = self.flow.delivery.udim
        for file, reference in self.flow.exports.items():
            step = self.flow.steps.get(reference.name) if file.endswith("/") else None
            size = getattr(step.params, "size", None) if step is not None else None
            if isinstance(size, tuple) and (size[0] % rows or size[1] % columns):
                tiles = size_value(self.flow.delivery.udim)
                raise InputError(
                    f"--udim: {format_size(size)} cannot be cut into {tiles} equal tiles; change --size"
                )

    def footprint(self) -> Footprint | None:
        """What a large result takes of memory and disk; none where none is large."""
        return footprint(self.flow.steps, self.sample_scopes())

    def _check_footprint(self) -> None:
        """`InputError` where memory or disk do not suffice for a large result, unless it is in the store."""
        taken = self.footprint()
        if taken is None or all(step.state == "cached" for step in self.plan()):
            return
        if taken.problem:
            raise InputError(taken.problem)
        free = free_space(self.store.root)
        if free < taken.disk:
            raise InputError(
                f"--store {self.store.root}: a result of this size {taken}; {format_byte_size(free)} are free there"
            )

    def _check_store(self) -> None:
        """`InputError` where the store cannot be written, unless every result is in it."""
        try:
            self.store.check_writable()
        except InputError:
            if any(step.state != "cached" for step in self.plan()):
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
            if not is_left and os.path.isfile(file) and not is_noted(self.store, file):  # noqa: PTH113
                return file
        return None

    @cached_property
    def _known_states(self) -> Mapping[str, Any]:
        """Path to the state of an export of a large set, as the last run left it."""
        return self.history().exports if self._known_files is not None else {}

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
        return FilesRead(self.flow, self.items)

    # -- planning

    def plan(self) -> list[StepPlan]:
        """What would happen, from the records alone."""
        earlier = self.history()
        plans = self._plan_scope(self.shared, "shared", earlier)
        for item in self.items:
            try:
                scope = Scope(self.flow, self.store, item, self.shared)
            except InputError as error:
                self.scopes[item.name] = None
                first = next(step for step in self.flow.steps.values() if step.scope == "item")
                plans.append(StepPlan(first.name, first.stage.name, "refused", (str(error),), None, item.name))
            else:
                self.scopes[item.name] = scope
                plans += self._plan_scope(scope, "item", earlier)
        return plans + self._plan_scope(self.shared, "final", earlier)

    def skipped(self) -> list[StepPlan]:
        """The steps that are left out of this run."""
        left_out = self.flow.skipped.items()
        return [StepPlan(name, one.stage.name, "skipped", (one.reason,), None) for name, one in left_out]

    def _plan_scope(self, scope: Scope, kind: str, earlier: History) -> list[StepPlan]:
        plans = []
        for step in (step for step in self.flow.steps.values() if step.scope == kind):
            waits = [name for name in self._awaited(step) if not self._is_known(name, scope)]
            parts = self.parts(step, scope)
            name = scope.label(step)
            reasons = _changes(parts, earlier.steps.get(name), set(waits))
            state: State = "run"
            if waits:
                state = "wait"
                reasons.append(f"waits for {', '.join(waits)}")
            else:
                artifact = self.known(step, parts, name, earlier)
                try:
                    artifact = artifact or self.find(step, parts)
                except BrokenArtifactError as error:
                    reasons = [f"broken: {error}"]
                if artifact is not None:
                    scope.artifacts[step.name] = artifact
                    state, reasons = "cached", []
                elif not reasons:
                    reasons = [
                        "its result is no longer in the store" if name in earlier.steps else "never run before"
                    ]
            key = None if waits else parts.key
            plans.append(StepPlan(step.name, step.stage.name, state, tuple(reasons), key, scope.name))
        return plans

    def _is_known(self, name: str, scope: Scope) -> bool:
        """Whether a step's result is in the store; for all items if it is theirs and ``scope`` the shared one."""
        if self.flow.steps[name].scope == "item" and scope.item is None:
            places = [place for place in self.scopes.values() if place is not None]
            return all(name in place.lost or place.artifact(name) is not None for place in places)
        return scope.artifact(name) is not None

    def choices(self) -> dict[str, dict[str, Any]]:
        """The tables of `evaluation.choice` by the labels of its steps, after a run."""
        steps = [step for step in self.flow.steps.values() if step.stage.name == _CHOICE]
        return {
            scope.label(step): self.store.table(artifact, "table")
            for step in steps
            for scope in self.known_scopes
            if (artifact := scope.artifacts.get(step.name)) is not None
        }

    def scores(self) -> dict[str, Any]:
        """The table of the flow's scores, after a run: of what it chose, if it did; empty over a set or without."""
        steps = list(self.flow.steps.values())
        measured = [step.name for step in steps if step.stage.name == "evaluation.metrics"]
        for step in steps:
            if step.stage.name == _CHOICE and step.name in self.shared.artifacts:
                table = self.store.table(self.shared.artifacts[step.name], "table")
                better = dict(step.params)["labels"].index(table["chosen"])
                measured.insert(0, step.inputs[("first_scores", "second_scores")[better]].name)
                break
        artifact = next((self.shared.artifacts[name] for name in measured if name in self.shared.artifacts), None)
        return {} if artifact is None else dict(self.store.table(artifact, "table"))

    def main_scores(self) -> dict[str, float]:
        """The summary of `scores` by name."""
        summary = self.scores().get("summary", {})
        return {name: value for name, value in summary.items() if isinstance(value, float)}

    # -- what the scheduler asks

    def history(self) -> History:
        """What the flow's last runs used."""
        return History(self.store, self.flow.name)

    def remember(self, history: History, exports: dict[str, Any]) -> None:
        """Keep what this run has used and the states of its exports by path, and log the run."""
        if self._known_files is not None and self._known_files.is_new:
            user_cache.save(_FILES, self._known_files.entries, _MOST_FILES)
        if history.used:
            for name in ("history", "log"):
                with contextlib.suppress(OSError), self.store.inside(name) as folder:
                    folder.remove_abandoned()  # left by a run that was killed here, after all else
            history.save(exports if self._known_files is not None else None)
            sources = self.source_references()
            run_log.write(self.store.root, LoggedRun(self.flow.name, sources, self.flow.seeds, history.used))

    def source_references(self) -> dict[str, str]:
        """Name to file or pattern of each source that is used; of several the first, and how many more."""
        used = used_sources(self.flow)
        sources = [(name, given) for name, given in self.flow.sources.items() if name in used]
        return {name: _reference(given) for name, given in sources}

    def in_order(self, exports: Mapping[str, Path]) -> dict[str, Path]:
        """Exports by item and then as the flow has them."""
        return {name: exports[name] for name in sorted(exports, key=self._position)}

    def _position(self, export: str) -> tuple[str, int]:
        item, _, file = export.removesuffix("/").rpartition("/")
        return item, list(self.flow.exports).index(file + "/" * export.endswith("/"))

    def is_lost(self, step: Step, scope: Scope) -> bool:
        """Whether a step cannot be computed, as what it takes is lost; then it is too."""
        reasons = [scope.lost[name] for name in step.needs if name in scope.lost]
        gathered = [one for given in step.gather.values() for one in _references(given)]
        if gathered and not any(place for one in gathered for place in self._places(one)):
            reasons.append(f"{step.name}: no item has come so far")
        if reasons:
            scope.lost[step.name] = reasons[0]
        return bool(reasons)

    def _places(self, reference: Reference) -> list[Scope | None]:
        """For each item where what is gathered is found, if it has it."""
        scopes = (self.scopes[item.name] for item in self.items)
        return [scope if scope is not None and self._has(reference, scope) else None for scope in scopes]

    def _has(self, reference: Reference, scope: Scope) -> bool:
        makers = self._makers(reference)
        return not makers or any(scope.artifact(name) for name in makers)

    def _makers(self, reference: Reference) -> list[str]:
        """The steps of which an item must have a result if it is to have what is gathered.

        Of a source those that take it, any of them: where all have failed, it may be what cannot be read.
        """
        if reference.output is not None:
            return [reference.name]
        steps = self.flow.steps.values()
        return [step.name for step in steps if step.scope == "item" and reference in step.inputs.values()]

    def _awaited(self, step: Step) -> list[str]:
        """The steps that must have ended before it is known what a step takes."""
        gathered = {
            name for given in step.gather.values() for one in _references(given) for name in self._makers(one)
        }
        return sorted({*step.needs, *gathered})

    def exports_of(self, kind: str) -> dict[str, Reference]:
        """The exports of a kind of scope."""
        return {file: given for file, given in self.flow.exports.items() if self._scope_of(given) == kind}

    def export(
        self, scope: Scope, kind: str, out: Path, inputs: ScopeInputs, history: History, states: dict[str, Any]
    ) -> dict[str, Path]:
        """Write those exports of a scope that are not there yet, an item's into a folder of its name.

        The states of all files are added to ``states``, by path.

        Returns
        -------
        export name to file.
        """
        written = {}
        prefix = "" if scope.name is None else f"{scope.name}/"
        for file, reference in self.exports_of(kind).items():
            if reference.name in scope.lost or (kind == "item" and not self._has(reference, scope)):
                continue
            like = self.flow.likes.get(file)
            source = None if like is None else scope.source(like)
            if file in self.flow.of_maps and (source is None or not source.maps):
                continue
            if file.endswith("/") and self.flow.delivery.layout == SAME and (source is None or not source.maps):
                raise refused("--layout: same needs an exemplar that is a folder or YAML file of maps")
            surface = self.flow.surfaces.get(file)
            export = Export(
                path=self._ready_out(out, reference, scope) / (prefix + file),
                is_folder=file.endswith("/"),
                origin=self._origin(reference, scope),
                about=self._about(file, reference, scope),
                like=() if source is None else source.maps,
                delivery=self.flow.delivery,
                material=self._material(like, scope) if self.flow.delivery.layout else "",
                bits=self._bits(file, reference, scope),
                mesh="" if surface is None else self._origin(surface, scope),
            )
            place = str(export.path)
            known = history.exports.get(place) if self._known_files is not None else None
            state = export.current(self.store, known)
            if state is None:
                state = self._write(export, reference, surface, scope, inputs)
            inputs.release([reference])
            if state is None:
                self.told.append(f"{file}: not written, as there is no {reference} here")
                continue
            states[place] = state
            written[prefix + file] = export.path
        return written

    def _write(
        self, export: Export, reference: Reference, surface: Reference | None, scope: Scope, inputs: ScopeInputs
    ) -> States | None:
        """Write an export that is not there yet; the states of its files, None where the step gave nothing."""
        hint: Any = Image
        provenance = dict(export.about)
        if reference.output is not None:
            hint = self.flow.steps[reference.name].stage.outputs[reference.output]
            known = self.store.provenance(_found(scope.artifact(reference.name)))
            # without times, so that equal results are equal files; inputs may have other names than then
            left_out = ("created", "seconds", "from")
            provenance |= {key: value for key, value in known.items() if key not in left_out}
        self.store.hold()
        remove_abandoned(export.path.parent)
        told: list[str] = []
        with self.store.scratch(), logging_to(__name__, told.append):
            mesh = None if surface is None else inputs.value(self._given(surface, scope))
            value = inputs.value(self._given(reference, scope))
            if value is None and Hint.of(hint).optional:
                return None
            state = export.write(self.store, value, hint, provenance, mesh)
        shows = self._shows(export.path.name, reference)  # what shows a result, as a preview does, may clip
        self.told += [] if shows else [f"{export.path.name}: {note}" for note in told]
        if export.path.is_relative_to(self.store.root):
            usage.add(self.store, export.path)
        return state

    def _material(self, like: str | None, scope: Scope) -> str:
        """The name of a material: that of the picture which it is like, or of the first one."""
        from texloom.pipelines.media.writers.layouts import material_name

        name = like if like is not None else next((one for one in self.flow.sources if scope.has_source(one)), None)
        return material_name(self.flow.name if name is None else scope.source(name).picture)

    def _shows(self, file: str, reference: Reference) -> bool:
        """Whether an export is a picture that is made to be looked at."""
        step = self.flow.steps.get(reference.name) if reference.output is not None else None
        if step is None or not step.stage.name.startswith("evaluation.") or file.startswith("texture."):
            return False
        return step.stage.outputs[reference.output or ""] is Image

    def _bits(self, file: str, reference: Reference, scope: Scope) -> dict[str, int]:
        """For each map the most bits of the sources that feed it; none of what is made to be looked at."""
        if self._shows(file, reference):
            return {}
        bits: dict[str, int] = {}
        for name in feeding(self.flow, reference):
            scopes = [scope] if scope.has_source(name) else self.known_scopes  # of what is gathered, all
            for one in (one.source(name) for one in scopes if one.has_source(name)):
                bits |= {role: max(own, bits.get(role, 8)) for role, own in one.map_bits.items()}
        return bits

    def _about(self, file: str, reference: Reference, scope: Scope) -> dict[str, Any]:
        """What this run adds to the provenance of an export."""
        about: dict[str, Any] = {"flow": self.flow.name, "output": str(reference), "seed": scope.seed}
        if reference.output is not None:
            step = self.flow.steps[reference.name]
            about["from"] = {name: self._given(given, scope).label for name, given in step.inputs.items()}
        if file.endswith((".exr", "/")):
            about["bits"] = self._bits(file, reference, scope)  # so that PNGs made from it one day have as many
        if file.endswith(".html"):
            about["run"] = self._facts(scope)
        return about

    def _facts(self, scope: Scope) -> dict[str, str]:
        """What a page says of this run, see `texloom.stages.vocabulary.arrays.Page`."""
        sources = list(scope.sources.values())
        name = scope.name or (self.flow.name if self.flow.is_set or not sources else sources[0].picture)
        about = [self.flow.name, *(source.label for source in sources)]
        if scope.item is not None or len(self.flow.seeds) == 1:
            about.append(f"seed {scope.seed}")
        return {
            "title": f"{name} · {self.flow.name}" if name != self.flow.name else name,
            "name": name,
            "about": " · ".join(about),
            "command": command_of(self.flow, scope.item),
        }

    def _origin(self, reference: Reference, scope: Scope) -> str:
        """A digest by which one can tell whether an export would come out as before."""
        if reference.output is None:
            return scope.source(reference.name).digest
        return _found(scope.artifact(reference.name)).manifest

    def _scope_of(self, reference: Reference) -> str:
        if reference.output is not None:
            return self.flow.steps[reference.name].scope
        return "item" if isinstance(self.flow.sources[reference.name], Each) else "shared"

    def checked(self, step: Step, label: str, parts: KeyParts, record: Mapping[str, Any]) -> Artifact:
        """The artifact of a record; if it is not whole the record is removed, with a `BrokenArtifactError`."""
        try:
            return _whole(step, self.store.check_record(record, parts.stage, parts.key))
        except BrokenArtifactError as error:
            self.store.forget(parts.stage, parts.key)
            raise BrokenArtifactError(f"{label}: the stored result is broken ({error})", parts.key) from None

    def known(self, step: Step, parts: KeyParts, label: str, history: History) -> Artifact | None:
        """The result of a step of a large set, if it is as the last run left it."""
        if self._known_files is None:
            return None
        artifact = history.find(label, parts.as_dict())
        if artifact is None:
            return None
        parts.known_as(artifact.key)
        return _whole(step, artifact)

    def find(self, step: Step, parts: KeyParts) -> Artifact | None:
        """The result of a step, if the store has it; `BrokenArtifactError` if it is not whole."""
        artifact = self.store.find(parts.stage, parts.key)
        return None if artifact is None else _whole(step, artifact)

    # -- tasks

    def task(self, step: Step, parts: KeyParts, scope: Scope) -> TaskSpec:
        """All that it takes to compute a step whose inputs are there."""
        stage = step.stage

        def gathered(reference: Reference | Mapping[str, Reference]) -> Any:
            if isinstance(reference, Reference):
                places = self._places(reference)
                return [None if place is None else self._given(reference, place) for place in places]
            return {tag: gathered(listed) for tag, listed in reference.items()}

        return TaskSpec(
            flow=self.flow.name,
            step=step.name,
            label=scope.label(step),
            parts=parts,
            params=step.params.model_dump(mode="json"),
            seed=scope.seed,
            draws_as=step.draws_as,
            inputs={name: self._given(reference, scope) for name, reference in step.inputs.items()},
            gather={name: gathered(reference) for name, reference in step.gather.items()},
            items=[item.described() for item in self.items] if stage.uses_items else None,
            upstream=list(self._upstream(step, scope)) if stage.uses_provenance else None,
        )

    def _given(self, reference: Reference, scope: Scope) -> Given:
        if reference.output is None:
            return scope.source(reference.name)
        artifact = _found(scope.artifact(reference.name))
        digest = artifact.outputs[reference.output]
        return Output(reference.name, artifact.stage, artifact.key, reference.output, digest)

    def _upstream(self, step: Step, scope: Scope) -> Iterator[Upstream]:
        """Everything that a step's result comes from, in the order of the flow."""
        upstream = {step.name}
        for name in reversed(list(self.flow.steps)):  # each comes after what it takes
            if name in upstream:
                upstream.update(self.flow.steps[name].needs)
        for name, other in self.flow.steps.items():
            if name in upstream and name != step.name:
                theirs = other.scope == "item" and scope.item is None
                for place in self.scopes.values() if theirs else [scope]:
                    artifact = None if place is None else place.artifact(name)
                    if place is not None and artifact is not None:
                        item = place.name if other.scope == "item" else None
                        yield Upstream(name, item, artifact.stage, artifact.key)

    # -- keys

    def parts(self, step: Step, scope: Scope) -> KeyParts:
        """What the key is made of, as far as it is known by now."""
        digests = {name: self._digest(reference, scope) for name, reference in step.inputs.items()}
        known = {name: digest for name, digest in digests.items() if digest is not None}
        for name, gathered in step.gather.items():
            makers = [maker for reference in _references(gathered) for maker in self._makers(reference)]
            if all(self._is_known(maker, scope) for maker in makers):
                known[name] = self._gathered_digest(gathered)
        if step.stage.uses_items:
            known["items"] = _digest_of([item.described() for item in self.items])
        return key_parts(step, scope.seed, known, self._fixed_parts(step))

    def _fixed_parts(self, step: Step) -> tuple[str, Mapping[str, Any]]:
        """What the keys of all items have in common, see `fixed_parts`."""
        if step.name not in self._fixed:
            self._fixed[step.name] = fixed_parts(step)
        return self._fixed[step.name]

    def _digest(self, reference: Reference, scope: Scope) -> str | None:
        """Content digest of an input, if it is known by now."""
        if reference.output is None:
            return scope.source(reference.name).digest
        artifact = scope.artifact(reference.name)
        return None if artifact is None else artifact.outputs[reference.output]

    def _gathered_digest(self, gathered: Reference | Mapping[str, Reference]) -> str:
        def digests(reference: Reference) -> list[str | None]:
            return [None if place is None else self._digest(reference, place) for place in self._places(reference)]

        if isinstance(gathered, Reference):
            return _digest_of(digests(gathered))
        return _digest_of([[tag, digests(reference)] for tag, reference in gathered.items()])


def _known_files() -> KnownFiles:
    return KnownFiles(user_cache.load(_FILES), code_digest("texloom.pipelines.media.locate"))


def _no_item(flow: Flow, items: list[Item]) -> NoReturn:
    near = closest(flow.item or "", [item.name for item in items])
    raise InputError(one_line(f"--item {flow.item}: {flow.name} has no such item{near}"))


def _reference(given: str | Each) -> str:
    if isinstance(given, str):
        return given
    first, *others = given.patterns
    return f"{first} and {len(others)} more" if others else first


def _whole(step: Step, artifact: Artifact) -> Artifact:
    """The artifact, if it has what the stage returns."""
    lacking = [name for name in step.stage.outputs if name not in artifact.outputs]
    if lacking:
        raise BrokenArtifactError(f"it lacks {', '.join(lacking)}")
    return artifact


def _references(gathered: Reference | Mapping[str, Reference]) -> list[Reference]:
    return [gathered] if isinstance(gathered, Reference) else list(gathered.values())


def _digest_of(value: Any) -> str:
    return hashlib.sha256(canonical_json(value).encode()).hexdigest()


def _found(artifact: Artifact | None) -> Artifact:
    if artifact is None:
        raise RuntimeError("a step was asked for its result before it ran")
    return artifact


def _changes(parts: KeyParts, earlier: Mapping[str, Any] | None, waits: set[str]) -> list[str]:
    if earlier is None:
        return []
    unknown = {name for name in earlier.get("inputs", {}) if name not in parts.inputs} if waits else set()
    known = {name: digest for name, digest in earlier.get("inputs", {}).items() if name not in unknown}
    return parts.differences({**earlier, "inputs": known})
