"""Loading Numba from several threads."""

from __future__ import annotations

import subprocess
import sys

import pytest

LOADING = """
import importlib, random, sys, threading

modules = ["resample", "projection", "short_vectors", "row_distance"]
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
from numba.np import arraymath, linalg

assert arraymath.ensure_blas is linalg.ensure_blas
assert "scipy.linalg" not in sys.modules
"""


@pytest.mark.parametrize("order", range(4))
def test_threads_may_load_kernels_at_the_same_time(order: int) -> None:
    done = subprocess.run([sys.executable, "-c", LOADING, str(order)], check=False, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
