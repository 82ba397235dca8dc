"""The executor on Prefect's task runners: each step a Prefect task, whose cache policy keeps its record and lock.

Inside a flow run, whose server shows them, tasks are computed by threads of this process, by processes of this
machine, or by a Dask cluster.
"""

from __future__ import annotations

import contextlib
import dataclasses
import logging
import multiprocessing
import multiprocessing.connection
import multiprocessing.resource_tracker
import os
from collections.abc import Iterator
from concurrent.futures.process import BrokenProcessPool
from typing import Any
from uuid import UUID

from texloom.pipelines.engine import pool, signals
from texloom.pipelines.engine.dask_cluster import DaskCluster
from texloom.pipelines.engine.events import Event, StepProgress
from texloom.pipelines.engine.prefect import records
from texloom.pipelines.engine.prefect.artifacts import ProgressArtifact
from texloom.pipelines.engine.processes import init_process
from texloom.pipelines.engine.run import Run
from texloom.pipelines.engine.scheduler import InFlight, Outcome
from texloom.pipelines.engine.worker_progress import DaskReceiver, DatagramReceiver
from texloom.pipelines.engine.workers import worker_count
from texloom.pipelines.store.record import record_name

# after records, which turns telemetry off
import prefect  # isort: skip
from prefect.logging.handlers import PrefectConsoleHandler  # isort: skip
from prefect.states import Crashed  # isort: skip
from prefect.task_runners import ProcessPoolTaskRunner, ThreadPoolTaskRunner  # isort: skip
from prefect.transactions import IsolationLevel  # isort: skip


class TaskRunnerExecutor:
    """See `texloom.pipelines.engine.scheduler.Executor`."""

    def __init__(self, run: Run):
        """The workers are started with the first task."""
        self.run = run
        self.choice = choice = run.flow.runner
        self.store = run.store
        self.in_process = choice.name in ("local", "threads")
        self.workers = 1 if choice.name == "local" else choice.workers or worker_count(run)
        self.runner: Any = None
        self.broken = False
        self.crashed: list[UUID] = []
        """task runs whose worker died, which the server does not know"""
        self.cluster: DaskCluster | None = None
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
            assert self.cluster is not None
            return self.cluster.slots()

    def ahead(self) -> int:
        """See `texloom.pipelines.engine.scheduler.Executor`; the server would show them as running."""
        return 0

    def submit(self, task: InFlight) -> None:
        """See `texloom.pipelines.engine.scheduler.Executor`."""
        with signals.deferred():
            self._submit(task)

    def _submit(self, task: InFlight) -> None:
        is_first = self.runner is None and not self.broken
        if self.broken:
            self._leave()
        payload = pool.hand_over(task, self.store, self._start, is_first, self.in_process)
        if payload is None:
            return
        number = payload.number
        parameters = {
            "key": record_name(task.spec.parts.stage, task.spec.parts.key),
            "payload": dataclasses.asdict(payload),
            "shown_as": (task.spec.flow, task.spec.label),
        }
        upstream = {given.key: self.futures[given.key] for given in task.spec.outputs if given.key in self.futures}
        future = self.runner.submit(self._task(task), parameters, wait_for=list(upstream.values()) or None)
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
        if at_once and self.in_process:
            pool.interrupt_threads()
        elif at_once and self.runner is not None and self.choice.name == "processes":
            for child in multiprocessing.active_children():
                if child.pid not in self.children:
                    child.kill()
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
            return pool.failed(error)

    def _start(self) -> pool.Workers:
        if self.runner is None:
            self._start_runner()
        return pool.Workers(self.receiver, {} if self.cluster is None else self.cluster.hosts)

    def _start_runner(self) -> None:
        self.store.create()
        self.children = {child.pid or 0 for child in multiprocessing.active_children()}
        self.stack.enter_context(_environment({"PREFECT_LOGGING_HANDLERS_CONSOLE_LEVEL": "CRITICAL"}))
        runner: Any
        if self.in_process:
            runner = ThreadPoolTaskRunner(max_workers=self.workers)
        elif self.choice.name == "processes":
            runner = ProcessPoolTaskRunner(max_workers=self.workers, initializer=init_process)
        else:
            runner = self._dask()
        self.runner = self.stack.enter_context(runner)
        if self.choice.name == "processes":
            self.receiver = DatagramReceiver(pool.tell_progress)
            self.stack.callback(self.receiver.close)

    def _leave(self) -> None:
        self.runner, self.cluster, self.receiver, self.broken = None, None, None, False
        self.futures.clear()
        self.stack.close()
        for task_run in self.crashed:
            with contextlib.suppress(Exception), prefect.get_client(sync_client=True) as client:
                client.set_task_run_state(task_run, Crashed(message="its worker was killed"), force=True)
        self.crashed.clear()

    def _dask(self) -> Any:
        from prefect_dask.task_runners import DaskTaskRunner

        self.cluster = DaskCluster(self.run, self.workers)
        self.stack.callback(self.cluster.close)
        self.receiver = self.cluster.receiver
        return DaskTaskRunner(**{"cluster" if self.choice.address is None else "address": self.cluster.place})


def compute_step(
    key: str,  # noqa: ARG001 (the cache policy reads it)
    payload: dict[str, Any],
    shown_as: tuple[str, str],
) -> dict[str, Any]:
    """The body of each task, see `texloom.pipelines.engine.pool.compute`; the server shows its flow and label."""
    artifact = ProgressArtifact(*shown_as)

    def show(event: Event) -> None:
        if isinstance(event, StepProgress):
            artifact.update(event.progress)

    return pool.compute(pool.Payload(**payload), show)


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
