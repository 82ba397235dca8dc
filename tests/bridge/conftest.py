"""A client whose server has a store of its own."""

from __future__ import annotations

import sys
from collections.abc import Iterator

import numpy as np
import pytest

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
