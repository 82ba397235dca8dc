"""A client whose server has a store of its own."""

from __future__ import annotations

import contextlib
import importlib
import importlib.util
import sys
import types
import zipfile
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests.conftest import ROOT
from tests.studio.conftest import exemplar
from texloom.pipelines.bridge.client import Client

COMMAND = (sys.executable, "-m", "texloom")
QUICK = {"size": 48, "seed": 3}
"""options of `quilting`, which takes no time with them"""


@pytest.fixture(scope="module")
def store(tmp_path_factory: pytest.TempPathFactory) -> str:
    return str(tmp_path_factory.mktemp("bridge") / "store")


@pytest.fixture(scope="module")
def client(store: str) -> Iterator[Client]:
    with Client(COMMAND, store=store) as client:
        yield client


@pytest.fixture(scope="session")
def picture() -> np.ndarray:
    """A small exemplar, sRGB."""
    return exemplar()


def builder() -> Any:
    """The module that builds the archives of plug-ins."""
    spec = importlib.util.spec_from_file_location("build_plugins", ROOT / "hosts" / "build.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.fixture(scope="module")
def archive(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The archive of the plug-in for the program that the module of tests names in ``PROGRAM``."""
    return builder().build(request.module.PROGRAM, tmp_path_factory.mktemp("dist"))


@pytest.fixture(scope="module")
def plugin(
    request: pytest.FixtureRequest, archive: Path, tmp_path_factory: pytest.TempPathFactory
) -> Iterator[Callable[[str], Any]]:
    """Its modules by their names, from the archive."""
    folder = tmp_path_factory.mktemp("plugin")
    zipfile.ZipFile(archive).extractall(folder)
    (controller,) = folder.rglob("controller.py")
    with _modules(f"{request.module.PROGRAM}_texloom", controller.parent) as modules:
        yield modules


@contextlib.contextmanager
def _modules(package: str, folder: Path) -> Iterator[Callable[[str], Any]]:
    """The modules of a plug-in by their names, without its ``__init__``, which imports the program."""
    made = types.ModuleType(package)
    made.__path__ = [str(folder)]
    with pytest.MonkeyPatch.context() as patched:
        patched.setitem(sys.modules, package, made)
        yield lambda name: importlib.import_module(f"{package}.{name}")
        for name in [one for one in sys.modules if one.startswith(f"{package}.")]:
            patched.delitem(sys.modules, name)
