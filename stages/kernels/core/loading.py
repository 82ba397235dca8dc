"""Imports of libraries whose parts import one another, inside functions that several threads may be in.

CPython has a lock for each module. Where two threads come into a circle of imports from two sides, it gives one of
them a module that is not complete, or an error. Numba and SciPy are such circles, and Numba imports parts of SciPy.
"""

import importlib
import itertools
import threading
from typing import Any

_turn = threading.RLock()


def loaded(name: str) -> Any:
    """Import the module called ``name`` after the packages it lies in, while no other thread does so here.

    Raises
    ------
    ImportError : there is none.

    Examples
    --------
    >>> loaded("scipy.ndimage").uniform_filter([0.0, 3.0, 0.0], 3)
    array([1., 1., 1.])
    """
    *packages, _ = itertools.accumulate(name.split("."), "{}.{}".format)
    with _turn:
        for package in packages:  # which waits for a thread that imports it elsewhere, and holds no lock meanwhile
            importlib.import_module(package)
        return importlib.import_module(name)
