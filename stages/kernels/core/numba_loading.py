"""Loads compiled kernels without what only compiling needs.

Before it loads a kernel, Numba imports all that it can compile, and `scipy.linalg`, which takes longer than its own
import. Kernels here refer to none of that; those of others may, to what extensions of Numba define.
"""

from typing import Any

import numba  # noqa: F401  # all of it before its parts, which other threads may be loading
from numba.core.caching import Cache
from numba.core.runtime import rtsys

_OURS = "texloom.stages.kernels."
_load_overload = Cache.load_overload


def _load(cache: Any, signature: Any, target: Any) -> Any:
    if not cache._py_func.__module__.startswith(_OURS):
        return _load_overload(cache, signature, target)
    rtsys.initialize(target)  # what allocates arrays
    return cache._load_overload(signature, target)


Cache.load_overload = _load
