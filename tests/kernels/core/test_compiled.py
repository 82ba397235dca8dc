"""Compiling, keeping and loading kernels."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

LOADING = """
import importlib, random, sys, threading

modules = ["resample", "projection", "short_vectors", "row_distance", "compiled"]
random.Random(sys.argv[1]).shuffle(modules)
sys.setswitchinterval(1e-5)
wrong = []


def load(name):
    try:
        importlib.import_module("texloom.stages.kernels.core." + name)
    except ImportError as error:
        wrong.append(error)


threads = [threading.Thread(target=load, args=(name,)) for name in modules]
for thread in threads:
    thread.start()
for thread in threads:
    thread.join()
assert not wrong, wrong
"""

OURS = """
import sys
import numba, numpy as np
from texloom.stages.kernels.core.resample import bilinear, sampled

image, place = np.arange(12, dtype=np.float32).reshape(2, 2, 3), np.full((1, 1, 2), 0.5, np.float32)
means = sampled(image, place).ravel().tolist()


@numba.njit
def largest(plane):
    return np.linalg.norm(np.array([bilinear(plane, 0.0, 0.0), 4.0]))


compiling = "numba.np.arraymath"
print(means, compiling in sys.modules, largest(image[..., 2] + 1), compiling in sys.modules)
"""

OF_OTHERS = """
import sys
import numba
import texloom.stages.kernels.core.compiled


@numba.njit(cache=True)
def double(value):
    return 2 * value


print(double(21), sum(double.stats.cache_hits.values()), "numba.np.arraymath" in sys.modules)
"""


def run(*command: str, **variables: str) -> str:
    known = {**os.environ, **variables}
    done = subprocess.run([sys.executable, *command], check=False, capture_output=True, text=True, env=known)
    assert done.returncode == 0, done.stderr
    return done.stdout


@pytest.mark.parametrize("order", range(4))
def test_threads_may_load_kernels_at_the_same_time(order: int) -> None:
    run("-c", LOADING, str(order))


def test_compiled_kernels_are_loaded_without_what_compiles(tmp_path: Path) -> None:
    """Others, that call them, are still compiled. The folder is its own: others may have taken the first."""
    _, again = (run("-c", OURS, NUMBA_CACHE_DIR=str(tmp_path)) for _ in range(2))
    assert again == "[4.5, 5.5, 6.5] False 5.0 True\n"


def test_compiled_kernels_of_others_are_loaded_as_numba_does(tmp_path: Path) -> None:
    """They may refer to what extensions of Numba define."""
    (tmp_path / "double.py").write_text(OF_OTHERS)
    first, again = (run(str(tmp_path / "double.py")) for _ in range(2))
    assert (first, again) == ("42 0 True\n", "42 1 True\n")
