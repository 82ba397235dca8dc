"""Running a kernel on all cores: Python threads over calls that release the interpreter lock.

Kernels are compiled with ``nogil`` and write to disjoint parts of their outputs, so the result does not depend on
how many threads share the calls. Numba's own threading layers are not used: they abort when two threads launch at
once (workqueue) or after a fork (omp), and parallel kernels take several times longer to compile.
"""

import contextlib
import contextvars
import os
import re
import threading
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import ThreadPoolExecutor, wait
from functools import cache
from typing import Any

_Share = tuple[int, ThreadPoolExecutor | None]
_share: contextvars.ContextVar[_Share | None] = contextvars.ContextVar("share", default=None)


def thread_count() -> int:
    """How many threads may compute; never changes a result.

    What `sharing` says, else ``TEXLOOM_THREADS`` if set, else the processors that this process may use.

    Raises
    ------
    ValueError : ``TEXLOOM_THREADS`` is no such number.
    """
    share = _share.get()
    if share is not None:
        return share[0]
    chosen = os.environ.get("TEXLOOM_THREADS")
    if chosen:  # empty is not set, as with TEXLOOM_DEVICE
        return _number(chosen)
    return processors()


def processors() -> int:
    """The processors that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


@cache
def _number(chosen: str) -> int:
    if not re.fullmatch("[1-9][0-9]{0,2}", chosen):
        raise ValueError(f"TEXLOOM_THREADS: got {chosen!r}, want a whole number from 1 to 999")
    return int(chosen)


def _started(threads: int) -> ThreadPoolExecutor:
    """A pool whose threads run already: so many, two or more, with the one that calls `run_all`.

    A pool forgets a thread at whose start Ctrl-C raises, and then the process never ends. Ctrl-C raises in the main
    thread alone, so another one starts them.
    """
    pool = ThreadPoolExecutor(threads - 1, thread_name_prefix="texloom-kernel")
    all_asked = threading.Event()

    def start() -> None:
        with contextlib.suppress(RuntimeError):  # the process ends meanwhile
            for _ in range(threads - 1):
                pool.submit(all_asked.wait)  # a pool starts a thread for what no idle one can do
        all_asked.set()

    starter = threading.Thread(target=start)
    starter.start()
    starter.join()
    return pool


_pool = cache(_started)


@contextlib.contextmanager
def sharing(threads: int) -> Iterator[None]:
    """Give the work inside the ``with`` block so many threads of its own, while other work runs beside it."""
    with _started(threads) if threads > 1 else contextlib.nullcontext() as pool:
        token = _share.set((threads, pool))
        try:
            yield
        finally:
            _share.reset(token)


def run_all(kernel: Callable[..., Any], calls: Iterable[tuple[Any, ...]]) -> list[Any]:
    """Call ``kernel`` once for each tuple of arguments and return the results in that order.

    The calling thread works too, and each thread takes the next call when it is done with one: a call handed over
    costs more than many a kernel.
    """
    calls = list(calls)
    threads = min(thread_count(), len(calls))
    if threads < 2:
        return [kernel(*arguments) for arguments in calls]
    results: list[Any] = [None] * len(calls)
    numbers = iter(range(len(calls)))  # shared: the interpreter lock gives each number to one thread

    def work() -> None:
        for number in numbers:
            results[number] = kernel(*calls[number])

    share = _share.get()
    pool = _pool(thread_count()) if share is None else share[1]
    helpers = [] if pool is None else [pool.submit(work) for _ in range(threads - 1)]
    try:
        work()
    finally:
        for _ in numbers:  # nothing more begins after an exception
            pass
        begun = [helper for helper in helpers if not helper.cancel()]
        wait(begun)
    for helper in begun:
        helper.result()
    return results


def run_spans(kernel: Callable[..., Any], arguments: tuple[Any, ...], length: int, pieces: int) -> list[Any]:
    """Call ``kernel(*arguments, start, stop)`` for each of `spans` and return the results in their order."""
    return run_all(kernel, [(*arguments, *span) for span in spans(length, pieces)])


def spans(length: int, pieces: int) -> list[tuple[int, int]]:
    """Cut ``range(length)`` into at most ``pieces`` (start, stop) runs of nearly equal length."""
    pieces = max(1, min(pieces, length))
    return [(length * index // pieces, length * (index + 1) // pieces) for index in range(pieces)]
