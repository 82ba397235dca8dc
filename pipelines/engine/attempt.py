"""Attempts at a run: which steps can be computed now, on which executor, and what becomes of their results.

A result that turns out to be broken is computed again, in another attempt. Only steps whose result is not in the
store become tasks, and only when all that they take is there, so that their keys are known.
"""

from __future__ import annotations

import contextlib
import dataclasses
import functools
import queue
import re
import threading
import time
from collections import Counter
from collections.abc import Callable, Collection, Iterator
from pathlib import Path
from typing import TypeVar

from texloom.pipelines.byte_size import format_byte_size
from texloom.pipelines.engine.chosen_steps import may_refuse
from texloom.pipelines.engine.events import Event, ItemReport, Listener, Note, Shared, State, StepReport, warning_of
from texloom.pipelines.engine.executors.executor import Executor, Outcome, StepTask
from texloom.pipelines.engine.executors.executor_choice import executor_of
from texloom.pipelines.engine.exporter import Exporter
from texloom.pipelines.engine.keys import KeyParts
from texloom.pipelines.engine.run import Run, StepFailedError
from texloom.pipelines.engine.scope import Scope
from texloom.pipelines.engine.scope_run import ScopeRun
from texloom.pipelines.errors import UnreachableError, is_unreachable
from texloom.pipelines.flow.model import Step
from texloom.pipelines.media.sources import SourceError
from texloom.pipelines.store.codec import ArtifactError
from texloom.pipelines.store.remote import remote_at
from texloom.pipelines.store.result_files import BrokenArtifactError
from texloom.pipelines.store.store import Artifact, BrokenStoreError, Store
from texloom.stages.kernels.core.threads import thread_count
from texloom.stages.vocabulary.declare import InputError

T = TypeVar("T")

MAX_RESTARTS = 5
"""how often a run is restarted because of one result that turns out to be broken"""
_MAX_WAITS = 5  # for a store that does not answer
_PATIENCE = 300.0  # seconds of each wait
_MAX_LOST = 3  # workers that may die with a task: another one may have been at fault, or the memory that all need


def compute(
    run: Run, listener: Listener, out: Path, start: Callable[[Run], Executor] = executor_of
) -> dict[str, Path]:
    """Run what is not cached and write the exports into the folder ``out``, without a server; export name to file.

    Over a set, the exports of an item go into a folder of its name. What fails there is reported to the listener
    and stops neither other items nor those steps of its own that do not depend on it.

    A task that is lost with its worker is submitted again, from the second time on when no other one is in flight;
    what is lost again and again has failed. When a result turns out to be broken, its record is removed and the run
    restarted; so it is when the store did not answer for a while, as a mount does not.

    Parameters
    ----------
    start : makes the executor when the first task is submitted; by default that of the flow's runner.

    Raises
    ------
    StepFailedError : a stage raised an exception.
    InputError : a stage or source refused what it was given, or there are no workers or no server.
    BrokenStoreError : a result is broken each time that it has been computed again.
    OSError : the disk of the store is full, or does not answer.
    """
    executor = functools.cache(functools.partial(start, run))
    restarts: Counter[str] = Counter()
    at_once, waits = True, 0
    try:
        while True:
            try:
                with run.store.used_by_run() as lease:
                    exports = Attempt(run, executor, listener, out, waits < _MAX_WAITS).exports()
                    if lease.is_taken:
                        _tidy(run.store, listener)
                at_once = False
                return exports
            except LeftOutError:
                run.plan()  # tells which are
            except BrokenArtifactError as error:
                run.wanted = None
                restarts[error.key] += 1
                run.store.distrusted.add(error.key)
                if restarts[error.key] > MAX_RESTARTS:
                    raise BrokenStoreError(
                        f"{error}, again and again, though it was computed {MAX_RESTARTS} times; "
                        f"is the disk of --store {run.store.root} sound, and does no other program write there?"
                    ) from None
                listener(Note(f"{error}; computing it again"))
            except OSError as error:
                waits += 1
                if waits > _MAX_WAITS or not (is_unreachable(error) or not run.store.is_there()):
                    raise
                _wait(run.store, error, 2.0**waits / 2, listener)
    finally:
        if executor.cache_info().currsize:
            executor().stop(at_once)


def _wait(store: Store, error: OSError, seconds: float, listener: Listener) -> None:
    """Wait so long, and until the store answers; `UnreachableError` if it does not for `_PATIENCE` seconds."""
    problem = str(error) if isinstance(error, UnreachableError) else f"--store {store.root}: {error}"
    listener(Note(f"{problem}; waiting for it", is_warning=True))
    deadline = time.monotonic() + _PATIENCE
    time.sleep(seconds)
    while True:
        try:
            return store.check_there()
        except UnreachableError:
            if time.monotonic() > deadline:
                raise
        time.sleep(1)


def _tidy(store: Store, listener: Listener) -> None:
    """Remove what killed runs have left, and keep the store within its limit."""
    from texloom.pipelines.store import housekeeping

    with contextlib.suppress(OSError):
        housekeeping.tidy(store)
        housekeeping.keep_limit(store, measure=False)
        problem = housekeeping.foreign_limit(store)
        if problem is not None:
            listener(Note(problem))


class LeftOutError(Exception):
    """A result has no files any more, and it is not known yet whether it is to be computed again."""


@dataclasses.dataclass
class InFlight(StepTask):
    """A task that is being computed, and the steps that wait for its key."""

    wanted: list[tuple[ScopeRun, Step]] = dataclasses.field(default_factory=list)
    lost: int = 0
    """how many workers have died with it; from the second on it is computed alone, with all the memory"""

    @property
    def step(self) -> Step:
        """The step that it computes."""
        return self.wanted[0][1]


class Attempt:
    """A run up to its end, or to the first broken result."""

    def __init__(
        self, run: Run, executor: Callable[[], Executor], listener: Listener, out: Path, is_patient: bool = True
    ):
        """``executor``: asked for when there is something to compute.

        ``is_patient``: end where a disk does not answer, as it may later; else the item fails for which that is so.
        """
        self.run, self.executor, self.listener, self.is_patient = run, executor, listener, is_patient
        self.history = run.history()
        self.written: dict[str, Path] = {}
        self.exporter = Exporter(run, out, self.history)
        self.in_flight: dict[str, InFlight] = {}
        self.again: list[InFlight] = []
        """tasks that have lost a worker"""
        self.alone: list[InFlight] = []
        """tasks that have lost several"""
        self.broken: BrokenArtifactError | LeftOutError | OSError | None = None
        """why it ends: a result turns out to be broken or left out, or the store does not answer"""
        self.thread = threading.get_ident()
        self.messages: queue.SimpleQueue[Callable[[], None]] = queue.SimpleQueue()
        self.ended_items = 0

    def exports(self) -> dict[str, Path]:
        """Run what is not cached, and write the exports."""
        run = self.run
        run.shared.lost.clear()
        run.shared.passed_over.clear()
        for note in run.notes_before:
            self.listener(Note(note))
        run.shared.artifacts.clear()  # those of a plan may be in the shared store alone
        self._tell_notes(run.shared)
        shared = ScopeRun(run, run.shared, "shared")
        try:
            self._complete(iter([shared]))
            self._complete(self._items())
            final = ScopeRun(run, run.shared, "final")
            self._complete(iter([final]))
            for scope_run in (shared, final):
                self._export(run.shared, scope_run)
            for scope_run in (shared, final):
                self._leave_out(scope_run)
            self._tell_left_out()
        finally:
            if not isinstance(self.broken, LeftOutError):  # else the next attempt needs the history of the last run
                run.remember(self.history, self.exporter.states)
        return run.in_order(self.written)

    def _items(self) -> Iterator[ScopeRun]:
        for item in self.run.items:
            self.run.scopes[item.name] = None
            try:
                self.run.scopes[item.name] = scope = Scope(self.run.flow, self.run.store, item, self.run.shared)
            except InputError as error:
                self._end_item(item.name, str(error))
            else:
                self._tell_notes(scope)
                yield ScopeRun(self.run, scope, "item")

    def _tell_notes(self, scope: Scope) -> None:
        for note in scope.notes:
            self.listener(Note(note))

    # -- what can be computed

    def _complete(self, scope_runs: Iterator[ScopeRun]) -> None:
        """Compute all steps of all scopes."""
        active: list[ScopeRun] = []
        while self._submit(self._chosen(active, scope_runs)) or self.in_flight:
            if self.in_flight:
                self.messages.get()()
        if self.broken is not None:
            raise self.broken

    def _chosen(self, active: list[ScopeRun], scope_runs: Iterator[ScopeRun]) -> list[InFlight]:
        """The tasks to submit now."""
        if self.alone:
            return [] if self.in_flight else [self._begun(self.alone.pop(0))]
        chosen: list[InFlight] = []
        while self.broken is None and (not self.in_flight or len(self.in_flight) < self._most()):
            task = self.again.pop(0) if self.again else self._next(active, scope_runs)
            if task is None:
                break
            chosen.append(self._begun(task))
        return chosen

    def _most(self) -> int:
        """How many tasks may be in flight."""
        return self.executor().slots() + self.executor().ahead()

    def _begun(self, task: InFlight) -> InFlight:
        """The task, which counts as in flight."""
        self.in_flight[task.spec.parts.key] = task
        return task

    def _next(self, active: list[ScopeRun], scope_runs: Iterator[ScopeRun]) -> InFlight | None:
        """The first task of the scopes that have begun, or of the next ones."""
        while self.broken is None:
            for scope_run in list(active):
                while (step := scope_run.next()) is not None:
                    task = self._look_up(scope_run, step)
                    if task is not None:
                        return task
                if scope_run.is_over:
                    active.remove(scope_run)
                    self._end(scope_run)
            begun = next(scope_runs, None)
            if begun is None:
                return None
            active.append(begun)
        return None

    def _look_up(self, scope_run: ScopeRun, step: Step) -> InFlight | None:
        """A task for a step whose result is neither in the store nor being computed."""
        run, scope = self.run, scope_run.scope
        parts = run.parts(step, scope)
        artifact = run.known(step, parts, scope.label(step), self.history)
        if artifact is None and parts.key in self.in_flight:
            self.in_flight[parts.key].wanted.append((scope_run, step))
            return None
        try:
            artifact = artifact or run.find(step, parts)
        except BrokenArtifactError as error:
            self.listener(Note(f"{scope.label(step)}: the stored result is broken ({error}); computing it again"))
        except UnreachableError as error:
            self.broken = error
            return None
        if artifact is not None and artifact.left_out:
            if run.wanted is None:
                self.broken = LeftOutError()
                return None
            if parts.key in run.wanted:
                artifact = None
        if artifact is not None:
            self._warn_again(scope.label(step), artifact)
            self._end_step(scope_run, step, parts, artifact, "cached", 0.0)
            return None
        return InFlight(run.task(step, parts, scope), step.stage, scope_run.inputs, wanted=[(scope_run, step)])

    def _submit(self, tasks: list[InFlight]) -> bool:
        """Submit tasks, which share the processors that others do not use; whether there were any."""
        before = [task.threads for task in self.in_flight.values() if task.threads]
        slots = self.executor().slots() if len(self.in_flight) > 1 else 1
        free = min(slots - len(before), len(tasks))  # of which tasks can begin now
        for index, task in enumerate(tasks):
            begins = index < free
            task.threads = max(1, (thread_count() - sum(before)) // free if begins else thread_count() // slots)
        for task in tasks:
            task.tell = functools.partial(self._post, functools.partial(self._on_report, task))
            task.end = functools.partial(self._post, functools.partial(self._on_result, task))
            task.is_beside = task is not tasks[0]
        for task in [*tasks[1:], *tasks[:1]]:
            self.executor().submit(task)
        return bool(tasks)

    def _post(self, receive: Callable[[T], None], message: T) -> None:
        """Deliver a message in the thread of the scheduler."""
        if threading.get_ident() == self.thread:
            receive(message)
        else:
            self.messages.put(functools.partial(receive, message))

    # -- what has become of it

    def _on_report(self, task: InFlight, event: Event) -> None:
        """Pass on what a task tells; workers' reports may arrive after its end."""
        if self.in_flight.get(task.spec.parts.key) is task:
            self.listener(event)
            if isinstance(event, Shared):
                self._tell_failure(event, task.spec.label)

    def _tell_failure(self, shared: Shared, label: str) -> None:
        """Tell what is wrong with the shared store, once that it does not answer."""
        if shared.refusal:
            self.listener(Note(f"{label}: {shared.refusal}; computing it", is_warning=True))
        if shared.outage and not shared.is_known:
            remote_at(self.run.store.remote).rest(shared.outage)  # so that no worker has to find it out by itself
        if shared.outage and not self.run.lacks_shared_store:
            self.run.lacks_shared_store = True
            self.listener(Note(f"shared store: {shared.outage}; the run goes on without it", is_warning=True))

    def _on_result(self, task: InFlight, outcome: Outcome) -> None:
        del self.in_flight[task.spec.parts.key]
        if outcome.is_lost and task.lost < _MAX_LOST:
            self.listener(Note(f"{task.spec.label}: {outcome.error}; computing it again"))
            lost = dataclasses.replace(task, lost=task.lost + 1, threads=0)
            (self.alone if task.lost else self.again).append(lost)
            return
        if outcome.error is not None and (gone := self._gone(outcome.error)) is not None:
            self.broken = gone
            return
        try:
            result = self._result(task, outcome)
        except BrokenArtifactError as error:
            self.broken = error
            return
        if outcome.seconds is not None and isinstance(result, Artifact):
            self.run.store.drop_checkpoints(result.stage, result.key)
        state: State = "failed" if isinstance(result, Exception) else "cached" if outcome.seconds is None else "ran"
        seconds = outcome.seconds or 0.0
        if state == "cached" and isinstance(result, Artifact):
            self._warn_again(task.spec.label, result)
        for scope_run, step in task.wanted:
            self._end_step(scope_run, step, task.spec.parts, result, state, seconds)
            state, seconds = "failed" if state == "failed" else "cached", 0.0  # for those that waited for it

    def _gone(self, error: BaseException) -> OSError | None:
        """The error of a store that does not answer, if that may have been why a task failed."""
        try:
            self.run.store.check_there()
        except UnreachableError as gone:
            return gone
        return error if self.is_patient and isinstance(error, OSError) and is_unreachable(error) else None

    def _warn_again(self, label: str, artifact: Artifact) -> None:
        """Tell what a step warned of when it was computed, which holds for its result whenever it is used."""
        for text in artifact.warnings:
            self.listener(warning_of(text, label))

    def _result(self, task: InFlight, outcome: Outcome) -> Artifact | Exception:
        """The artifact, or why there is none; `BrokenArtifactError` if it or what the task takes is broken."""
        error = outcome.error
        if outcome.record is not None:
            return self.run.checked(task.step, task.spec.label, task.spec.parts, outcome.record)
        if isinstance(error, BrokenArtifactError):
            raise error
        if isinstance(error, SourceError):  # the message names the source
            return error
        if isinstance(error, InputError):
            return InputError(f"{self.run.flow.where('steps', task.step.name)}: {error}")
        return StepFailedError(task.step.name, error or RuntimeError("no result"))

    def _end_step(
        self,
        scope_run: ScopeRun,
        step: Step,
        parts: KeyParts,
        result: Artifact | Exception,
        state: State,
        seconds: float,
    ) -> None:
        is_refusal = isinstance(result, InputError) and not isinstance(result, SourceError)
        if is_refusal and may_refuse(step, self.run.flow.steps.values(), scope_run.scope, self.run.store):
            scope_run.pass_over(step, str(result))
            self.listener(Note(f"{scope_run.scope.label(step)} is passed over: {result}"))
            return
        scope_run.end(step, result)
        if isinstance(result, Artifact):
            self.history.add(scope_run.scope.label(step), parts.as_dict(), result, state == "ran")
        if not isinstance(result, SourceError):  # then the source is at fault, which the problem of the run says
            item, problem = scope_run.scope.name, str(result) if isinstance(result, Exception) else None
            details = result.details if isinstance(result, StepFailedError) else ""
            self.listener(StepReport(step.name, step.stage.name, parts.key, state, seconds, item, problem, details))

    def _end(self, scope_run: ScopeRun) -> None:
        """An item is done, as far as it could be; the run has failed if a step that all items share has."""
        scope = scope_run.scope
        if scope.name is None:
            if scope_run.problem is not None:
                self._export_named(scope_run.problem, scope_run)
                raise scope_run.problem
            return
        try:
            self._export(scope, scope_run)
        except (BrokenArtifactError, OSError) as error:
            self.broken = error if isinstance(error, BrokenArtifactError) else self._gone(error)
            if self.broken is None:
                raise
            return
        scope.forget_values()
        self._leave_out(scope_run)
        self._end_item(scope.name, scope.problem)

    def _export_named(self, problem: Exception, scope_run: ScopeRun) -> None:
        """Write the exports that a refusal tells to look at, as far as the steps before it made them."""
        scope, out, store = scope_run.scope, self.exporter.out, self.run.store.root
        if isinstance(problem, SourceError) or self.run.items or out.absolute().is_relative_to(store.absolute()):
            return
        exports = self.run.exports_of(scope_run.kind).items()
        made = [file for file, reference in exports if reference.name in scope.artifacts]
        named = [file for file in made if re.search(rf"\b{re.escape(file)}", str(problem))]
        with contextlib.suppress(ArtifactError, OSError):  # the problem matters more
            self._export(scope, scope_run, named)
        if self.written:
            written = self.run.in_order(self.written)
            self.listener(Note(f"written for a look: {', '.join(written)}; {out}", exports=written))

    def _export(self, scope: Scope, scope_run: ScopeRun, files: Collection[str] | None = None) -> None:
        self.written |= self.exporter.export(scope, scope_run.kind, scope_run.inputs, files)
        for note in self.exporter.told:
            self.listener(Note(note, is_warning=True))
        self.exporter.told.clear()

    def _leave_out(self, scope_run: ScopeRun) -> None:
        """Remove from the store the intermediate results of a scope that is done, if they are not to be kept."""
        scope, run = scope_run.scope, self.run
        for name in run.flow.intermediate:
            artifact, step = scope.artifacts.get(name), run.flow.steps[name]
            if step.scope != scope_run.kind or artifact is None or artifact.left_out:
                continue
            left = run.store.leave_out(artifact, self.history.now)
            if left is not None:
                scope.artifacts[name] = left
                self.history.replace(scope.label(step), left)
                run.left_out[left.key] = left.left_out

    def _tell_left_out(self) -> None:
        if self.run.left_out:
            count, size = len(self.run.left_out), format_byte_size(sum(self.run.left_out.values()))
            results = f"{count} intermediate result{'s' * (count > 1)}"
            self.listener(Note(f"keep: final: {results} left out of the store, {size}"))

    def _end_item(self, name: str, problem: str | None) -> None:
        self.ended_items += 1
        self.listener(ItemReport(name, self.ended_items, len(self.run.items), problem))
