"""What benchmarks measure: wall time, CPU time, and memory."""

from __future__ import annotations

import resource
import time
from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple, TypeVar

T = TypeVar("T")


class Seconds(NamedTuple):
    """Times of one call."""

    wall: float
    cpu: float
    """of all threads, the system's included"""
    system: float
    """the system's part of the CPU time, mostly memory allocation"""


def timed(work: Callable[[], T]) -> tuple[Seconds, T]:
    """The times of a call, and its result."""
    before = _now()
    result = work()
    return Seconds(*(after - start for after, start in zip(_now(), before, strict=True))), result


def fastest(work: Callable[[], T], repeats: int) -> tuple[Seconds, T]:
    """The fastest of several calls, and its result."""
    return min((timed(work) for _ in range(repeats)), key=lambda run: run[0].wall)


def _now() -> Seconds:
    used = resource.getrusage(resource.RUSAGE_SELF)
    return Seconds(time.perf_counter(), used.ru_utime + used.ru_stime, used.ru_stime)


def peak_memory() -> float:
    """Most memory this process has held, MB."""
    status = Path("/proc/self/status")
    if status.exists():  # the other figure begins with that of the process which started this one
        highest = next(line for line in status.read_text().splitlines() if line.startswith("VmHWM"))
        return int(highest.split()[1]) * 1024 / 1e6
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024 / 1e6
