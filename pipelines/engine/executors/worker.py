"""What a worker does, in another process or on another machine: whether it can work for a run, and its tasks."""

from __future__ import annotations

import dataclasses
import socket
import time
import traceback
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from texloom.pipelines.engine.events import Event, Listener, Note, Shared, StepProgress, StepStarted
from texloom.pipelines.engine.executors.executor import Outcome, StepTask
from texloom.pipelines.engine.task_spec import Inputs, TaskSpec, check_same, run_task
from texloom.pipelines.errors import UnreachableError, format_error, is_resource_error, is_unreachable, one_line
from texloom.pipelines.media.sources import SourceError
from texloom.pipelines.store.atomic import probe_folder
from texloom.pipelines.store.exchange import exchange_of
from texloom.pipelines.store.keep import keep_record
from texloom.pipelines.store.remote import remote_at
from texloom.pipelines.store.result_files import BrokenArtifactError, program_version
from texloom.pipelines.store.store import Store
from texloom.stages.kernels.core.threads import thread_count
from texloom.stages.lookup.registry import find_stage
from texloom.stages.vocabulary.declare import InputError

PROBE = "probe"
"""the lock that a run holds while it asks workers whether it keeps them out"""
_SECONDS = 0.25  # between two reports of a step


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

    spec: str
    """see `TaskSpec.to_json`"""
    store: str
    threads: int | Mapping[str, int]
    """for this step alone; or, for each machine, how many steps share it"""
    identity: str = ""
    """of the store, if its path may mean another folder on the worker, which then compares them"""
    remote: str = ""
    """address of the shared store, if there is one"""
    is_distrusted: bool = False
    """whether the shared store's result has turned out to be broken"""
    outage: str = ""
    """why the shared store is not asked, where another process has found that it does not answer"""


def shared_part(store: Store, key: str) -> dict[str, Any]:
    """What a `Payload` says of the shared store."""
    if not store.remote:
        return {}
    return {
        "remote": store.remote,
        "is_distrusted": key in store.distrusted,
        "outage": remote_at(store.remote).outage,
    }


def sources_are_fit(task: StepTask) -> bool:
    """Whether the sources are, before anything is written; the task has ended with what is wrong with them else."""
    scope = task.inputs.scope
    try:
        scope.values()
    except Exception as error:
        task.end(Outcome(error=error))
        return False
    scope.forget_values()  # the workers decode them
    return True


def compute_once(payload: Payload, tell: Listener) -> dict[str, Any]:
    """Compute a task unless its result is in the store: plain data in and out, and exceptions that can be pickled.

    Parameters
    ----------
    tell : receives that the step begins, and progress, a few times a second.

    Returns
    -------
    ``record``, of what has been computed here ``seconds`` and ``notes``, and with a shared store ``shared``, the
    fields of `Shared`.
    """
    spec, store = TaskSpec.from_json(payload.spec), Store(Path(payload.store), payload.remote)
    answer: dict[str, Any] = {}

    def work() -> dict[str, Any]:
        answer.update(_compute(spec, store, payload.threads, tell))
        return dict(answer["record"])

    if payload.identity:
        store.check_identity(payload.identity)
    tell(StepStarted(spec.label))
    if payload.is_distrusted:
        store.distrusted.add(spec.parts.key)
    exchange = exchange_of(store, spec.parts.stage, spec.parts.key, payload.outage)
    record, _ = keep_record(store, spec.parts.stage, spec.parts.key, work, exchange)
    return {**answer, "record": record, **({} if exchange is None else {"shared": exchange.told})}


def _compute(spec: TaskSpec, store: Store, threads: int | Mapping[str, int], tell: Listener) -> dict[str, Any]:
    notes: list[dict[str, Any]] = []
    last, began = 0.0, time.perf_counter()

    def listener(event: Event) -> None:
        nonlocal last
        if isinstance(event, Note):
            notes.append(dataclasses.asdict(event))
        elif isinstance(event, StepProgress):
            now = time.monotonic()
            if event.picture or event.progress.done >= 1 or now >= last + _SECONDS:
                last = now
                tell(dataclasses.replace(event, progress=dataclasses.replace(event.progress, preview=None)))

    try:
        check_same(spec)
        record = run_task(spec, find_stage(spec.parts.stage), Inputs(store), _threads(threads), listener)
    except BrokenArtifactError:
        raise
    except InputError as error:
        where = "" if isinstance(threads, int) else f" (on {socket.gethostname()})"
        raise (SourceError if isinstance(error, SourceError) else InputError)(f"{error}{where}") from None
    except Exception as error:
        problem = one_line(format_error(error))
        if is_unreachable(error):
            raise UnreachableError(problem) from None
        raise (
            OSError(problem) if is_resource_error(error) else WorkerError(problem, traceback.format_exc())
        ) from None
    return {"record": record, "seconds": time.perf_counter() - began, "notes": notes}


def _threads(given: int | Mapping[str, int]) -> int:
    if isinstance(given, int):
        return given
    return max(1, thread_count() // given.get(socket.gethostname(), 1))


def outcome_of(answer: Mapping[str, Any], task: StepTask) -> Outcome:
    """What has become of a task, from what `compute_once` returned."""
    for note in answer.get("notes", ()):
        task.tell(Note(**note))
    if "shared" in answer:
        task.tell(Shared(**answer["shared"]))
    return Outcome(answer["record"], answer.get("seconds"))


def failed(error: BaseException) -> Outcome:
    """What has become of a task that raised an exception."""
    known = isinstance(error, (InputError, BrokenArtifactError, WorkerError)) or is_resource_error(error)
    return Outcome(error=error if known else WorkerError(repr(error), ""))


@dataclasses.dataclass(frozen=True)
class WorkerProbe:
    """A worker's answer to a run that wants to use it."""

    host: str
    problem: str = ""


def probe_worker(folder: str, identity: str, version: str) -> WorkerProbe:
    """Whether a worker can work for a run that holds the lock `PROBE` of the store."""
    import filelock

    host, store = socket.gethostname(), Store(Path(folder))
    try:
        ours = program_version()
        if ours != version:
            return WorkerProbe(host, f"it has {ours}, this is {version}")
        store.check_identity(identity)
        probe_folder(store.root)
        store.lock(PROBE, timeout=0).acquire().lock.release()
    except filelock.Timeout:
        return WorkerProbe(host)
    except (InputError, OSError) as error:
        return WorkerProbe(host, str(error))
    problem = f"it can take a lock in {folder} that is held here: the file system must support flock"
    return WorkerProbe(host, problem)
