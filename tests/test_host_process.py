"""texloom leaves the process that imports it as it was: environment, threads and classes of libraries, logging."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

STATE = """
import importlib.util, json, locale, logging, os, signal, sys, warnings

def state():
    import cv2, numba, numpy, OpenEXR, threadpoolctl
    from numba.core import caching, config, dispatcher
    umask = os.umask(0)
    os.umask(umask)
    classes = [one for module in (caching, dispatcher) for one in vars(module).values() if isinstance(one, type)]
    return {
        "environment": dict(os.environ),
        "folder": os.getcwd(),
        "umask": umask,
        "locale": locale.setlocale(locale.LC_ALL),
        "signals": {number: repr(signal.getsignal(number)) for number in signal.valid_signals()},
        "hooks": [repr(sys.excepthook), repr(sys.stdout), repr(sys.stderr), repr(sys.meta_path), sys.path],
        "limits": [sys.getrecursionlimit(), sys.getswitchinterval()],
        "warnings": [repr(warnings.filters), repr(warnings.showwarning)],
        "logging": {
            name: [one.level, one.propagate, one.disabled, repr(one.handlers), repr(one.filters)]
            for name in ("", "texloom", "numba", "PIL", "trimesh")
            for one in [logging.getLogger(name)]
        },
        "numpy": [numpy.geterr(), numpy.get_printoptions()],
        "numba": {f"{one.__qualname__}.{name}": id(value) for one in classes for name, value in vars(one).items()
                  if not name.startswith(("_abc_", "__"))},
        "numba's settings": {name: repr(value) for name, value in vars(config).items() if name.isupper()},
        "OpenCV": [cv2.getNumThreads(), cv2.useOptimized(), cv2.utils.logging.getLogLevel()],
        "OpenEXR": OpenEXR.global_thread_count(),
        "BLAS": {library["filepath"]: library["num_threads"] for library in threadpoolctl.threadpool_info()},
    }

def stand_ins():
    '''Modules that another one of the same name would be found for, or none.'''
    return sorted(
        name for name, module in sys.modules.items()
        if name != "__main__" and not name.startswith("texloom")
        and isinstance(module, type(sys)) and module.__spec__ is None and name not in BEFORE
    )

def changes(before, after):
    found = [name for name in before if name != "BLAS" and before[name] != after[name]]
    return found + [path for path, threads in before["BLAS"].items() if after["BLAS"][path] != threads]
"""

HOST = """
import cv2, numpy as np, numba, OpenEXR
import PIL.Image, scipy.linalg, scipy.sparse, scipy.special  # which add filters of warnings themselves
cv2.setNumThreads(2)
BEFORE = set(sys.modules)
before = state()

import texloom
rgb = np.random.default_rng(1).integers(0, 256, (48, 48, 3), np.uint8)
{call}
import jaxtyping._import_hook, unittest.mock
print(json.dumps([changes(before, state()), stand_ins(), jaxtyping._import_hook.patch is unittest.mock.patch]))
"""

FAILING = """
from texloom.pipelines.store.store import Store
def fail(*_, **__): raise RuntimeError("no luck")
Store.save = fail
try:
    texloom.synthesize(rgb, method="quilting", size=48, store="s")
except Exception as error:
    assert "no luck" in str(error.__cause__ or error), error
else:
    raise AssertionError
"""

CALLS = {
    "import": "[getattr(texloom, name) for name in texloom.__all__]",
    "synthesize": "texloom.synthesize(rgb, method='quilting', size=48, store='s')",
    "run": "texloom.run('quilting', {'exemplar': rgb}, size=48, store='s', out='o')",
    "plan": "texloom.plan('quilting', {'exemplar': rgb}, store='s')",
    "a stage": "texloom.stages.autocorrelation(rgb)",
    "Canvas": "texloom.Canvas(rgb, rgb[..., 0], (48, 48), values=0.2).paint(np.full((8, 8, 1), 0.9, np.float32))",
    "sessions": "texloom.LatticeSession(rgb).span((2, 2), (2, 20), (20, 2)), texloom.PhotoSession(rgb).propose()",
    "a stage that fails": FAILING,
    "a wrong request": """
try:
    texloom.stages.quilting(rgb, size=(0, 48))
except texloom.InputError:
    pass
else:
    raise AssertionError
""",
}


def run_host(program: str, folder: Path, **variables: str) -> str:
    known = {
        name: value
        for name, value in os.environ.items()
        if not name.startswith(("OPENBLAS_", "OPENCV_", "PREFECT_", "TEXLOOM_"))
    }
    done = subprocess.run(
        [sys.executable, "-c", program],
        check=False,
        capture_output=True,
        text=True,
        cwd=folder,
        env=known | variables,
    )
    assert done.returncode == 0, done.stderr
    return done.stdout


@pytest.mark.parametrize("call", CALLS.values(), ids=CALLS)
def test_nothing_of_the_host_process_changes(call: str, tmp_path: Path) -> None:
    said = run_host(STATE + HOST.replace("{call}", call), tmp_path, OPENBLAS_NUM_THREADS="2")
    assert json.loads(said.splitlines()[-1]) == [[], [], True]


DURING = """
import sys, threading
import numpy as np
from texloom.stages.vocabulary.libraries import single_threaded
assert "cv2" not in sys.modules and "threadpoolctl" not in sys.modules

both, ended = threading.Barrier(2), threading.Event()

def first():
    with single_threaded():
        both.wait()
    ended.set()

with single_threaded():
    import cv2, threadpoolctl
    blas = lambda: {one["num_threads"] for one in threadpoolctl.threadpool_info() if one["user_api"] == "blas"}
    threading.Thread(target=first).start()
    both.wait()
    ended.wait()
    during = cv2.getNumThreads(), blas()
    try:
        with single_threaded():
            raise KeyError
    except KeyError:
        during = during, (cv2.getNumThreads(), blas())
print(during, blas())
cv2.setNumThreads(cv2.getNumThreads() + 1)
with single_threaded():
    pass
print(cv2.getNumThreads())
"""


def test_libraries_are_limited_until_the_last_computation_ends(tmp_path: Path) -> None:
    said = run_host(DURING, tmp_path, OPENBLAS_NUM_THREADS="2").splitlines()
    assert said[0] == "((1, {1}), (1, {1})) {2}"
    assert int(said[1]) >= 2


MATRICES = """
import hashlib, sys
if "first" in sys.argv:
    import numpy
import texloom
import numpy as np
rgb = np.random.default_rng(1).integers(0, 256, (64, 64, 3), np.uint8)
made = texloom.synthesize(rgb, method="per_pixel", size=64, store=sys.argv[1])
print(hashlib.sha256(np.ascontiguousarray(made.image)).hexdigest())
"""


def test_a_host_whose_numpy_has_two_threads_gets_the_same_bits(tmp_path: Path) -> None:
    made = {
        run_host(f"import sys\nsys.argv[1:] = {arguments}\n{MATRICES}", tmp_path, **variables)
        for arguments, variables in [
            (["s1"], {"OPENBLAS_NUM_THREADS": "1", "TEXLOOM_THREADS": "1"}),
            (["s2", "first"], {"OPENBLAS_NUM_THREADS": "2", "TEXLOOM_THREADS": "2"}),
            (["s4", "first"], {"OPENBLAS_NUM_THREADS": "2", "TEXLOOM_THREADS": "4"}),
        ]
    }
    assert len(made) == 1


def test_the_command_limits_its_own_process(tmp_path: Path) -> None:
    program = """
import os, sys
sys.argv[1:] = ["flows", "--json"]
from texloom.__main__ import main
try:
    main()
except SystemExit:
    import cv2, threadpoolctl, numpy
    from texloom.stages.vocabulary import libraries
    blas = {one["num_threads"] for one in threadpoolctl.threadpool_info()}
    print(libraries._is_limited, cv2.getNumThreads(), blas)
"""
    assert run_host(program, tmp_path).splitlines()[-1] == "True 1 {1}"
