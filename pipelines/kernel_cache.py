"""Where compiled kernels are kept."""

from __future__ import annotations

import contextlib
import hashlib
import os
from pathlib import Path


def keep_kernels() -> None:
    """Keep compiled kernels in the user's cache, by the digest of all kernels.

    Numba by itself sees a change in a kernel's own file only, not in those that it calls.
    """
    if "NUMBA_CACHE_DIR" in os.environ:
        return
    import platformdirs

    folder = platformdirs.user_cache_path("texloom") / f"kernels-{_kernel_digest()}"
    with contextlib.suppress(OSError):
        folder.mkdir(parents=True, exist_ok=True)
        if os.access(folder, os.W_OK):
            os.environ["NUMBA_CACHE_DIR"] = str(folder)


def _kernel_digest() -> str:
    import stages.kernels

    files = sorted(Path(next(iter(stages.kernels.__path__))).glob("*.py"))
    return hashlib.sha256(b"".join(path.read_bytes() for path in files)).hexdigest()[:16]
