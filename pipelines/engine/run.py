"""A flow and its store: which steps are cached and why, what a step takes, what is exported. Runs nothing."""

from __future__ import annotations

import contextlib
import dataclasses
import hashlib
import time
import traceback
from collections.abc import Callable, Iterable, Iterator, Mapping
from functools import cached_property
from pathlib import Path
from typing import Any, Literal, NoReturn, TypeVar

from texloom.pipelines.engine import user_cache
from texloom.pipelines.engine.chosen_steps import present
from texloom.pipelines.engine.code_digest import code_digest
from texloom.pipelines.engine.footprint import Footprint, expectation, footprint
from texloom.pipelines.engine.keys import KeyParts, canonical_json, fixed_parts, key_parts
from texloom.pipelines.engine.left_out import wanted_again
from texloom.pipelines.engine.scope import Scope, used_sources
from texloom.pipelines.engine.task_spec import Given, Output, TaskSpec, Upstream
from texloom.pipelines.errors import closest, format_error, is_resource_error, one_line
from texloom.pipelines.flow.items import Item, items_of
from texloom.pipelines.flow.model import Each, Flow, Reference, Step
from texloom.pipelines.media.known_files import KnownFiles
from texloom.pipelines.store import run_log
from texloom.pipelines.store.atomic import make_new_folder
from texloom.pipelines.store.history import History
from texloom.pipelines.store.location import passed_over
from texloom.pipelines.store.ownership import keeps_no_key
from texloom.pipelines.store.result_files import BrokenArtifactError
from texloom.pipelines.store.run_log import LoggedRun
from texloom.pipelines.store.store import Artifact, Store
from texloom.stages.common.grids.working_size import reduction
from texloom.stages.vocabulary.declare import InputError

State = Literal["cached", "fetch", "run", "wait", "refused", "skipped"]

T = TypeVar("T")

_MANY = 100  # items of a set whose files are not opened again
_FILES = "files"
_MOST_FILES = 30_000  # 7 MB
_ASKED_AT_ONCE = 16  # items of which a plan asks the shared store


@dataclasses.dataclass(frozen=True)
class StepPlan:
    """What would become of a step."""

    name: str
    stage: str
    state: State
    """``fetch``: the shared store has its result; ``wait``: its inputs will be computed first; if they come out as
    before, it is cached after all.
    ``refused``: its item's files are wrong; ``skipped``: an optional source is not given"""
    reasons: tuple[str, ...]
    """why it is not cached, or skipped"""
    key: str | None
    """unknown while it waits; none of what is skipped"""
    item: str | None = None
    """the item of a set that it would run for"""
    fetched: int = 0
    """bytes that would come from the shared store"""


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

    @property
    def details(self) -> str:
        """The traceback of the cause; empty where a disk, file or memory failed."""
        cause = self.__cause__
        return "" if cause is None or is_resource_error(cause) else "".join(traceback.format_exception(cause))


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
            if item.name in flow.exports and self.scope_of(flow.exports[item.name]) != "item":
                raise InputError(f"{flow.where('exports', item.name)}: an item and its folder have this name")
        self._known_files = _known_files() if len(self.items) >= _MANY else None
        self.shared = Scope(flow, store, known=self._known_files)
        self.scopes: dict[str, Scope | None] = {}
        """item to where its steps find what they take; none if its files are refused"""
        self.shows_scales = False
        """whether what steps report comes with a picture of each scale"""
        self.wanted: dict[str, str] | None = None
        """key of each result that was left out and is to be computed again to what takes it, by the last plan"""
        self.left_out: dict[str, int] = {}
        """keys of the results whose files this run has left out of the store, and their bytes"""
        self.lacks_shared_store = False
        """whether the shared store has not answered, which is told once"""
        self.outage = ""
        """why a plan was made without the shared store, in words; empty where that was asked, or there is none"""
        self._fixed: dict[str, tuple[str, Mapping[str, Any]]] = {}
        self._new_out: Path | None = None
        self._made_out: Path | None = None

    @property
    def notes(self) -> list[str]:
        """What there is to know of the store, and of the sources that are open by now."""
        return [*self.notes_before, *(note for scope in self.known_scopes for note in scope.notes)]

    @property
    def has_many_items(self) -> bool:
        """Whether it has so many items that what the last run left is not opened again."""
        return self._known_files is not None

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
            if is_large and any(step.state in ("run", "wait") for step in self.first_plan):
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

    def ready_out(self, out: Path, reference: Reference, scope: Scope) -> Path:
        """`out_folder`, which no other run gets if it is the default one; ``reference`` is about to be written."""
        if out == self._new_out and self._made_out is None:
            self.store.hold()
            if reference.output is None:
                scope.decoded(scope.source(reference.name))  # a broken source is found before anything is written
            self.store.ready("runs")
            self._made_out = make_new_folder(out)
        return self.out_folder(out)

    def footprint(self) -> Footprint | None:
        """What a large result takes of memory and disk; none where none is large."""
        return footprint(self.flow.steps, self.sample_scopes())

    # -- planning

    def plan(self) -> list[StepPlan]:
        """What would happen, from the records alone, those of the shared store too."""
        earlier = self.history()
        self.outage = ""
        self.shared.passed_over.clear()
        plans = self._plan_scope(self.shared, "shared", earlier)
        refused: dict[str, str] = {}
        for item in self.items:
            try:
                self.scopes[item.name] = Scope(self.flow, self.store, item, self.shared)
            except InputError as error:
                self.scopes[item.name], refused[item.name] = None, str(error)

        def of_item(item: Item) -> list[StepPlan]:
            scope = self.scopes[item.name]
            if scope is not None:
                return self._plan_scope(scope, "item", earlier)
            first = next(step for step in self.flow.steps.values() if step.scope == "item")
            return [StepPlan(first.name, first.stage.name, "refused", (refused[item.name],), None, item.name)]

        for planned in self._for_each_item(of_item):
            plans += planned
        plans += self._plan_scope(self.shared, "final", earlier)
        self.wanted = wanted_again(self.flow, self.shared, self.known_scopes[1:], self.exports_of)
        return [
            dataclasses.replace(plan, state="run", reasons=(f"was left out, and {self.wanted[plan.key]} takes it",))
            if plan.key in self.wanted and plan.state == "cached"
            else plan
            for plan in plans
        ]

    def _for_each_item(self, plan: Callable[[Item], T]) -> Iterable[T]:
        """What a function returns for each item, for several at a time where each waits for the shared store."""
        if not self.store.remote or len(self.items) < 2:
            return map(plan, self.items)
        from concurrent.futures import ThreadPoolExecutor

        with ThreadPoolExecutor(_ASKED_AT_ONCE) as pool:
            return pool.map(plan, self.items)

    @cached_property
    def first_plan(self) -> list[StepPlan]:
        """The plan as it was first made, for all that is to be known before anything runs."""
        return self.plan()

    def skipped(self) -> list[StepPlan]:
        """The steps that are left out of this run, those that were not chosen among them."""
        left_out = self.flow.skipped.items()
        return [
            *(StepPlan(name, one.stage.name, "skipped", (one.reason,), None) for name, one in left_out),
            *(
                StepPlan(name, self.flow.steps[name].stage.name, "skipped", (reason,), None, scope.name)
                for scope in self.known_scopes
                for name, reason in scope.passed_over.items()
            ),
        ]

    def _plan_scope(self, scope: Scope, kind: str, earlier: History) -> list[StepPlan]:
        plans = []
        for declared in (step for step in self.flow.steps.values() if step.scope == kind):
            step = present(declared, scope, self.store)
            if step is None:
                continue
            waits = [name for name in self._awaited(step) if not self._is_known(name, scope)]
            parts = self.parts(step, scope)
            name, fetched = scope.label(step), 0
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
                elif (there := self._in_shared_store(step, parts, reasons)) is not None:
                    scope.artifacts[step.name], fetched = there
                    state, reasons = "fetch", []
                elif not reasons:
                    reasons = [
                        "its result is no longer in the store" if name in earlier.steps else "never run before"
                    ]
            key = None if waits else parts.key
            plans.append(StepPlan(step.name, step.stage.name, state, tuple(reasons), key, scope.name, fetched))
        return plans

    def _in_shared_store(self, step: Step, parts: KeyParts, reasons: list[str]) -> tuple[Artifact, int] | None:
        """What the shared store has of a step, and its bytes; why it is refused is added to the reasons."""
        if not self.store.remote:
            return None
        from texloom.pipelines.store.exchange import exchange_of

        exchange = found(exchange_of(self.store, parts.stage, parts.key))
        choices = {other.chosen.name for other in self.flow.steps.values() if other.chosen is not None}
        there = exchange.look(self.store, with_tables=step.name in choices)
        self.outage = self.outage or exchange.outage
        reasons += [exchange.refusal] if exchange.refusal else []
        return there

    def _is_known(self, name: str, scope: Scope) -> bool:
        """Whether a step's result is in the store; for all items if it is theirs and ``scope`` the shared one."""
        if self.flow.steps[name].scope == "item" and scope.item is None:
            places = [place for place in self.scopes.values() if place is not None]
            ended = [{*place.lost, *place.passed_over} for place in places]
            return all(
                name in gone or place.artifact(name) is not None for place, gone in zip(places, ended, strict=True)
            )
        return scope.artifact(name) is not None or scope.why_passed_over(name) is not None

    # -- what the scheduler asks

    def history(self) -> History:
        """What the flow's last runs used."""
        return History(self.store, self.flow.name)

    def remember(self, history: History, exports: dict[str, Any]) -> None:
        """Keep what this run has used and the states of its exports by path, and log the run."""
        if self._known_files is not None and self._known_files.is_new:
            user_cache.save(_FILES, self._known_files.entries, _MOST_FILES)
        if history.used and self.store.is_there():
            for name in ("history", "log"):
                with contextlib.suppress(OSError), self.store.inside(name) as folder:
                    folder.remove_abandoned()  # left by a run that was killed here, after all else
            history.save(exports if self.has_many_items else None)
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
        return [scope if scope is not None and self.has(reference, scope) else None for scope in scopes]

    def has(self, reference: Reference, scope: Scope) -> bool:
        """Whether there is what is gathered or exported."""
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
        return {file: given for file, given in self.flow.exports.items() if self.scope_of(given) == kind}

    def scope_of(self, reference: Reference) -> str:
        """The scope of what a reference names."""
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
        if not self.has_many_items:
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
                return [None if place is None else self.given(reference, place) for place in places]
            return {tag: gathered(listed) for tag, listed in reference.items()}

        return TaskSpec(
            flow=self.flow.name,
            step=step.name,
            label=scope.label(step),
            parts=parts,
            params=step.params.model_dump(mode="json"),
            seed=scope.seed,
            draws_as=step.draws_as,
            inputs={name: self.given(reference, scope) for name, reference in step.inputs.items()},
            gather={name: gathered(reference) for name, reference in step.gather.items()},
            items=[item.described() for item in self.items] if stage.uses_items else None,
            upstream=list(self._upstream(step, scope)) if stage.uses_provenance else None,
            shows_scales=self.shows_scales,
        )

    def given(self, reference: Reference, scope: Scope) -> Given:
        """What a reference names, for a task or an export."""
        if reference.output is None:
            return scope.source(reference.name)
        artifact = found(scope.artifact(reference.name))
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


def found(one: T | None) -> T:
    """A step that has run, or its artifact."""
    if one is None:
        raise RuntimeError("a step was asked for its result before it ran")
    return one


def _changes(parts: KeyParts, earlier: Mapping[str, Any] | None, waits: set[str]) -> list[str]:
    if earlier is None:
        return []
    unknown = {name for name in earlier.get("inputs", {}) if name not in parts.inputs} if waits else set()
    known = {name: digest for name, digest in earlier.get("inputs", {}).items() if name not in unknown}
    return parts.differences({**earlier, "inputs": known})
