"""The executor on threads of this process or processes of this machine, without Prefect, whose tasks take longer to
start than most steps to compute. Records and locks are those of Prefect's tasks.

`compute` is the body of a task on any worker, also those of Prefect's task runners.
"""

from __future__ import annotations

import contextvars
import dataclasses
import functools
import itertools
import socket
import time
import traceback
from collections.abc import Callable, Mapping
from concurrent.futures import Future, ThreadPoolExecutor
from pathlib import Path
from typing import Any, NamedTuple

from texloom.pipelines.engine import signals
from texloom.pipelines.engine.events import Event, Listener, Note, StepProgress
from texloom.pipelines.engine.processes import ProcessPool, WorkerDiedError
from texloom.pipelines.engine.run import Run
from texloom.pipelines.engine.scheduler import InFlight, Outcome
from texloom.pipelines.engine.task import Inputs, TaskSpec, check_same, run_task
from texloom.pipelines.engine.worker_progress import Channel, DaskReceiver, DatagramReceiver, ProgressSender
from texloom.pipelines.engine.workers import worker_count
from texloom.pipelines.errors import format_error, is_resource_error, one_line
from texloom.pipelines.media.sources import SourceError
from texloom.pipelines.store.keep import keep_record
from texloom.pipelines.store.store import BrokenArtifactError, Store
from texloom.stages.kernels.core.threads import thread_count
from texloom.stages.lookup.registry import find_stage
from texloom.stages.vocabulary.declare import InputError
from texloom.stages.vocabulary.progress import Progress


class WorkerError(Exception):
    """What a stage raised on a worker."""

    def __init__(self, problem: str, details: str):
        super().__init__(problem, details)
        self.problem = problem
        self.details = details

    def __repr__(self) -> str:
        return self.problem

    def __str__(self) -> str:
        return self.details.rstrip()


@dataclasses.dataclass(frozen=True)
class Payload:
    """What travels to a worker: text and numbers."""

    number: int
    """of the task in this process, see `in_flight`"""
    spec: str
    """see `TaskSpec.to_json`; empty for threads of this process"""
    store: str
    threads: int | Mapping[str, int]
    """for this step alone; or, for each machine, how many steps share it"""
    channel: dict[str, Any] | None = None
    """where progress is reported, see `Channel`; none for threads of this process"""
    identity: str = ""
    """of the store, if its path may mean another folder on the worker, which then compares them"""


numbers = itertools.count()
"""of tasks in this process"""
in_flight: dict[int, InFlight] = {}
"""the tasks that have been submitted and have not ended"""


class PoolExecutor:
    """See `texloom.pipelines.engine.scheduler.Executor`."""

    def __init__(self, run: Run):
        """The workers are started with the first task."""
        self.store = run.store
        self.in_process = run.flow.runner.name == "threads"
        self.workers = run.flow.runner.workers or worker_count(run)
        self._pool: ThreadPoolExecutor | ProcessPool | None = None
        self._receiver: DatagramReceiver | None = None
        """of the progress of other processes"""

    def slots(self) -> int:
        """See `texloom.pipelines.engine.scheduler.Executor`."""
        return self.workers

    def ahead(self) -> int:
        """See `texloom.pipelines.engine.scheduler.Executor`; what threads take is kept in memory."""
        return 0 if self.in_process else self.workers

    def submit(self, task: InFlight) -> None:
        """See `texloom.pipelines.engine.scheduler.Executor`."""
        with signals.deferred():
            payload = hand_over(task, self.store, self._start, self._pool is None, self.in_process)
            if payload is None:
                return
            number = payload.number
            work: Callable[..., Any] = compute_once
            if self.in_process:
                work = functools.partial(contextvars.copy_context().run, work)
            assert self._pool is not None
            future = self._pool.submit(work, payload)
            future.add_done_callback(functools.partial(_end, task, number))

    def stop(self, at_once: bool) -> None:
        """See `texloom.pipelines.engine.scheduler.Executor`."""
        if at_once and isinstance(self._pool, ProcessPool):
            self._pool.kill()
        elif at_once:
            interrupt_threads()
        with signals.deferred():
            if isinstance(self._pool, ProcessPool):
                self._pool.close()
            elif self._pool is not None:
                self._pool.shutdown(cancel_futures=True)
            if self._receiver is not None:
                self._receiver.close()
            self._pool, self._receiver = None, None

    def _start(self) -> Workers:
        if self._pool is None:
            self.store.create()
            if self.in_process:
                self._pool = ThreadPoolExecutor(self.workers)
            else:
                self._pool = ProcessPool(self.workers)
                self._receiver = DatagramReceiver(tell_progress)
        return Workers(self._receiver)


def _end(task: InFlight, number: int, future: Future[dict[str, Any]]) -> None:
    """Tell what has become of a task, unless `PoolExecutor.stop` has cancelled it: nobody waits for it then."""
    in_flight.pop(number, None)
    if not future.cancelled():
        task.end(_outcome(future, task))


def _outcome(future: Future[dict[str, Any]], task: InFlight) -> Outcome:
    try:
        return outcome_of(future.result(), task)
    except WorkerDiedError:
        return lost()
    except BaseException as error:
        return failed(error)


def outcome_of(answer: Mapping[str, Any], task: InFlight) -> Outcome:
    """What has become of a task, from what `compute` returned."""
    for note in answer.get("notes", ()):
        task.tell(Note(**note))
    return Outcome(answer["record"], answer.get("seconds"))


def failed(error: BaseException) -> Outcome:
    """What has become of a task that raised an exception."""
    if type(error).__name__ == "KilledWorker":  # Dask has tried several
        return Outcome(error=OSError("its workers were killed, one after the other"))
    known = isinstance(error, (InputError, BrokenArtifactError, WorkerError)) or is_resource_error(error)
    return Outcome(error=error if known else WorkerError(repr(error), ""))


def lost() -> Outcome:
    """What has become of a task whose process ended before it."""
    return Outcome(error=OSError("its worker was killed"), is_lost=True)


class Workers(NamedTuple):
    """What the tasks for some workers have in common."""

    receiver: DatagramReceiver | DaskReceiver | None
    """of their progress; none for threads of this process"""
    hosts: Mapping[str, int] = {}
    """how many steps share each machine, where those are not of this one"""


def hand_over(
    task: InFlight,
    store: Store,
    start: Callable[[], Workers],
    is_first: bool,
    in_process: bool,
) -> Payload | None:
    """Begin a task: what travels to a worker; None if the task has ended with what is wrong with its sources.

    Parameters
    ----------
    start : starts the workers, if they are not. What they write is in the store that it has created.
    is_first : the sources have to be checked, before anything is written.
    in_process : the workers are threads of this process.
    """
    if is_first:
        scope = task.inputs.scope
        try:
            scope.values()
        except Exception as error:
            task.end(Outcome(error=error))
            return None
        if not in_process:  # the workers decode them
            scope.forget_values()
    workers = start()
    task.tell_started()
    number = next(numbers)
    in_flight[number] = task
    return Payload(
        number=number,
        spec="" if in_process else task.spec.to_json(),
        store=str(store.root),
        threads=workers.hosts or task.threads,
        channel=None if workers.receiver is None else dataclasses.asdict(workers.receiver.channel),
    )


def interrupt_threads() -> None:
    """End what threads of this process are doing at their next report."""
    for task in list(in_flight.values()):
        task.interrupt()


def compute_once(payload: Payload) -> dict[str, Any]:
    """`compute` a task unless its result is in the store; like that, but without ``seconds`` then."""
    task = in_flight.get(payload.number) if not payload.spec else None
    parts = (task.spec if task is not None else TaskSpec.from_json(payload.spec)).parts
    answer: dict[str, Any] = {}

    def work() -> dict[str, Any]:
        answer.update(compute(payload))
        return dict(answer["record"])

    store = Store(Path(payload.store))
    if payload.identity:
        store.check_identity(payload.identity)
    record, _ = keep_record(store, parts.stage, parts.key, work)
    return {**answer, "record": record}


def compute(given: Payload, also: Listener | None = None) -> dict[str, Any]:
    """The body of each task, on whatever worker: plain data in and out, and exceptions that can be pickled.

    Parameters
    ----------
    also : receives the events of the step on the worker itself.
    """
    task = in_flight.get(given.number) if not given.spec else None
    inputs: Inputs
    notes: list[dict[str, Any]] = []
    began = time.perf_counter()
    try:
        if task is not None:
            task.inputs.scope.values()  # a broken source is found before anything is written
            spec, stage, inputs = task.spec, task.step.stage, task.inputs
        else:
            spec, inputs = TaskSpec.from_json(given.spec), Inputs(Store(Path(given.store)))
            check_same(spec)
            stage = find_stage(spec.parts.stage)
        sender = None if given.channel is None else ProgressSender(Channel(**given.channel), given.number)

        def listener(event: Event) -> None:
            if also is not None:
                also(event)
            if sender is not None and isinstance(event, StepProgress):
                sender(event.progress)
            if task is not None:
                task.tell(event)
            elif isinstance(event, Note):
                notes.append(dataclasses.asdict(event))

        record = run_task(spec, stage, inputs, _threads(given.threads), listener)
    except BrokenArtifactError:
        raise
    except InputError as error:
        where = "" if isinstance(given.threads, int) else f" (on {socket.gethostname()})"
        raise (SourceError if isinstance(error, SourceError) else InputError)(f"{error}{where}") from None
    except Exception as error:
        problem = one_line(format_error(error))
        raise (
            OSError(problem) if is_resource_error(error) else WorkerError(problem, traceback.format_exc())
        ) from None
    return {"record": record, "seconds": time.perf_counter() - began, "notes": notes}


def tell_progress(number: int, progress: Progress) -> None:
    """Pass on what a worker reports of a task, unless that has ended."""
    task = in_flight.get(number)
    if task is not None:
        task.tell(StepProgress(task.spec.label, progress))


def _threads(given: int | Mapping[str, int]) -> int:
    if isinstance(given, int):
        return given
    return max(1, thread_count() // given.get(socket.gethostname(), 1))
