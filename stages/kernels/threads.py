"""Running a kernel on all cores: Python threads over calls that release the interpreter lock.

Kernels are compiled with ``nogil`` and write to disjoint parts of their outputs, so the result does not depend on
how many threads share the calls. Numba's own threading layers are not used: they abort when two threads launch at
once (workqueue) or after a fork (omp), and parallel kernels take several times longer to compile.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable
from concurrent.futures import ThreadPoolExecutor
from functools import cache
from typing import Any


def thread_count() -> int:
    """``TEXLOOM_THREADS`` if set, else the processors this process may use. Never changes a result."""
    chosen = os.environ.get("TEXLOOM_THREADS", "")
    if chosen.isdigit() and int(chosen) > 0:
        return int(chosen)
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


@cache
def _pool(threads: int) -> ThreadPoolExecutor:
    return ThreadPoolExecutor(threads, thread_name_prefix="texloom-kernel")


def run_all(kernel: Callable[..., Any], calls: Iterable[tuple[Any, ...]]) -> list[Any]:
    """Call ``kernel`` once for each tuple of arguments and return the results in that order."""
    calls = list(calls)
    threads = thread_count()
    if threads == 1 or len(calls) < 2:
        return [kernel(*arguments) for arguments in calls]
    return list(_pool(threads).map(lambda arguments: kernel(*arguments), calls))


def spans(length: int, pieces: int) -> list[tuple[int, int]]:
    """Cut ``range(length)`` into at most ``pieces`` (start, stop) runs of nearly equal length."""
    pieces = max(1, min(pieces, length))
    return [(length * index // pieces, length * (index + 1) // pieces) for index in range(pieces)]
