"""Limits on the threads of libraries, while texloom computes.

texloom has threads of its own, see `texloom.stages.kernels.core.threads`; and where BLAS or OpenCV compute on
several, the last bits of what they return may depend on how many.
"""

from __future__ import annotations

import contextlib
import functools
import os
import sys
import threading
from collections.abc import Callable, Iterator

_VARIABLES = ("OPENBLAS_NUM_THREADS", "OPENCV_FOR_THREADS_NUM")
"""what they read when they are loaded; `texloom.__main__` sets them to 1 for its process and its workers"""

_is_limited = all(os.environ.get(name) == "1" for name in _VARIABLES) and not {"numpy", "cv2"} & sys.modules.keys()

_guard = threading.Lock()
_inside = 0  # blocks that have begun and not ended, on all threads
_before: dict[str, Callable[[], object]] = {}  # library to what gives it back its threads


@contextlib.contextmanager
def single_threaded() -> Iterator[None]:
    """Have BLAS and OpenCV compute on one thread each inside the ``with`` block.

    When the last of such blocks ends, on whatever thread, they have the threads again that they had before the
    first one.
    """
    global _inside  # noqa: PLW0603 (the libraries' threads belong to the process)
    if _is_limited:
        yield
        return
    with _guard:
        _limit()
        _inside += 1
    try:
        yield
    finally:
        with _guard:
            _inside -= 1
            if not _inside:
                while _before:
                    _before.popitem()[1]()


def _limit() -> None:
    """Limit what is loaded and not limited yet. OpenCV is loaded, as it would take all processors later on."""
    import cv2
    from threadpoolctl import ThreadpoolController

    if "cv2" not in _before:
        _before["cv2"] = functools.partial(cv2.setNumThreads, cv2.getNumThreads())
        cv2.setNumThreads(1)
    for library in ThreadpoolController().select(user_api="blas").lib_controllers:
        if library.filepath not in _before:
            _before[library.filepath] = functools.partial(library.set_num_threads, library.num_threads)
            library.set_num_threads(1)
