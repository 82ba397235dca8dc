"""Processes of this machine that compute calls. One that dies takes only its own call with it, and is replaced."""

from __future__ import annotations

import contextlib
import multiprocessing
import multiprocessing.connection
import os
import queue
import signal
import threading
from collections.abc import Callable
from concurrent.futures import Future
from multiprocessing.connection import Connection
from multiprocessing.context import SpawnProcess
from typing import Any, NamedTuple

from texloom.pipelines.engine import signals
from texloom.pipelines.memory import keep_freed_memory


class WorkerDiedError(Exception):
    """The process that computed a call has ended before it."""


Tell = Callable[[Any], None]
"""receives what a call tells before it answers"""


class _Call(NamedTuple):
    future: Future[Any]
    work: Callable[[Any, Tell], Any]
    given: Any
    tell: Tell


class _Told(NamedTuple):
    """What a process sends before its answer."""

    what: Any


class _WorkerHandle(NamedTuple):
    process: SpawnProcess
    connection: Connection


class ProcessPool:
    """So many processes, each served by a thread that waits for its answers.

    Those of `concurrent.futures` share one queue, so that all of them end when one dies.
    """

    def __init__(self, count: int):
        self._calls: queue.SimpleQueue[_Call | None] = queue.SimpleQueue()
        self._changing = threading.Lock()
        self._is_over = False
        self._processes: dict[int, SpawnProcess] = {}
        self._threads = [
            threading.Thread(target=self._serve, args=(number,), name=f"texloom-worker-{number}", daemon=True)
            for number in range(count)
        ]
        for thread in self._threads:
            thread.start()

    def submit(self, work: Callable[[Any, Tell], Any], given: Any, tell: Tell = lambda _: None) -> Future[Any]:
        """Have ``work(given, tell)`` computed by the next process that is free; `WorkerDiedError` if that dies.

        What ``work`` tells must be picklable, and is passed on to ``tell`` by a thread of this process.
        """
        future: Future[Any] = Future()
        self._calls.put(_Call(future, work, given, tell))
        return future

    def kill(self) -> None:
        """End all processes at once, whatever they are doing."""
        with self._changing:
            self._is_over = True
            for process in self._processes.values():
                process.kill()

    def close(self) -> None:
        """Cancel the calls that have not begun, and end the processes when they have answered."""
        with contextlib.suppress(queue.Empty):
            while True:
                call = self._calls.get_nowait()
                if call is not None:
                    call.future.cancel()
        for _ in self._threads:
            self._calls.put(None)
        for thread in self._threads:
            thread.join()

    def _serve(self, number: int) -> None:
        if hasattr(signal, "pthread_sigmask"):  # processes inherit it, see `signals.deferred`
            signal.pthread_sigmask(signal.SIG_BLOCK, signals.ENDING)
        worker = self._started(number)
        while (call := self._calls.get()) is not None:
            if worker is not None and not worker.process.is_alive():  # it was killed while it had nothing to do
                worker = self._replaced(number, worker)
            if worker is None or not call.future.set_running_or_notify_cancel():
                call.future.cancel()
                continue
            try:
                worker.connection.send((call.work, call.given))
                while isinstance(received := worker.connection.recv(), _Told):
                    call.tell(received.what)
                answer, error = received
            except (EOFError, OSError):
                worker = self._replaced(number, worker)
                answer, error = None, WorkerDiedError()
            except Exception as problem:  # a message that cannot be read, after which others may be left
                worker = self._replaced(number, worker)
                answer, error = None, problem
            if error is None:
                call.future.set_result(answer)
            else:
                call.future.set_exception(error)
        if worker is not None:
            worker.connection.close()
            worker.process.join()

    def _replaced(self, number: int, dead: _WorkerHandle) -> _WorkerHandle | None:
        dead.connection.close()
        dead.process.kill()
        dead.process.join()
        return self._started(number)

    def _started(self, number: int) -> _WorkerHandle | None:
        """A new process; none if all are to end."""
        with self._changing:
            if self._is_over:
                return None
            spawn = multiprocessing.get_context("spawn")
            ours, theirs = spawn.Pipe()
            process = spawn.Process(target=_answer, args=(theirs,), daemon=True)
            process.start()
            theirs.close()  # so that the pipe ends with the process
            self._processes[number] = process
            return _WorkerHandle(process, ours)


class _CallAtWork:
    """What a call tells, from whatever thread, until its answer, which is the last of it."""

    def __init__(self, connection: Connection):
        self._connection, self._sending, self._is_over = connection, threading.Lock(), False

    def tell(self, what: Any) -> None:
        with self._sending:
            if not self._is_over:
                self._connection.send(_Told(what))

    def answer(self, value: Any, error: Exception | None) -> None:
        with self._sending:
            self._is_over = True
            try:
                self._connection.send((value, error))
            except Exception as problem:  # it cannot be pickled
                self._connection.send((None, RuntimeError(str(problem))))


def _answer(connection: Connection) -> None:
    """Compute calls in a process of the pool, until that closes."""
    _init_process()
    while True:
        try:
            work, given = connection.recv()
        except EOFError:
            os._exit(0)  # all is written; to take Python and its libraries down takes longer than to start a step
        call = _CallAtWork(connection)
        try:
            call.answer(work(given, call.tell), None)
        except Exception as error:
            call.answer(None, error)


def _init_process() -> None:
    """Prepare a process that computes steps: it ends with the one that started it, however that ends."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # the run receives it too, and decides
    keep_freed_memory()
    if hasattr(signal, "pthread_sigmask"):  # see signals.deferred
        signal.pthread_sigmask(signal.SIG_UNBLOCK, signals.ENDING)
    parent = multiprocessing.parent_process()

    def follow() -> None:
        if parent is not None:
            multiprocessing.connection.wait([parent.sentinel])
            os._exit(1)

    threading.Thread(target=follow, daemon=True).start()
