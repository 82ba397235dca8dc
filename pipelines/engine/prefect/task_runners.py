"""The executor on Prefect's task runners: each step a Prefect task, whose cache policy keeps its record and lock.

Inside a flow run, whose server shows them, tasks are computed by threads of this process, by processes of this
machine, or by a Dask cluster, whose machines must see the store under the same path. Without a server only those of
a cluster are, and none is asked for; see `texloom.pipelines.engine.pool` for the others.
"""

from __future__ import annotations

import contextlib
import dataclasses
import functools
import logging
import multiprocessing
import multiprocessing.connection
import multiprocessing.resource_tracker
import os
from collections.abc import Iterator
from concurrent.futures.process import BrokenProcessPool
from typing import Any
from uuid import UUID

from texloom.pipelines.engine import pool, signals, worker
from texloom.pipelines.engine.events import Event, StepProgress
from texloom.pipelines.engine.prefect import records
from texloom.pipelines.engine.prefect.artifacts import ProgressArtifact
from texloom.pipelines.engine.run import Run
from texloom.pipelines.engine.scheduler import InFlight, Outcome
from texloom.pipelines.engine.worker_progress import DaskReceiver, DatagramReceiver
from texloom.pipelines.engine.workers import worker_count
from texloom.pipelines.store.record import record_name
from texloom.stages.declare import InputError

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
_DASK_SECONDS = 10.0  # to wait for a scheduler, and for its first worker


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
        with signals.deferred():
            self._start()
            return max(1, sum(map(int, self.runner.client.nthreads().values())))

    def submit(self, task: InFlight) -> None:
        """See `texloom.pipelines.engine.scheduler.Executor`."""
        with signals.deferred():
            self._submit(task)

    def _submit(self, task: InFlight) -> None:
        if self.broken:
            self._leave()
        elif self.runner is None and (error := pool.check_sources(task, self.in_process)) is not None:
            task.end(Outcome(error=error))
            return
        self._start()
        task.tell_started()
        number = next(pool.numbers)
        pool.in_flight[number] = task
        payload = pool.Payload(
            number=number,
            spec="" if self.in_process else task.spec.to_json(),
            store=str(self.store.root),
            threads=self.hosts or task.threads,
            channel=None if self.receiver is None else dataclasses.asdict(self.receiver.channel),
        )
        parameters = {
            "key": record_name(task.spec.parts.stage, task.spec.parts.key),
            "payload": dataclasses.asdict(payload),
            "shown_as": (task.spec.flow, task.spec.label) if self.has_server else None,
        }
        upstream = {given.key: self.futures[given.key] for given in task.spec.outputs if given.key in self.futures}
        future = self.runner.submit(self._task(task), parameters, wait_for=list(upstream.values()) or None)
        if self.has_server:
            self.futures[task.spec.parts.key] = future
        future.add_done_callback(lambda future: task.end(self._outcome(future, task, number)))

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
        if at_once and self.runner is not None and self.choice.name != "dask":
            pool.end_work(self.in_process, self.children)
        with signals.deferred():
            self._leave()

    def _outcome(self, future: Any, task: InFlight, number: int) -> Outcome:
        pool.in_flight.pop(number, None)
        try:
            return pool.outcome_of(future.result(), task)
        except BrokenProcessPool:
            self.broken = True
            self.crashed.append(future.task_run_id)
            return pool.lost()
        except BaseException as error:
            self.locks.discard(record_name(task.spec.parts.stage, task.spec.parts.key))
            if type(error).__name__ == "KilledWorker":
                return Outcome(error=OSError("its workers were killed, one after the other"))
            return pool.failed(error)

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
            runner = ProcessPoolTaskRunner(max_workers=self.workers, initializer=pool.init_process)
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
            self.receiver = DaskReceiver(self.runner.client, pool.tell_progress)
        elif self.choice.name == "processes":
            self.receiver = DatagramReceiver(pool.tell_progress)
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


def compute_step(
    key: str,  # noqa: ARG001 (the cache policy reads it)
    payload: dict[str, Any],
    shown_as: tuple[str, str] | None,
) -> dict[str, Any]:
    """The body of each task, see `texloom.pipelines.engine.pool.compute`; a server shows its flow and label."""
    artifact = None if shown_as is None else ProgressArtifact(*shown_as)

    def show(event: Event) -> None:
        if artifact is not None and isinstance(event, StepProgress):
            artifact.update(event.progress)

    return pool.compute(pool.Payload(**payload), show)


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
