"""Loads Numba without `scipy.linalg`, which takes as long as Numba itself and which no kernel here calls.

Numba imports it to see whether it is there. Kernels of others that call linear algebra import it when compiled.
"""

import numba  # noqa: F401  # all of it before its parts, which other threads may be loading
from numba.np import linalg

_ensure_blas = linalg.ensure_blas
linalg.ensure_blas = lambda: None
try:
    from numba.np import arraymath
finally:
    linalg.ensure_blas = _ensure_blas
arraymath.ensure_blas = _ensure_blas
