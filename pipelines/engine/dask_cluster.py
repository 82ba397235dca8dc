"""The executor on a Dask cluster: workers of this machine, or those of a cluster at an address, whose machines must
see the store under the same path. Tasks are those of `texloom.pipelines.engine.pool`.
"""

from __future__ import annotations

import contextlib
import dataclasses
import functools
import logging
import tempfile
from collections.abc import Callable, Iterator
from concurrent.futures import CancelledError
from typing import Any

from texloom.pipelines.engine import pool, signals, worker
from texloom.pipelines.engine.run import Run
from texloom.pipelines.engine.scheduler import InFlight, Outcome
from texloom.pipelines.engine.worker_progress import DaskReceiver
from texloom.pipelines.engine.workers import worker_count
from texloom.pipelines.errors import NoWorkersError, one_line
from texloom.pipelines.interruption import interruption_of
from texloom.pipelines.store.store import program_version
from texloom.stages.vocabulary.declare import InputError

_SECONDS = 10.0  # to wait for a scheduler, and for its first worker
_ANSWER = 5.0  # seconds to wait for the answer of a task that has ended, before asking once more


class DaskCluster:
    """Workers that can compute tasks of a run, until `close`."""

    def __init__(self, run: Run, workers: int):
        """Start ``workers`` of this machine, or connect to the cluster at the address of the flow's runner.

        Raises
        ------
        InputError : no scheduler with workers answers there, or a worker is not fit for this run.
        NoWorkersError : those of this machine do not start.
        """
        import distributed

        self._store, self._choice = run.store, run.flow.runner
        self.place: Any
        """the address of the cluster, or that of this machine itself, which knows its credentials"""
        self.hosts: dict[str, int] = {}
        """machine to how many steps share it, of a cluster at an address"""
        with contextlib.ExitStack() as stack:
            self.place = self._choice.address or stack.enter_context(local_cluster(workers))
            where = f"--runner dask: {self._choice.address or 'a cluster on this machine'}"
            try:
                self.client = distributed.Client(self.place, timeout=_SECONDS, set_as_default=False)
                stack.callback(self.client.close)
                self.client.wait_for_workers(1, timeout=_SECONDS)
            except OSError as error:
                reason = str(error).splitlines()[0] if str(error) else type(error).__name__
                raise InputError(f"{where}: no scheduler with workers answers ({reason})") from None
            if self._choice.address is not None:
                self._probe_workers(where)
            self.receiver = DaskReceiver(self.client, pool.tell_progress)
            stack.callback(self.receiver.close)
            self.close = stack.pop_all().close

    def slots(self) -> int:
        """How many tasks the workers compute at a time."""
        return max(1, sum(map(int, self.client.nthreads().values())))

    def _probe_workers(self, where: str) -> None:
        with self._store.lock(worker.PROBE):
            probe = functools.partial(
                worker.probe_worker, str(self._store.root), self._store.identity(), program_version()
            )
            probes = self.client.run(probe, on_error="return")
        for address, answer in probes.items():
            problem = repr(answer) if isinstance(answer, BaseException) else answer.problem
            if problem:
                host = address if isinstance(answer, BaseException) else f"{address} ({answer.host})"
                raise InputError(f"{where}: worker {host}: {problem}")
        for address, threads in self.client.nthreads().items():
            host = probes[address].host if address in probes else ""
            self.hosts[host] = self.hosts.get(host, 0) + threads


class DaskExecutor:
    """See `texloom.pipelines.engine.scheduler.Executor`."""

    def __init__(self, run: Run):
        """The workers are started with the first task."""
        self._run = run
        self._workers = run.flow.runner.workers or worker_count(run)
        self._cluster: DaskCluster | None = None
        self._futures: dict[int, Any] = {}
        """by number of the task; Dask forgets a task of which nobody holds the future"""
        self._is_over = False

    def slots(self) -> int:
        """See `texloom.pipelines.engine.scheduler.Executor`."""
        if self._run.flow.runner.address is None:
            return self._workers
        with signals.deferred():
            return self._started().slots()

    def ahead(self) -> int:
        """See `texloom.pipelines.engine.scheduler.Executor`."""
        return self.slots()

    def submit(self, task: InFlight) -> None:
        """See `texloom.pipelines.engine.scheduler.Executor`."""
        with signals.deferred():
            store = self._run.store
            payload = pool.hand_over(task, store, self._start, self._cluster is None, in_process=False)
            if payload is None:
                return
            number, payload = payload.number, dataclasses.replace(payload, identity=store.identity())
            future = self._started().client.submit(
                pool.compute_once, payload, key=f"{task.step.name}-{number}", pure=False
            )
            self._futures[number] = future
            future.add_done_callback(lambda future: task.end(self._outcome(future, task, number)))

    def stop(self, at_once: bool) -> None:  # noqa: ARG002 (workers of this machine end with their cluster)
        """See `texloom.pipelines.engine.scheduler.Executor`."""
        self._is_over = True
        with signals.deferred():
            if self._cluster is not None:
                self._cluster.close()
            self._cluster = None

    def _started(self) -> DaskCluster:
        if self._cluster is None:
            self._run.store.create()
            self._cluster = DaskCluster(self._run, self._workers)
        return self._cluster

    def _start(self) -> pool.Workers:
        cluster = self._started()
        return pool.Workers(cluster.receiver, cluster.hosts)

    def _outcome(self, future: Any, task: InFlight, number: int) -> Outcome:
        pool.in_flight.pop(number, None)
        self._futures.pop(number, None)
        try:
            while not self._is_over:  # then nobody answers, and the thread of the callbacks would wait for ever
                with contextlib.suppress(TimeoutError):
                    problem = future.exception(timeout=_ANSWER)
                    if problem is not None:
                        return pool.failed(problem)
                    return pool.outcome_of(future.result(timeout=_ANSWER), task)
        except BaseException as error:
            return pool.failed(error)
        return pool.failed(CancelledError())


@contextlib.contextmanager
def local_cluster(workers: int) -> Iterator[Any]:
    """A cluster of this machine, which replaces workers that die; `NoWorkersError` where they do not start.

    Whoever connects needs credentials that are made here and handed to the workers through pipes. Its files are in
    a folder of its own, which nobody else can read and which is removed at the end.
    """
    import dask
    import distributed

    from texloom.pipelines.engine import dask_nodes

    security = distributed.Security.temporary()
    local = {"host": "127.0.0.1", "protocol": "tls://", "security": security}
    worker = {
        "cls": distributed.Nanny,
        "options": {
            **local,
            "worker_class": dask_nodes.Worker,
            "nthreads": 1,
            "memory_limit": distributed.system.MEMORY_LIMIT // workers,
            "silence_logs": logging.CRITICAL,
        },
    }
    start = functools.partial(
        distributed.SpecCluster,
        scheduler={"cls": dask_nodes.Scheduler, "options": {**local, "port": 0, "dashboard": False}},
        worker=worker,
        workers=dict.fromkeys(range(workers), worker),
        security=security,
        silence_logs=logging.CRITICAL,
    )
    with tempfile.TemporaryDirectory(prefix="texloom-dask-", ignore_cleanup_errors=True) as folder:
        settings = {
            "temporary-directory": folder,
            # Dask gives up workers whose replacement takes longer to start, and in the end the run waits for none.
            "distributed.deploy.lost-worker-timeout": "1 day",
            # Nobody looks at what it measures of itself, which takes a sixteenth of a core.
            "distributed.worker.profile.enabled": False,
            "distributed.admin.system-monitor.interval": "10s",
            "distributed.admin.tick.interval": "500ms",
        }
        with dask.config.set(settings), _started_cluster(start) as cluster:
            yield cluster


def _started_cluster(start: Callable[[], Any]) -> Any:
    """A cluster, on the second try if a worker of the first dies on the way."""
    try:
        return start()
    except RuntimeError as error:
        if interruption_of(error) is not None:
            raise
    try:
        return start()
    except (RuntimeError, OSError) as error:
        if interruption_of(error) is not None:
            raise
        reason = one_line(str(error)) or type(error).__name__
        raise NoWorkersError(f"--runner dask: the workers of this machine do not start ({reason})") from None
