"""Arrays larger than the memory, in nameless files that vanish with the process, where the runner offers a folder.

Results do not depend on where an array is. Its rows are worked on in bands, and released after each, so that only a
few bands of it are in memory.
"""

from __future__ import annotations

import contextlib
import contextvars
import dataclasses
import errno
import math
import mmap
import os
import tempfile
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from texloom.stages.kernels.core.threads import run_all, spans, thread_count

_BAND = 64  # rows
_PIECES = 16  # of a kernel's work where all is in memory, at most
_MIN_ROWS = 32  # of a piece there; the call for fewer takes longer than what a thread saves
_KEPT = 4  # arrays of the limit's size that mapped arrays may occupy between two releases


@dataclasses.dataclass(frozen=True)
class Scratch:
    """Where large arrays are."""

    folder: Path
    limit: int
    """bytes; arrays of more are in files"""


_scratch: contextvars.ContextVar[Scratch | None] = contextvars.ContextVar("scratch", default=None)


@contextlib.contextmanager
def using(scratch: Scratch) -> Iterator[None]:
    """Let `empty` put large arrays into files inside the ``with`` block."""
    token = _scratch.set(scratch)
    try:
        yield
    finally:
        _scratch.reset(token)


def empty(shape: Sequence[int], dtype: Any) -> np.ndarray:
    """A new array in C order, of any values; in a file if it is large.

    Raises
    ------
    OSError : the disk is full.
    """
    size = math.prod(shape) * np.dtype(dtype).itemsize
    scratch = _scratch.get()
    if scratch is None or size <= scratch.limit:
        return np.empty(shape, dtype)
    with tempfile.TemporaryFile(dir=scratch.folder) as file:
        _reserve(file, size)
        memory = mmap.mmap(file.fileno(), size)
    return np.frombuffer(memory, dtype).reshape(shape)


def _reserve(file: Any, size: int) -> None:
    """Make a file of zeros that has its place on the disk: a full disk kills a process that writes to a map."""
    file.truncate(size)
    if hasattr(os, "posix_fallocate"):  # not on macOS and Windows
        try:
            os.posix_fallocate(file.fileno(), 0, size)
        except OSError as error:
            if error.errno not in (errno.EINVAL, errno.EOPNOTSUPP):  # file systems that cannot
                raise


def _map_of(array: np.ndarray) -> mmap.mmap | None:
    """The file that an array is in; none if it is in memory."""
    base: Any = array
    while isinstance(base, np.ndarray):
        base = base.base
    base = base.obj if isinstance(base, memoryview) else base
    return base if isinstance(base, mmap.mmap) else None


def release(*arrays: np.ndarray) -> None:
    """Give the memory that arrays in files occupy back to the system; their values stay."""
    for array in arrays:
        memory = _map_of(array)
        if memory is not None and hasattr(memory, "madvise"):
            memory.madvise(mmap.MADV_DONTNEED)


def bands(rows: int, *arrays: np.ndarray) -> Iterator[slice]:
    """Bands of ``rows``, one after the other; what ``arrays`` occupy is released after each."""
    for first in range(0, rows, _BAND):
        yield slice(first, min(first + _BAND, rows))
        release(*arrays)


def run_bands(
    kernel: Callable[..., Any], arguments: tuple[Any, ...], rows: int, arrays: Sequence[np.ndarray]
) -> list[Any]:
    """Call ``kernel(*arguments, first, last)`` for parts of ``rows`` on all threads; see `run_released`."""
    is_mapped = any(_map_of(array) is not None for array in arrays)
    parts = spans(rows, max(_PIECES, rows // _BAND) if is_mapped else min(_PIECES, rows // _MIN_ROWS))
    return run_released(kernel, [(*arguments, *part) for part in parts], arrays)


def run_released(
    kernel: Callable[..., Any], calls: Sequence[tuple[Any, ...]], arrays: Sequence[np.ndarray]
) -> list[Any]:
    """`run_all`; where ``arrays`` are in files, some calls at a time, after which they are released.

    Parameters
    ----------
    arrays : which all calls together use once.
    """
    scratch = _scratch.get()
    mapped = [array for array in arrays if _map_of(array) is not None]
    if not mapped or scratch is None:
        return run_all(kernel, calls)
    share = sum(array.nbytes for array in mapped) / len(calls)
    batch = max(2 * thread_count(), int(_KEPT * scratch.limit / share))
    results = []
    for first in range(0, len(calls), batch):
        results += run_all(kernel, calls[first : first + batch])
        release(*mapped)
    return results
