"""Imports of libraries on several threads."""

import ast
import subprocess
import sys
from pathlib import Path

import pytest

import texloom.stages

RACE = """
import os, random, sys, threading, time
import numpy, scipy
from texloom.stages.kernels.core.loading import loaded

def fresh(number):
    delay = random.Random(number)
    def wait(event, values):
        if event == "import" and values[0].startswith("scipy") and delay.random() < 0.5:
            time.sleep(delay.uniform(0, 0.003))
    sys.addaudithook(wait)
    failed = []
    def run(name, begin):
        time.sleep(begin)
        try:
            loaded(name)
        except BaseException as error:
            failed.append(error)
    tasks = [("scipy.spatial", 0), ("scipy.sparse.csgraph", delay.uniform(0, 0.03))]
    threads = [threading.Thread(target=run, args=task) for task in tasks]
    for thread in threads: thread.start()
    for thread in threads: thread.join()
    print(*failed, flush=True, end="")
    os._exit(bool(failed))

assert "scipy.linalg" not in sys.modules
for number in range(24):
    child = os.fork()
    if not child:
        fresh(number)
    assert not os.waitpid(child, 0)[1]
"""


@pytest.mark.skipif(sys.platform != "linux", reason="needs fork")
def test_threads_load_parts_of_a_library_that_import_one_another() -> None:
    done = subprocess.run([sys.executable, "-c", RACE], check=False, capture_output=True, text=True)
    assert done.returncode == 0, done.stdout + done.stderr


def test_scipy_is_imported_by_loaded_only() -> None:
    root = Path(texloom.stages.__path__[0])
    found = [
        f"{path}:{node.lineno}"
        for floor in (root, root.parent / "pipelines")
        for path in floor.rglob("*.py")
        for node in ast.walk(ast.parse(path.read_text()))
        if (isinstance(node, ast.Import) and any(alias.name.startswith("scipy") for alias in node.names))
        or (isinstance(node, ast.ImportFrom) and (node.module or "").startswith("scipy"))
    ]
    assert found == []
