"""How kernels are compiled, and how their machine code is kept and loaded.

Before it loads a kernel, Numba imports all that it can compile, and `scipy.linalg`, which takes longer than its own
import. Kernels here refer to none of that, so they have a cache of their own that does without.
"""

import contextlib
import functools
from pathlib import Path
from typing import Any

import numba  # all of it before its parts, which other threads may be loading
from numba.core.caching import CompileResultCacheImpl, FunctionCache, IndexDataCacheFile
from numba.core.runtime import rtsys

from texloom.stages.kernels.core.kernel_folder import kernel_digest, other_folders, taken_folder


class Locator:
    """Tells Numba where the machine code of a kernel is kept, and of which sources it is."""

    def __init__(self, function: Any, file: str, folder: Path):
        self._py_file = file  # Numba names it in warnings
        self._line = function.__code__.co_firstlineno
        self._folder = folder / self.below(function)

    @staticmethod
    def below(function: Any) -> str:
        """Where in a folder; never do files of other sources or of another Numba take the place of these."""
        return f"{kernel_digest()}-{numba.__version__}/{function.__module__.rpartition('.')[0]}"

    @classmethod
    def from_function(cls, function: Any, file: str) -> "Locator | None":
        """None where nothing can be kept."""
        folder = taken_folder()
        return None if folder is None else cls(function, file, folder)

    def get_cache_path(self) -> str:
        """The folder."""
        return str(self._folder)

    def ensure_cache_path(self) -> None:
        """Make the folder."""
        self._folder.mkdir(parents=True, exist_ok=True)

    def get_source_stamp(self) -> str:
        """What has to be equal for the machine code to be used."""
        return kernel_digest()

    def get_disambiguator(self) -> str:
        """Tells kernels of one name in a file apart."""
        return str(self._line)


class _Parts(CompileResultCacheImpl):  # type: ignore[misc]
    _locator_classes = (Locator,)


class _Files(IndexDataCacheFile):  # type: ignore[misc]
    """Adds to this process's folder, and looks in those of others too."""

    def __init__(self, below: str, *parts: Any):
        super().__init__(*parts)
        self._below, self._parts = below, parts[1:]

    def load(self, key: Any) -> Any:
        """See `IndexDataCacheFile`. What another process is writing is not there yet."""
        found = super().load(key)
        if found is None:
            for folder in other_folders():
                with contextlib.suppress(OSError):
                    found = IndexDataCacheFile(str(folder / self._below), *self._parts).load(key)
                if found is not None:
                    break
        return found


class _Cache(FunctionCache):  # type: ignore[misc]
    _impl_class = _Parts

    def __init__(self, function: Any):
        super().__init__(function)
        of_function = (self._impl.filename_base, self._impl.locator.get_source_stamp())
        self._cache_file = _Files(Locator.below(function), self.cache_path, *of_function)

    def load_overload(self, signature: Any, target: Any) -> Any:
        """See `FunctionCache`."""
        rtsys.initialize(target)  # what allocates arrays
        return self._load_overload(signature, target)


def compiled(function: Any = None, **options: Any) -> Any:
    """Decorate a kernel: `numba.njit` with ``nogil``, and with ``options``; its machine code is kept.

    C never calls kernels: without the function for that, they compile in less time.
    """
    if function is None:
        return functools.partial(compiled, **options)
    kernel = numba.njit(nogil=True, no_cfunc_wrapper=True, **options)(function)
    if kernel is not function and taken_folder() is not None:  # else Numba is switched off, or nothing can be kept
        kernel._cache = _Cache(function)
    return kernel


inner = functools.partial(compiled, no_cpython_wrapper=True)
"""decorator of a kernel that Python does not call, with or without further options, which compiles in less time"""
