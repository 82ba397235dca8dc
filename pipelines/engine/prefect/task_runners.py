"""The executor on Prefect's task runners: each step a Prefect task, whose cache policy keeps its record and lock.

Tasks are computed by threads of this process, by processes of this machine, or by a Dask cluster, whose machines
must see the store under the same path. Inside a flow run the server shows them; without a server none is asked.
"""

from __future__ import annotations

import contextlib
import dataclasses
import functools
import itertools
import logging
import multiprocessing
import multiprocessing.connection
import multiprocessing.resource_tracker
import os
import signal
import socket
import threading
import time
import traceback
from collections.abc import Iterator, Mapping
from concurrent.futures.process import BrokenProcessPool
from pathlib import Path
from typing import Any
from uuid import UUID

from texloom.pipelines.engine import worker
from texloom.pipelines.engine.events import Event, Note, StepProgress
from texloom.pipelines.engine.prefect import records
from texloom.pipelines.engine.prefect.artifacts import ProgressArtifact
from texloom.pipelines.engine.prefect.worker_progress import Channel, DaskReceiver, DatagramReceiver, ProgressSender
from texloom.pipelines.engine.run import Run
from texloom.pipelines.engine.scheduler import InFlight, Outcome
from texloom.pipelines.engine.task import Inputs, TaskSpec, check_same, run_task
from texloom.pipelines.engine.workers import worker_count
from texloom.pipelines.errors import format_error, is_resource_error, one_line
from texloom.pipelines.media.sources import SourceError
from texloom.pipelines.store.record import record_name
from texloom.pipelines.store.store import BrokenArtifactError, Store
from texloom.stages.declare import InputError, find_stage
from texloom.stages.kernels.core.threads import thread_count
from texloom.stages.progress import Progress

# after records, which turns telemetry off
import prefect  # isort: skip
from prefect.events.clients import NullEventsClient  # isort: skip
from prefect.events.worker import EventsWorker  # isort: skip
from prefect.logging.handlers import PrefectConsoleHandler  # isort: skip
from prefect.settings import (  # isort: skip
    PREFECT_API_URL,
    PREFECT_CLIENT_SERVER_VERSION_CHECK_ENABLED,
    PREFECT_LOGGING_TO_API_ENABLED,
    temporary_settings,
)
from prefect.states import Crashed  # isort: skip
from prefect.task_runners import ProcessPoolTaskRunner, ThreadPoolTaskRunner  # isort: skip
from prefect.transactions import IsolationLevel  # isort: skip

_NO_SERVER = {
    PREFECT_API_URL: "http://no-server.invalid/api",  # or Prefect would start one; it is never contacted
    PREFECT_LOGGING_TO_API_ENABLED: False,
    PREFECT_CLIENT_SERVER_VERSION_CHECK_ENABLED: False,
}
_DEFERRED = (signal.SIGINT, signal.SIGTERM)
_DASK_SECONDS = 10.0  # to wait for a scheduler, and for its first worker


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
class _Payload:
    """What travels to a worker: text and numbers."""

    number: int
    """of the task in this process, see `_in_flight`"""
    spec: str
    """see `TaskSpec.to_json`; empty for threads of this process"""
    store: str
    threads: int | Mapping[str, int]
    """for this step alone; or, for each machine, how many steps share it"""
    has_server: bool
    channel: dict[str, Any] | None = None
    """where progress is reported, see `Channel`; none for threads of this process"""


_numbers = itertools.count()
_in_flight: dict[int, InFlight] = {}
"""the tasks that have been submitted and have not ended"""


class TaskRunnerExecutor:
    """See `texloom.pipelines.engine.scheduler.Executor`."""

    def __init__(self, run: Run, has_server: bool = False):
        """The workers are started with the first task.

        Parameters
        ----------
        has_server : whether this is inside a flow run, whose server is to show the tasks.
        """
        self.choice = choice = run.flow.runner
        self.store = run.store
        self.has_server = has_server
        self.in_process = choice.name in ("local", "threads")
        self.workers = 1 if choice.name == "local" else choice.workers or worker_count(run)
        self.runner: Any = None
        self.broken = False
        self.crashed: list[UUID] = []
        """task runs whose worker died, which the server does not know"""
        self.hosts: dict[str, int] = {}
        """machine to how many steps share it, of a cluster at an address"""
        self.futures: dict[str, Any] = {}
        """by key, so that the server shows which task waits for which"""
        self.receiver: DatagramReceiver | DaskReceiver | None = None
        """of the progress of other processes"""
        self.stack = contextlib.ExitStack()
        self.children: set[int] = set()
        self.locks = records.FileLocks(run.store)

    def slots(self) -> int:
        """See `texloom.pipelines.engine.scheduler.Executor`."""
        if self.choice.address is None:
            return self.workers
        with _deferred_signals():
            self._start()
            return max(1, sum(map(int, self.runner.client.nthreads().values())))

    def submit(self, task: InFlight) -> None:
        """See `texloom.pipelines.engine.scheduler.Executor`."""
        with _deferred_signals():
            self._submit(task)

    def _submit(self, task: InFlight) -> None:
        if self.broken:
            self._leave()
        elif self.runner is None and (error := self._check_sources(task)) is not None:
            task.end(Outcome(error=error))
            return
        self._start()
        task.tell_started()
        number = next(_numbers)
        _in_flight[number] = task
        payload = _Payload(
            number=number,
            spec="" if self.in_process else task.spec.to_json(),
            store=str(self.store.root),
            threads=self.hosts or task.threads,
            has_server=self.has_server,
            channel=None if self.receiver is None else dataclasses.asdict(self.receiver.channel),
        )
        parameters = {
            "key": record_name(task.spec.parts.stage, task.spec.parts.key),
            "payload": dataclasses.asdict(payload),
        }
        upstream = {given.key: self.futures[given.key] for given in task.spec.outputs if given.key in self.futures}
        future = self.runner.submit(self._task(task), parameters, wait_for=list(upstream.values()) or None)
        if self.has_server:
            self.futures[task.spec.parts.key] = future
        future.add_done_callback(lambda future: task.end(self._outcome(future, task, number)))

    def _check_sources(self, task: InFlight) -> Exception | None:
        """What is wrong with the sources of the first task, found before anything is written."""
        scope = task.inputs.scope
        try:
            scope.values()
        except Exception as error:
            return error
        if not self.in_process:  # the workers decode them
            scope.forget_values()
        return None

    def _task(self, task: InFlight) -> Any:
        locks = self.locks if self.in_process else records.FileLocks(self.store, self.store.identity())
        made = prefect.task(
            name=task.step.name,
            task_run_name=task.spec.label.replace("{", "{{").replace("}", "}}"),  # it is a template
            description=f"{task.spec.parts.stage}: {task.step.stage.summary}",
            cache_policy=records.StepKey().configure(
                isolation_level=IsolationLevel.SERIALIZABLE, lock_manager=locks
            ),
            result_serializer=records.ArtifactSerializer(),
            persist_result=True,
            cache_result_in_memory=False,
            retries=0,
        )(compute_step)
        # set here, as a task takes only blocks that a server knows; a mere path would be read by Prefect itself
        made.result_storage = records.folder(self.store)
        return made

    def stop(self, at_once: bool) -> None:
        """See `texloom.pipelines.engine.scheduler.Executor`."""
        if at_once and self.runner is not None:
            for task in list(_in_flight.values()) if self.in_process else ():
                task.tell = _interrupt
            for child in multiprocessing.active_children():
                if child.pid not in self.children and self.choice.name == "processes":
                    child.kill()
        with _deferred_signals():
            self._leave()

    def _outcome(self, future: Any, task: InFlight, number: int) -> Outcome:
        _in_flight.pop(number, None)
        try:
            answer = future.result()
            for note in answer.get("notes", ()):
                task.tell(Note(**note))
            return Outcome(answer["record"], answer.get("seconds"))
        except BrokenProcessPool:
            self.broken = True
            self.crashed.append(future.task_run_id)
            return Outcome(error=OSError("its worker was killed"), is_lost=True)
        except BaseException as error:
            self.locks.discard(record_name(task.spec.parts.stage, task.spec.parts.key))
            if type(error).__name__ == "KilledWorker":
                return Outcome(error=OSError("its workers were killed, one after the other"))
            known = isinstance(error, (InputError, BrokenArtifactError, WorkerError)) or is_resource_error(error)
            return Outcome(error=error if known else WorkerError(repr(error), ""))

    def _start(self) -> None:
        if self.runner is not None:
            return
        self.store.create()
        self.children = {child.pid or 0 for child in multiprocessing.active_children()}
        if not self.has_server:
            self.stack.enter_context(temporary_settings(_NO_SERVER))
            self.stack.enter_context(_without_events())
            silence_console()
        self.stack.enter_context(_environment({"PREFECT_LOGGING_HANDLERS_CONSOLE_LEVEL": "CRITICAL"}))
        runner: Any
        if self.in_process:
            runner = ThreadPoolTaskRunner(max_workers=self.workers)
        elif self.choice.name == "processes":
            initializer = functools.partial(init_process, self.has_server)
            runner = ProcessPoolTaskRunner(max_workers=self.workers, initializer=initializer)
        else:
            runner = self._dask()
        self.runner = self._entered(runner)
        if self.choice.name == "dask":
            try:
                self._check_workers()
            except BaseException:
                self._leave()
                raise
        if self.choice.name == "dask":
            self.receiver = DaskReceiver(self.runner.client, _tell_progress)
        elif self.choice.name == "processes":
            self.receiver = DatagramReceiver(_tell_progress)
        if self.receiver is not None:
            self.stack.callback(self.receiver.close)

    def _entered(self, runner: Any) -> Any:
        """A runner that has started, where need be after a second time: a worker of Dask may die on the way."""
        try:
            return self.stack.enter_context(runner)
        except RuntimeError:
            if self.choice.name != "dask":
                raise
            return self.stack.enter_context(self._dask())

    def _leave(self) -> None:
        self.runner, self.receiver, self.broken = None, None, False
        self.futures.clear()
        self.stack.close()
        if self.has_server:
            for task_run in self.crashed:
                with contextlib.suppress(Exception), prefect.get_client(sync_client=True) as client:
                    client.set_task_run_state(task_run, Crashed(message="its worker was killed"), force=True)
        self.crashed.clear()

    def _dask(self) -> Any:
        from prefect_dask.task_runners import DaskTaskRunner

        if self.choice.address is not None:
            return DaskTaskRunner(address=self.choice.address, client_kwargs={"timeout": _DASK_SECONDS})
        return DaskTaskRunner(
            cluster_kwargs={
                "n_workers": self.workers,
                "threads_per_worker": 1,
                "scheduler_kwargs": {"dashboard": False, "dashboard_address": "127.0.0.1:0"},  # 8787 may be taken
                "silence_logs": logging.CRITICAL,
            }
        )

    def _check_workers(self) -> None:
        """Check that workers can be reached; those of a cluster at an address must be fit for this run."""
        where = f"--runner dask: {self.choice.address or 'a cluster on this machine'}"
        try:
            client = self.runner.client
            client.wait_for_workers(1, timeout=_DASK_SECONDS)
        except OSError as error:
            reason = str(error).splitlines()[0] if str(error) else type(error).__name__
            raise InputError(f"{where}: no scheduler with workers answers ({reason})") from None
        if self.choice.address is not None:
            self._probe_workers(client, where)
        if not self.has_server:
            plugin = _without_events_plugin()
            client.register_plugin(plugin)
            if self.choice.address is not None:
                self.stack.callback(client.unregister_worker_plugin, plugin.name)

    def _probe_workers(self, client: Any, where: str) -> None:
        with self.store.lock(worker.PROBE):
            probe = functools.partial(
                worker.probe_worker, str(self.store.root), self.store.identity(), worker.program_version()
            )
            probes = client.run(probe, on_error="return")
        for address, answer in probes.items():
            problem = repr(answer) if isinstance(answer, BaseException) else answer.problem
            if problem:
                host = address if isinstance(answer, BaseException) else f"{address} ({answer.host})"
                raise InputError(f"{where}: worker {host}: {problem}")
        for address, threads in client.nthreads().items():
            host = probes[address].host if address in probes else ""
            self.hosts[host] = self.hosts.get(host, 0) + threads


def compute_step(key: str, payload: dict[str, Any]) -> dict[str, Any]:  # noqa: ARG001 (the cache policy reads the key)
    """The body of each task, on whatever worker: plain data in and out, and exceptions that can be pickled."""
    given = _Payload(**payload)
    task = _in_flight.get(given.number) if not given.spec else None
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
        progress = ProgressArtifact(spec.flow, spec.label) if given.has_server else None
        sender = None if given.channel is None else ProgressSender(Channel(**given.channel), given.number)

        def listener(event: Event) -> None:
            if isinstance(event, StepProgress):
                if progress is not None:
                    progress.update(event.progress)
                if sender is not None:
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


def _tell_progress(number: int, progress: Progress) -> None:
    """Pass on what a worker reports of a task, unless that has ended."""
    task = _in_flight.get(number)
    if task is not None:
        task.tell(StepProgress(task.spec.label, progress))


def _interrupt(_: Event) -> None:
    raise KeyboardInterrupt


def _threads(given: int | Mapping[str, int]) -> int:
    if isinstance(given, int):
        return given
    return max(1, thread_count() // given.get(socket.gethostname(), 1))


def init_process(has_server: bool) -> None:
    """Prepare a process that computes steps: it ends with the one that started it, however that ends."""
    if not has_server:
        EventsWorker.set_client_override(NullEventsClient)
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # the run receives it too, and decides
    if hasattr(signal, "pthread_sigmask"):  # see _deferred_signals
        signal.pthread_sigmask(signal.SIG_UNBLOCK, _DEFERRED)
    parent = multiprocessing.parent_process()

    def follow() -> None:
        if parent is not None:
            multiprocessing.connection.wait([parent.sentinel])
            os._exit(1)

    threading.Thread(target=follow, daemon=True).start()


@contextlib.contextmanager
def _deferred_signals() -> Iterator[None]:
    """Handle signals that end the run after the ``with`` block, in which Prefect or Dask work or start processes.

    Otherwise they would interrupt those half-way, and the new processes, which inherit what is blocked, in their
    imports, with a traceback each; Dask's workers keep it blocked and end with this process. A signal whose
    handler is the system's still ends this process at once.
    """
    if threading.current_thread() is not threading.main_thread() or not hasattr(signal, "pthread_sigmask"):
        yield
        return
    received: list[int] = []
    handlers = {
        number: signal.signal(number, lambda number, _: received.append(number))
        for number in _DEFERRED
        if signal.getsignal(number) not in (signal.SIG_DFL, None)
    }
    multiprocessing.resource_tracker.ensure_running()  # at its start it would unblock them
    before = signal.pthread_sigmask(signal.SIG_BLOCK, handlers)
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)
        for number, handler in handlers.items():
            signal.signal(number, handler)
        for late in dict.fromkeys(received):
            signal.raise_signal(late)


def _without_events_plugin() -> Any:
    from distributed import WorkerPlugin

    class WithoutEvents(WorkerPlugin):  # type: ignore[misc]
        name = f"texloom-{os.getpid()}"

        def setup(self, worker: Any) -> None:  # noqa: ARG002
            EventsWorker.set_client_override(NullEventsClient)

        def teardown(self, worker: Any) -> None:  # noqa: ARG002
            EventsWorker.set_client_override(None)

    return WithoutEvents()


@contextlib.contextmanager
def _without_events() -> Iterator[None]:
    """Keep Prefect from sending events about task runs."""
    EventsWorker.set_client_override(NullEventsClient)
    try:
        yield
    finally:
        EventsWorker.set_client_override(None)


@contextlib.contextmanager
def _environment(variables: dict[str, str]) -> Iterator[None]:
    """Set environment variables for the processes that are started meanwhile."""
    before = {name: os.environ.get(name) for name in variables}
    os.environ.update(variables)
    try:
        yield
    finally:
        for name, value in before.items():
            os.environ.pop(name, None)
            if value is not None:
                os.environ[name] = value


def silence_console() -> None:
    """Remove Prefect's handler of log lines from the terminal."""
    for handler in list(logging.getLogger().handlers):
        if isinstance(handler, PrefectConsoleHandler):
            logging.getLogger().removeHandler(handler)
