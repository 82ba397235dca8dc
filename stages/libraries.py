"""BLAS and OpenCV on one thread each: with more, the last bits of results depend on the number of threads."""

from __future__ import annotations

import contextlib
import os
import sys
from collections.abc import Iterator

_VARIABLES = ("OPENBLAS_NUM_THREADS", "OPENCV_FOR_THREADS_NUM")

# Libraries read them when they are loaded, as those of worker processes and those that are still to be imported.
_LATE = "numpy" in sys.modules and os.environ.get(_VARIABLES[0]) != "1"
for _name in _VARIABLES:
    os.environ[_name] = "1"


@contextlib.contextmanager
def single_threaded() -> Iterator[None]:
    """Limit the libraries that were loaded before this module, as by a script that imports numpy first."""
    with contextlib.ExitStack() as stack:
        if _LATE:
            from threadpoolctl import threadpool_limits

            stack.enter_context(threadpool_limits(1, "blas"))
        cv2 = sys.modules.get("cv2")
        if cv2 is not None and (threads := cv2.getNumThreads()) != 1:
            cv2.setNumThreads(1)
            stack.callback(cv2.setNumThreads, threads)
        yield
