"""The executor in this process."""

from __future__ import annotations

import contextlib
import contextvars
import functools
import time
from concurrent.futures import ThreadPoolExecutor

from texloom.pipelines.engine import signals
from texloom.pipelines.engine.events import Event, Shared, StepStarted
from texloom.pipelines.engine.executors.executor import Executor, Outcome, StepTask
from texloom.pipelines.engine.task import run_task
from texloom.pipelines.interruption import interruption_of
from texloom.pipelines.store.exchange import exchange_of
from texloom.pipelines.store.keep import keep_record
from texloom.pipelines.store.store import Store
from texloom.stages.vocabulary.interruption import Interruption


class InlineExecutor(Executor):
    """Computes tasks in the calling thread, or all of them on threads that share the processors.

    Of two that are submitted together to the calling thread, one is computed on another thread meanwhile. Each uses
    all processors, as what they do on one alone is what takes time.
    """

    def __init__(self, store: Store, slots: int = 1, on_threads: bool = False):
        """``slots``: at most 2, unless ``on_threads``."""
        self.store = store
        self._slots, self._on_threads = slots, on_threads
        self._threads: ThreadPoolExecutor | None = None
        self._submitted: list[StepTask] = []
        """to the threads"""

    def slots(self) -> int:
        """See `Executor`."""
        return self._slots

    def submit(self, task: StepTask) -> None:
        """See `Executor`."""
        if self._on_threads:
            with signals.deferred():
                self._submit_to_thread(task)
        elif task.is_beside:
            self._submit_to_thread(task)
        else:
            self._compute(task)

    def _submit_to_thread(self, task: StepTask) -> None:
        if self._threads is None:
            self._threads = ThreadPoolExecutor(self._slots)
        self._submitted.append(task)
        self._threads.submit(contextvars.copy_context().run, self._compute_on_thread, task)

    def _compute_on_thread(self, task: StepTask) -> None:
        try:
            with contextlib.suppress(Interruption):  # of `StepTask.interrupt`
                self._compute(task)
        except BaseException as error:
            task.end(Outcome(error=error))
        finally:
            self._submitted.remove(task)

    def _compute(self, task: StepTask) -> None:
        def listener(event: Event) -> None:
            task.tell(event)  # which may change meanwhile, see `StepTask.interrupt`

        began = time.perf_counter()
        record, is_new, error = None, True, None
        try:
            task.inputs.scope.values()  # a broken source is found before anything is told or written
            task.tell(StepStarted(task.spec.label))
            self.store.create()
            threads = task.threads if self._on_threads else None
            work = functools.partial(run_task, task.spec, task.stage, task.inputs, threads, listener)
            parts = task.spec.parts
            exchange = exchange_of(self.store, parts.stage, parts.key)
            record, is_new = keep_record(self.store, parts.stage, parts.key, work, exchange)
            if exchange is not None:
                task.tell(Shared(**exchange.told))
        except Exception as raised:
            interruption = interruption_of(raised)
            if interruption is not None:
                raise interruption from None
            error = raised
        task.end(Outcome(record, time.perf_counter() - began if is_new else None, error))

    def stop(self, at_once: bool) -> None:
        """See `Executor`."""
        if at_once:
            for task in list(self._submitted):
                task.interrupt()
        if self._threads is not None:
            with signals.deferred() if self._on_threads else contextlib.nullcontext():
                self._threads.shutdown(cancel_futures=True)
