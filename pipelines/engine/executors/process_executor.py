"""The executor on processes of this machine."""

from __future__ import annotations

import functools
from concurrent.futures import Future
from typing import Any

from texloom.pipelines.engine import signals
from texloom.pipelines.engine.executors.executor import Executor, Outcome, StepTask
from texloom.pipelines.engine.executors.process_pool import ProcessPool, WorkerDiedError
from texloom.pipelines.engine.executors.worker import (
    Payload,
    compute_once,
    failed,
    outcome_of,
    shared_part,
    sources_are_fit,
)
from texloom.pipelines.store.store import Store


class ProcessExecutor(Executor):
    """Computes tasks in processes of this machine."""

    def __init__(self, store: Store, workers: int):
        self.store, self.workers = store, workers
        self._pool: ProcessPool | None = None

    def slots(self) -> int:
        """See `Executor`."""
        return self.workers

    def ahead(self) -> int:
        """See `Executor`."""
        return self.workers

    def submit(self, task: StepTask) -> None:
        """See `Executor`."""
        with signals.deferred():
            if self._pool is None:
                if not sources_are_fit(task):
                    return
                self.store.create()
                self._pool = ProcessPool(self.workers)
            shared = shared_part(self.store, task.spec.parts.key)
            payload = Payload(
                task.spec.to_json(), str(self.store.root), task.threads, self.store.identity(), **shared
            )
            future = self._pool.submit(compute_once, payload, task.tell)
            future.add_done_callback(functools.partial(_end, task))

    def stop(self, at_once: bool) -> None:
        """See `Executor`."""
        if self._pool is None:
            return
        if at_once:
            self._pool.kill()
        with signals.deferred():
            self._pool.close()
            self._pool = None


def _end(task: StepTask, future: Future[dict[str, Any]]) -> None:
    """Tell what has become of a task, unless the pool has cancelled it: nobody waits for it then."""
    if future.cancelled():
        return
    problem = future.exception()
    if isinstance(problem, WorkerDiedError):
        task.end(Outcome(error=OSError("its worker was killed"), is_lost=True))
    else:
        task.end(outcome_of(future.result(), task) if problem is None else failed(problem))
