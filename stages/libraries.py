"""How libraries are loaded.

BLAS and OpenCV compute on one thread each: with more, the last bits of results depend on the number of threads.
"""

from __future__ import annotations

import contextlib
import importlib
import os
import sys
import types
from collections.abc import Iterator

_VARIABLES = ("OPENBLAS_NUM_THREADS", "OPENCV_FOR_THREADS_NUM")

# Libraries read them when they are loaded, as those of worker processes and those that are still to be imported.
_LATE = "numpy" in sys.modules and os.environ.get(_VARIABLES[0]) != "1"
for _name in _VARIABLES:
    os.environ[_name] = "1"


def import_jaxtyping() -> None:
    """Import jaxtyping without `unittest.mock`, which its import hook takes from there when it is used.

    That module imports asyncio and ssl, which take a tenth of a cached run.
    """
    name = "unittest.mock"
    if name in sys.modules:
        return
    late = types.ModuleType(name)
    late.patch = lambda *given, **named: importlib.import_module(name).patch(*given, **named)  # type: ignore[attr-defined]
    sys.modules[name] = late
    try:
        import jaxtyping  # noqa: F401
    finally:
        del sys.modules[name]


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
