"""The executor on a Dask cluster: workers of this machine, or those of a cluster at an address, whose machines must
see the store under the same path.
"""

from __future__ import annotations

import contextlib
import functools
import itertools
import logging
import tempfile
from collections.abc import Callable, Iterator
from concurrent.futures import CancelledError
from typing import Any

from texloom.pipelines.engine import signals
from texloom.pipelines.engine.events import Event
from texloom.pipelines.engine.executors import worker
from texloom.pipelines.engine.executors.dask_events import EventReceiver, compute_and_tell
from texloom.pipelines.engine.executors.executor import Executor, Outcome, StepTask
from texloom.pipelines.engine.run import Run
from texloom.pipelines.errors import NoWorkersError, one_line
from texloom.pipelines.interruption import interruption_of
from texloom.pipelines.store.result_files import program_version
from texloom.stages.vocabulary.declare import InputError

_SECONDS = 10.0  # to wait for a scheduler, and for its first worker
_ANSWER = 5.0  # seconds to wait for the answer of a task that has ended, before asking once more


class DaskCluster:
    """Workers that can compute tasks of a run, until `close`."""

    def __init__(self, run: Run, workers: int, tell: Callable[[int, Event], None]):
        """Start ``workers`` of this machine, or connect to the cluster at the address of the flow's runner.

        Parameters
        ----------
        tell : receives the number of a task and what it tells, from any thread.

        Raises
        ------
        InputError : no scheduler with workers answers there, or a worker is not fit for this run.
        NoWorkersError : those of this machine do not start.
        """
        import distributed

        self._store, self._choice = run.store, run.flow.runner
        self.hosts: dict[str, int] = {}
        """machine to how many steps share it, of a cluster at an address"""
        with contextlib.ExitStack() as stack:
            place = self._choice.address or stack.enter_context(local_cluster(workers))
            where = f"--runner dask: {self._choice.address or 'a cluster on this machine'}"
            try:
                self.client = distributed.Client(place, timeout=_SECONDS, set_as_default=False)
                stack.callback(self.client.close)
                self.client.wait_for_workers(1, timeout=_SECONDS)
            except OSError as error:
                reason = str(error).splitlines()[0] if str(error) else type(error).__name__
                raise InputError(f"{where}: no scheduler with workers answers ({reason})") from None
            if self._choice.address is not None:
                self._probe_workers(where)
            receiver = EventReceiver(self.client, tell)
            stack.callback(receiver.close)
            self.token = receiver.token
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


class DaskExecutor(Executor):
    """Computes tasks on a Dask cluster."""

    def __init__(self, run: Run, workers: int):
        """``workers``: of a cluster that is started on this machine."""
        self._run = run
        self._workers = workers
        self._cluster: DaskCluster | None = None
        self._numbers = itertools.count()
        self._tasks: dict[int, StepTask] = {}
        """those that have been submitted and have not ended, by number"""
        self._futures: dict[int, Any] = {}
        """Dask forgets a task of which nobody holds the future"""
        self._is_over = False

    def slots(self) -> int:
        """See `Executor`."""
        if self._run.flow.runner.address is None:
            return self._workers
        with signals.deferred():
            return self._started().slots()

    def ahead(self) -> int:
        """See `Executor`."""
        return self.slots()

    def submit(self, task: StepTask) -> None:
        """See `Executor`."""
        with signals.deferred():
            if self._cluster is None and not worker.sources_are_fit(task):
                return
            cluster, store, number = self._started(), self._run.store, next(self._numbers)
            threads = cluster.hosts or task.threads
            shared = worker.shared_part(store, task.spec.parts.key)
            payload = worker.Payload(task.spec.to_json(), str(store.root), threads, store.identity(), **shared)
            self._tasks[number] = task
            future = cluster.client.submit(
                compute_and_tell, payload, cluster.token, number, key=f"{task.spec.step}-{number}", pure=False
            )
            self._futures[number] = future
            future.add_done_callback(lambda future: task.end(self._outcome(future, task, number)))

    def stop(self, at_once: bool) -> None:  # noqa: ARG002 (workers of this machine end with their cluster)
        """See `Executor`."""
        self._is_over = True
        if self._cluster is not None:
            with signals.deferred():
                self._cluster.close()
                self._cluster = None

    def _started(self) -> DaskCluster:
        if self._cluster is None:
            self._run.store.create()
            self._cluster = DaskCluster(self._run, self._workers, self._tell)
        return self._cluster

    def _tell(self, number: int, event: Event) -> None:
        task = self._tasks.get(number)
        if task is not None:
            task.tell(event)

    def _outcome(self, future: Any, task: StepTask, number: int) -> Outcome:
        self._tasks.pop(number, None)
        self._futures.pop(number, None)
        while not self._is_over:  # then nobody answers, and the thread of the callbacks would wait for ever
            try:
                problem = future.exception(timeout=_ANSWER)
                answer = future.result(timeout=_ANSWER) if problem is None else {}
            except TimeoutError:
                continue
            except BaseException as error:
                return worker.failed(error)
            if type(problem).__name__ == "KilledWorker":  # Dask has tried several
                return Outcome(error=OSError("its workers were killed, one after the other"))
            if problem is not None:
                return worker.failed(problem)
            return worker.outcome_of(answer, task)
        return worker.failed(CancelledError())


@contextlib.contextmanager
def local_cluster(workers: int) -> Iterator[Any]:
    """A cluster of this machine, which replaces workers that die; `NoWorkersError` where they do not start.

    Whoever connects needs credentials that are made here and handed to the workers through pipes. Its files are in
    a folder of its own, which nobody else can read and which is removed at the end.
    """
    import dask
    import distributed

    from texloom.pipelines.engine.executors import dask_nodes

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
