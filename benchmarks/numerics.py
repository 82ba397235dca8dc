"""Whether pixels are the same with other vector instructions and another BLAS.

    python -m benchmarks.numerics

Runs some flows of `benchmarks.record` twice: as this machine does, and as one without AVX would. Prints the arrays
that differ and exits with 1 if there are any. Measures and their pictures decide no pixels and are left out.
"""

from __future__ import annotations

import sys
import tempfile
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

from benchmarks import record

FLOWS = ("self_tuning", "self_tuning, tileable", "near_regular", "quilting", "per_pixel", "photo_to_texture")
OTHER = {
    "OPENCV_CPU_DISABLE": "SSE4.1,SSE4.2,AVX,FP16,AVX2,AVX512-SKX",
    "NPY_DISABLE_CPU_FEATURES": "X86_V3 X86_V4 AVX512_ICL AVX512_SPR",
    "NUMBA_CPU_NAME": "generic",
    "NUMBA_CPU_FEATURES": "",
    "OPENBLAS_CORETYPE": "Nehalem",
}
"""what libraries read when they are loaded"""
MEASURES = ("scores.", "report.", "preview.")


def main() -> None:
    """Compare the digests of all arrays that are not measures."""
    runs = {label: record.RUNS[label] for label in FLOWS}
    record.RUNS.clear()
    record.RUNS.update(runs)
    with tempfile.TemporaryDirectory() as folder:
        record.make_sources(Path(folder))
        other = OTHER | {"NUMBA_CACHE_DIR": f"{folder}/kernels"}
        with ThreadPoolExecutor() as pool:  # each runs in processes of its own
            ways = [pool.submit(record.digests, sys.executable, Path(folder), **way) for way in ({}, other)]
        here, there = (way.result() for way in ways)
    names = [name for name in {**here, **there} if not name.split(": ")[1].startswith(MEASURES)]
    differing = [name for name in names if here.get(name) != there.get(name)]
    print("\n".join([*differing, f"{len(differing)} of {len(names)} arrays differ"]))
    sys.exit(bool(differing))


if __name__ == "__main__":
    main()
