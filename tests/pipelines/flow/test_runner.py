"""The runner of a flow and the command line."""

from __future__ import annotations

import importlib.util
from pathlib import Path
from typing import Any

import pytest

from tests.pipelines.flows import ANALYSIS, write_flow
from texloom.pipelines.flow.loader import load_flow
from texloom.pipelines.flow.model import Overrides, Runner
from texloom.pipelines.flow.runner import require_installed
from texloom.stages.vocabulary.declare import InputError


def chosen(folder: Path, declared: str, **overrides: Any) -> Runner:
    path = write_flow(folder, f"runner: {declared}\n{ANALYSIS}" if declared else ANALYSIS)
    return load_flow(path, Overrides(runner=overrides)).runner


def test_the_local_runner_is_the_default(tmp_path: Path) -> None:
    assert chosen(tmp_path, "") == Runner("local")


@pytest.mark.parametrize(
    ("declared", "overrides", "expected"),
    [
        ("threads", {}, Runner("threads")),
        ("{name: processes, workers: 4}", {}, Runner("processes", 4)),
        ("{name: dask, address: tcp://head:8786}", {}, Runner("dask", None, "tcp://head:8786")),
        ("", {"name": "processes", "workers": 3}, Runner("processes", 3)),
        ("{name: processes, workers: 4}", {"workers": 2}, Runner("processes", 2)),
        ("{name: processes, workers: 4}", {"name": "processes"}, Runner("processes", 4)),
        ("{name: processes, workers: 4}", {"name": "local"}, Runner("local")),
        ("dask", {"address": "tls://10.0.0.1:1"}, Runner("dask", None, "tls://10.0.0.1:1")),
    ],
)
def test_the_command_line_has_the_last_word(
    tmp_path: Path, declared: str, overrides: dict[str, Any], expected: Runner
) -> None:
    assert chosen(tmp_path, declared, **overrides) == expected


@pytest.mark.parametrize(
    ("declared", "problem"),
    [
        ("procesess", "runner.name: no runner 'procesess'; did you mean 'processes'?"),
        ("[a]", "runner: must be a name or a mapping"),
        ("{}", "runner.name: missing; there are local, threads, processes, dask"),
        ("{workers: 4}", "runner.workers: needs a runner that has it: threads, processes, dask"),
        ("{name: threads, worker: 4}", "runner.worker: unknown; did you mean 'workers'?"),
        ("{name: threads, workers: 0}", "runner.workers: must be a whole number from 1 to 1024, got 0"),
        ("{name: threads, workers: true}", "runner.workers: must be a whole number"),
        ("{name: threads, workers: many}", "runner.workers: must be a whole number from 1 to 1024, got 'many'"),
        ("{name: local, workers: 2}", "runner.workers: the runner 'local' has none"),
        ("{name: threads, address: tcp://head:1}", "runner.address: the runner 'threads' has none"),
        ("{name: dask, address: head}", "runner.address: must be like 'tcp://head:8786', got 'head'"),
        (
            "{name: dask, address: tcp://head:1, workers: 2}",
            "runner.workers: a running cluster has its own workers",
        ),
    ],
)
def test_wrong_runners_of_flows(tmp_path: Path, declared: str, problem: str) -> None:
    with pytest.raises(InputError) as refused:
        chosen(tmp_path, declared)
    assert problem in str(refused.value)
    assert str(tmp_path / "flow.yaml") in str(refused.value)


@pytest.mark.parametrize(
    ("overrides", "problem"),
    [
        ({"workers": 4}, "--workers: needs a runner that has it: threads, processes, dask"),
        ({"address": "tcp://head:1"}, "--address: needs a runner that has it: dask"),
        ({"name": "local", "workers": 4}, "--workers: the runner 'local' has none; threads, processes, dask have"),
        ({"name": "processes", "address": "tcp://head:1"}, "--address: the runner 'processes' has none"),
        ({"name": "dask", "address": "head:8786"}, "--address: must be like"),
    ],
)
def test_wrong_runners_of_the_command_line(tmp_path: Path, overrides: dict[str, Any], problem: str) -> None:
    with pytest.raises(InputError) as refused:
        chosen(tmp_path, "", **overrides)
    assert str(refused.value).startswith(problem)


def test_dask_is_an_extra(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(importlib.util, "find_spec", lambda _: None)
    require_installed(Runner("processes"))
    with pytest.raises(InputError, match=r"pip install 'texloom\[dask\]'"):
        require_installed(Runner("dask"))
