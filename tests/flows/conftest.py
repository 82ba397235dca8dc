"""Shipped flows, run whole on small pictures."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from tests.pipelines.flows import Events
from tests.pipelines.media.test_material_export import saved
from texloom.pipelines.engine.run import Run
from texloom.pipelines.engine.scheduler import execute
from texloom.pipelines.flow.loader import find_flow, load_flow
from texloom.pipelines.flow.model import Overrides
from texloom.pipelines.store.store import Store


@pytest.fixture(scope="module")
def store(tmp_path_factory: pytest.TempPathFactory) -> Store:
    return Store(tmp_path_factory.mktemp("store"))


@pytest.fixture
def opened(store: Store) -> Callable[..., Run]:
    """Opens a flow with sources and params."""

    def run_of(flow: str, sources: dict[str, Path], seed: int | None = None, **params: str) -> Run:
        overrides = Overrides({name: str(path) for name, path in sources.items()}, params, seed=seed)
        return Run(load_flow(find_flow(flow), overrides), store)

    return run_of


def measures_of(path: Path) -> Any:
    """The measures of a table of scores; all of any other table."""
    table = json.loads(path.read_text())
    return table.get("measures", table) if isinstance(table, dict) else table


@pytest.fixture
def ran(opened: Callable[..., Run]) -> Callable[..., dict[str, Any]]:
    """Runs a flow and reads its exports: pictures as integers, tables, else paths."""
    read = {".png": saved, ".json": measures_of}

    def exports(
        out: Path, flow: str, sources: dict[str, Path], seed: int | None = None, **params: str
    ) -> dict[str, Any]:
        files = execute(opened(flow, sources, seed, **params), Events(), out)
        return {name: read.get(path.suffix, Path)(path) for name, path in files.items()}

    return exports
