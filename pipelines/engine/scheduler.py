"""The scheduler: which steps can be computed now, on which executor, and what becomes of their results.

Only steps whose result is not in the store become tasks, and only when all that they take is there, so that their
keys are known. An executor computes tasks: one at a time in the calling thread, or several on the workers of
`texloom.pipelines.engine.pool`, `texloom.pipelines.engine.dask_cluster` or `texloom.pipelines.engine.prefect`.
"""

from __future__ import annotations

import contextlib
import contextvars
import dataclasses
import functools
import os
import queue
import threading
import time
from collections import Counter
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Any, Protocol, TypeVar

from texloom.pipelines.engine.events import (
    Event,
    ItemReport,
    Listener,
    Note,
    RunStarted,
    State,
    StepReport,
    StepStarted,
)
from texloom.pipelines.engine.exporter import Exporter
from texloom.pipelines.engine.keys import KeyParts
from texloom.pipelines.engine.run import Run, StepFailedError
from texloom.pipelines.engine.scope import Scope, ScopeInputs
from texloom.pipelines.engine.task import TaskSpec, run_task
from texloom.pipelines.flow.model import Step
from texloom.pipelines.interruption import interruption_of
from texloom.pipelines.media.sources import SourceError
from texloom.pipelines.store.keep import keep_record
from texloom.pipelines.store.store import Artifact, BrokenArtifactError, BrokenStoreError, Store
from texloom.stages.kernels.core.threads import thread_count
from texloom.stages.vocabulary.declare import InputError
from texloom.stages.vocabulary.interruption import Interruption

T = TypeVar("T")

MAX_RESTARTS = 5
"""how often a run is restarted because of one result that turns out to be broken"""

_MAX_LOST = 3  # workers that may die with a task: another one may have been at fault, or the memory that all need


@dataclasses.dataclass(frozen=True)
class Outcome:
    """What became of a task: the record of its result, or the exception that prevented it."""

    record: Mapping[str, Any] | None = None
    """see `texloom.pipelines.store.store.Artifact.record`"""
    seconds: float | None = None
    """none if the result was in the store by then"""
    error: BaseException | None = None
    is_lost: bool = False
    """with its worker; the task may succeed on another one"""


@dataclasses.dataclass
class InFlight:
    """A task that is being computed, and the steps that wait for its key."""

    spec: TaskSpec
    wanted: list[tuple[ScopeRun, Step]]
    is_cached: bool
    """whether its result was in the store at submission"""
    threads: int = 0
    lost: int = 0
    """how many workers have died with it; from the second on it is computed alone, with all the memory"""
    is_beside: bool = False
    """whether another one of the same process is submitted right after it"""
    tell: Callable[[Event], None] = lambda _: None
    """receives its notes and progress, from any thread"""
    end: Callable[[Outcome], None] = lambda _: None
    """receives its outcome, from any thread"""

    @property
    def step(self) -> Step:
        """The step that it computes."""
        return self.wanted[0][1]

    @property
    def inputs(self) -> ScopeInputs:
        """What it takes, for executors in this process."""
        return self.wanted[0][0].inputs

    def interrupt(self) -> None:
        """Let it end at its next report, if it is computed on a thread of this process."""
        self.tell = _interrupt

    def tell_started(self) -> None:
        """Tell that its step begins; executors call this when they have accepted the task."""
        if not self.is_cached:
            self.tell(StepStarted(self.spec.label))


def _interrupt(_: Event) -> None:
    raise Interruption


class Executor(Protocol):
    """Computes tasks."""

    def slots(self) -> int:
        """How many tasks it computes at a time."""

    def ahead(self) -> int:
        """How many more it takes meanwhile, so that its workers need not wait for the scheduler."""

    def submit(self, task: InFlight) -> None:
        """Compute a task now or later and call its ``end``.

        Raises
        ------
        InputError : there are no workers.
        """

    def stop(self, at_once: bool) -> None:
        """Release the workers; ``at_once``: whatever they are doing."""


class InlineExecutor:
    """Computes tasks in the calling thread, without Prefect, with the records and locks of Prefect's tasks.

    Of two that are submitted together, one is computed on another thread meanwhile. Each uses all processors, as
    what they do on one alone is what takes time.
    """

    def __init__(self, store: Store, slots: int = 1):
        """``slots``: at most 2."""
        self.store = store
        self._slots = slots
        self._beside: list[tuple[threading.Thread, InFlight]] = []

    def slots(self) -> int:
        """See `Executor`."""
        return self._slots

    def ahead(self) -> int:
        """See `Executor`."""
        return 0

    def submit(self, task: InFlight) -> None:
        """See `Executor`."""
        if not task.is_beside:
            self._compute(task)
            return
        thread = threading.Thread(target=contextvars.copy_context().run, args=(self._compute_beside, task))
        self._beside = [(other, theirs) for other, theirs in self._beside if other.is_alive()]
        self._beside.append((thread, task))
        thread.start()

    def _compute_beside(self, task: InFlight) -> None:
        with contextlib.suppress(Interruption):  # of `InFlight.interrupt`
            self._compute(task)

    def _compute(self, task: InFlight) -> None:
        def listener(event: Event) -> None:
            task.tell(event)  # which may change meanwhile, see `InFlight.interrupt`

        began = time.perf_counter()
        record, is_new, error = None, True, None
        try:
            task.inputs.scope.values()  # a broken source is found before anything is told or written
            task.tell_started()
            self.store.create()
            work = functools.partial(run_task, task.spec, task.step.stage, task.inputs, None, listener)
            parts = task.spec.parts
            record, is_new = keep_record(self.store, parts.stage, parts.key, work)
        except Exception as raised:
            interruption = interruption_of(raised)
            if interruption is not None:
                raise interruption from None
            error = raised
        task.end(Outcome(record, time.perf_counter() - began if is_new else None, error))

    def stop(self, at_once: bool) -> None:
        """See `Executor`."""
        for thread, task in self._beside:
            if at_once:
                task.interrupt()
            if thread.is_alive():
                thread.join()


def execute(
    run: Run,
    listener: Listener,
    out: Path,
    start: Callable[[], Executor] | None = None,
    submit_cached: bool = False,
) -> dict[str, Path]:
    """Run what is not cached and write the exports into the folder ``out``; export name to file.

    With a Prefect server at ``PREFECT_API_URL`` this is a flow run there, whatever the runner.

    Over a set, the exports of an item go into a folder of its name. What fails there is reported to the listener
    and stops neither other items nor those steps of its own that do not depend on it.

    A task that is lost with its worker is submitted again, from the second time on when no other one is in flight;
    what is lost again and again has failed. When a result turns out to be broken, its record is removed and the run
    restarted.

    Parameters
    ----------
    start : makes the executor when the first task is submitted; by default that of the flow's runner.
    submit_cached : also submit the steps whose result is in the store, so that the executor can show them.

    Raises
    ------
    StepFailedError : a stage raised an exception.
    InputError : a stage or source refused what it was given, or there are no workers or no server.
    BrokenStoreError : a result is broken each time that it has been computed again.
    """
    if start is None:
        held = _HeldEvents(listener)
        held(_run_started(run))
        try:
            exports = _execute_as_chosen(run, held, out)
        except InputError:
            raise
        except BaseException:
            held.release()
            raise
        held.release()
        return exports
    return _execute(run, listener, out, start, submit_cached)


def _execute_as_chosen(run: Run, listener: Listener, out: Path) -> dict[str, Path]:
    """Run as a flow run, if there is a Prefect server, else on the executor of the flow's runner."""
    if os.environ.get("PREFECT_API_URL"):
        from texloom.pipelines.engine.prefect.flow_run import execute_as_flow_run

        return execute_as_flow_run(run, listener, out)
    return _execute(run, listener, out, lambda: _executor_of(run), submit_cached=False)


def _execute(
    run: Run, listener: Listener, out: Path, start: Callable[[], Executor], submit_cached: bool
) -> dict[str, Path]:
    executor = functools.cache(start)
    restarts: Counter[str] = Counter()
    at_once = True
    try:
        while True:
            try:
                with run.store.used_by_run() as lease:
                    exports = _Attempt(run, executor, listener, out, submit_cached).exports()
                    if lease.is_taken:
                        _tidy(run.store, listener)
                at_once = False
                return exports
            except BrokenArtifactError as error:
                restarts[error.key] += 1
                if restarts[error.key] > MAX_RESTARTS:
                    raise BrokenStoreError(
                        f"{error}, again and again, though it was computed {MAX_RESTARTS} times; "
                        f"is the disk of --store {run.store.root} sound, and does no other program write there?"
                    ) from None
                listener(Note(f"{error}; computing it again"))
    finally:
        if executor.cache_info().currsize:
            executor().stop(at_once)


class _HeldEvents:
    """A listener that passes nothing on until a run is accepted, so that of a refused one only the error is told.

    A run is accepted when its first step begins to compute or its first item has ended, and when it ends in any way
    but by an `InputError`.
    """

    def __init__(self, listener: Listener):
        self._listener = listener
        self._held: list[Event] | None = []

    def __call__(self, event: Event) -> None:
        if self._held is None:
            self._listener(event)
            return
        self._held.append(event)
        if isinstance(event, StepStarted | ItemReport):
            self.release()

    def release(self) -> None:
        """Pass on what has been held, and all that follows."""
        held, self._held = self._held or [], None
        for event in held:
            self._listener(event)


def _tidy(store: Store, listener: Listener) -> None:
    """Remove what killed runs have left, and keep the store within its limit."""
    from texloom.pipelines.store import housekeeping

    with contextlib.suppress(OSError):
        housekeeping.tidy(store)
        housekeeping.keep_limit(store, measure=False)
        problem = housekeeping.foreign_limit(store)
        if problem is not None:
            listener(Note(problem))


def _run_started(run: Run) -> RunStarted:
    flow = run.flow
    step, _, param = flow.params.get("size", ("",))[0].partition(".")
    size = getattr(flow.steps[step].params, param, None) if step in flow.steps else None
    return RunStarted(
        flow=flow.name,
        sources=run.source_references(),
        size=size if isinstance(size, tuple) else None,
        seeds=flow.seeds,
        store=run.store.root,
        steps=tuple(flow.steps),
        items=len(run.items),
    )


def _executor_of(run: Run) -> Executor:
    """The executor of the flow's runner."""
    if not run.flow.runner.has_workers:
        from texloom.pipelines.engine.workers import worker_count

        is_set = bool(run.items)  # whose items follow one another, each with all that there is
        return InlineExecutor(run.store, 1 if is_set or thread_count() == 1 else min(2, worker_count(run)))
    if run.flow.runner.name == "dask":
        from texloom.pipelines.engine.dask_cluster import DaskExecutor

        return DaskExecutor(run)
    from texloom.pipelines.engine.pool import PoolExecutor

    return PoolExecutor(run)


class ScopeRun:
    """The steps of one scope, in the order of the flow as far as their inputs allow."""

    def __init__(self, run: Run, scope: Scope, kind: str):
        self.scope = scope
        self.kind = kind
        self.problem: Exception | None = None
        """why the run fails; items fail by themselves, see `texloom.pipelines.engine.scope.Scope.lost`"""
        self._run = run
        self._waiting = {name: step for name, step in run.flow.steps.items() if step.scope == kind}
        self._running: dict[str, Step] = {}
        uses = [reference for step in self._waiting.values() for reference in step.inputs.values()]
        if kind != "shared" or not run.items:  # shared exports of a set are written after all items
            uses += run.exports_of(kind).values()
        self.inputs = ScopeInputs(run.store, scope, (given for given in uses if given.output is not None))

    def next(self) -> Step | None:
        """A step that can be computed now."""
        for name, step in list(self._waiting.items()):
            if self.problem is not None:
                break
            if any(needed in self._waiting or needed in self._running for needed in step.needs):
                continue
            del self._waiting[name]
            if not self._run.is_lost(step, self.scope):
                self._running[name] = step
                return step
            self.inputs.release(step.inputs.values())
        return None

    def end(self, step: Step, result: Artifact | Exception) -> None:
        """Go on with the steps that take the result, or without it; what all items share must be there."""
        del self._running[step.name]
        self.inputs.release(step.inputs.values())
        if isinstance(result, Artifact):
            self.scope.artifacts[step.name] = result
        elif self.scope.item is None:
            self.problem = result
        else:
            self.scope.lost[step.name] = str(result)

    @property
    def is_over(self) -> bool:
        """Whether all steps have ended, or no more can be computed."""
        return not self._running and (self.problem is not None or not self._waiting)


class _Attempt:
    """A run up to its end, or to the first broken result."""

    def __init__(
        self, run: Run, executor: Callable[[], Executor], listener: Listener, out: Path, submit_cached: bool
    ):
        self.run, self.executor, self.listener = run, executor, listener
        self.submit_cached = submit_cached
        self.history = run.history()
        self.written: dict[str, Path] = {}
        self.exporter = Exporter(run, out, self.history)
        self.in_flight: dict[str, InFlight] = {}
        self.again: list[InFlight] = []
        """tasks that have lost a worker"""
        self.alone: list[InFlight] = []
        """tasks that have lost several"""
        self.broken: BrokenArtifactError | None = None
        self.thread = threading.get_ident()
        self.messages: queue.SimpleQueue[Callable[[], None]] = queue.SimpleQueue()
        self.ended_items = 0

    def exports(self) -> dict[str, Path]:
        """Run what is not cached, and write the exports."""
        run = self.run
        run.shared.lost.clear()
        for note in run.notes_before:
            self.listener(Note(note))
        self._tell_notes(run.shared)
        shared = ScopeRun(run, run.shared, "shared")
        try:
            self._complete(iter([shared]))
            self._complete(self._items())
            final = ScopeRun(run, run.shared, "final")
            self._complete(iter([final]))
            for scope_run in (shared, final):
                self._export(run.shared, scope_run)
        finally:
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
        while True:
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
        if artifact is not None and not self.submit_cached:
            self._end_step(scope_run, step, parts, artifact, "cached", 0.0)
            return None
        return InFlight(run.task(step, parts, scope), [(scope_run, step)], artifact is not None)

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

    def _on_result(self, task: InFlight, outcome: Outcome) -> None:
        del self.in_flight[task.spec.parts.key]
        if outcome.is_lost and task.lost < _MAX_LOST:
            self.listener(Note(f"{task.spec.label}: {outcome.error}; computing it again"))
            lost = dataclasses.replace(task, lost=task.lost + 1, threads=0)
            (self.alone if task.lost else self.again).append(lost)
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
        for scope_run, step in task.wanted:
            self._end_step(scope_run, step, task.spec.parts, result, state, seconds)
            state, seconds = "failed" if state == "failed" else "cached", 0.0  # for those that waited for it

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
        scope_run.end(step, result)
        if isinstance(result, Artifact):
            self.history.add(scope_run.scope.label(step), parts.as_dict(), result, state == "ran")
        if not isinstance(result, SourceError):  # then the source is at fault, which the problem of the run says
            self.listener(StepReport(step.name, step.stage.name, parts.key, state, seconds, scope_run.scope.name))

    def _end(self, scope_run: ScopeRun) -> None:
        """An item is done, as far as it could be; the run has failed if a step that all items share has."""
        scope = scope_run.scope
        if scope.name is None:
            if scope_run.problem is not None:
                raise scope_run.problem
            return
        try:
            self._export(scope, scope_run)
        except BrokenArtifactError as error:
            self.broken = error
            return
        scope.forget_values()
        self._end_item(scope.name, scope.problem)

    def _export(self, scope: Scope, scope_run: ScopeRun) -> None:
        self.written |= self.exporter.export(scope, scope_run.kind, scope_run.inputs)
        for note in self.exporter.told:
            self.listener(Note(note, is_warning=True))
        self.exporter.told.clear()

    def _end_item(self, name: str, problem: str | None) -> None:
        self.ended_items += 1
        self.listener(ItemReport(name, self.ended_items, len(self.run.items), problem))
