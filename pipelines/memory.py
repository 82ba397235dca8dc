"""How much memory decoded pictures and large results may take, and what becomes of memory that is freed."""

from __future__ import annotations

import contextlib
import functools
import os
from collections.abc import Iterator
from pathlib import Path, PurePosixPath

from texloom.pipelines.byte_size import format_byte_size, parse_byte_size
from texloom.pipelines.errors import shown
from texloom.stages.vocabulary.declare import InputError

VARIABLE = "TEXLOOM_MEMORY"
_SHARE = 0.5  # of the machine's memory
_UNKNOWN = 4 * 10**9  # bytes, where the machine does not tell
_KEPT = 2**27  # bytes of freed memory
_LARGE = 2**25  # bytes of an array from which on its memory is returned at once; the most that glibc accepts
_MALLOPT = {-8: 1, -3: _LARGE, -1: _KEPT}  # M_ARENA_MAX, M_MMAP_THRESHOLD, M_TRIM_THRESHOLD of malloc.h
_GROUP = Path("/proc/self/cgroup")
_GROUPS = Path("/sys/fs/cgroup")


def memory_limit() -> int:
    """Bytes that decoded pictures, and arrays of large results, may take.

    ``TEXLOOM_MEMORY``, or half of what this process can have.
    """
    given = os.environ.get(VARIABLE)
    return parse_memory(given, VARIABLE) if given else int(_SHARE * machine_memory())


def parse_memory(text: str, where: str) -> int:
    """Bytes of ``text``, see `parse_byte_size`; `InputError` where it is no size, or zero."""
    try:
        size = parse_byte_size(text)
    except ValueError as error:
        raise InputError(f"{where}: {error}") from None
    if not size:
        raise InputError(f"{where}: must be more than {shown(text)}")
    return size


def check_memory(needed: int) -> str:
    """Why ``needed`` bytes are too many; empty if they are not."""
    limit = memory_limit()
    if needed <= limit:
        return ""
    return (
        f"takes up to {format_byte_size(needed)} of memory to decode, the limit is {format_byte_size(limit)}; "
        f"make it smaller, or raise the limit by --memory or {VARIABLE}"
    )


@functools.cache
def machine_memory() -> int:
    """Bytes of the machine, or that control groups, as of a job of Slurm, or `ulimit -v` leave to this process."""
    try:
        sizes = [os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE")]
    except (AttributeError, OSError, ValueError):  # not on Windows
        return _UNKNOWN
    for path in _limits_of_groups():
        with contextlib.suppress(OSError, ValueError):  # not there, or "max"
            sizes.append(int(path.read_text()))
    with contextlib.suppress(ImportError):
        import resource

        sizes += [size for size in resource.getrlimit(resource.RLIMIT_AS) if size != resource.RLIM_INFINITY]
    return min(sizes)


def _limits_of_groups() -> Iterator[Path]:
    """The files with the limits of the control groups, version 2 or 1, of this process, and of those above."""
    try:
        lines = _GROUP.read_text().splitlines()
    except OSError:
        lines = []
    inside = [line.split(":", 2) for line in lines if line.count(":") >= 2]
    for folder, name, paths in (
        (_GROUPS, "memory.max", [path for _, controllers, path in inside if not controllers]),
        (
            _GROUPS / "memory",
            "memory.limit_in_bytes",
            [path for _, kinds, path in inside if "memory" in kinds.split(",")],
        ),
    ):
        yield folder / name
        for path in paths:
            group = PurePosixPath(path.lstrip("/"))
            for one in (group, *group.parents)[:-1]:
                yield folder / one / name


def keep_freed_memory() -> None:
    """Keep some freed memory for the next arrays, where the C library is glibc; for processes of our own.

    By default glibc returns it to the system, whose work to clear it for each array takes a twentieth of a run.
    One heap for all threads takes less memory than several, and what one thread frees another one can use.
    """
    import ctypes

    try:
        mallopt = ctypes.CDLL(None).mallopt
    except (AttributeError, OSError, TypeError):  # on other systems
        return
    for option, value in _MALLOPT.items():
        mallopt(option, value)
