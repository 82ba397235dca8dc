"""Runs as flow runs of a Prefect server: what it shows, and what its parameters repeat."""

from __future__ import annotations

import contextlib
import contextvars
import dataclasses
import importlib.metadata
import json
import multiprocessing
import os
import re
import shutil
import signal
import subprocess
import sys
import threading
from collections.abc import Iterator
from datetime import timedelta
from pathlib import Path
from typing import Any

import httpx
import numpy as np
import PIL.Image
import pytest
from prefect.client.orchestration import SyncPrefectClient
from prefect.client.schemas.objects import FlowRun
from prefect.settings import PREFECT_API_URL, PREFECT_HOME, temporary_settings

from tests.conftest import ROOT
from tests.pipelines.engine.prefect.server import Server, wait_for
from tests.pipelines.flows import ANALYSIS, SYNTHESIS, Events, files, open_run, run_local, write_flow
from texloom.pipelines.engine.events import Event, StepStarted
from texloom.pipelines.engine.executors import dask_cluster
from texloom.pipelines.engine.prefect import flow_run, task_runs
from texloom.pipelines.engine.run import Run, StepFailedError
from texloom.pipelines.flow.comparison import comparison_flow
from texloom.pipelines.flow.model import Overrides
from texloom.pipelines.flow.seed_sheet import open_flow
from texloom.pipelines.store.store import Store
from texloom.stages.vocabulary.declare import InputError


def execute(run: Run, out: Path | None = None) -> Events:
    return run_local(run, out or run.store.root / "out")


def test_a_deployment_replaces_nothing_that_it_reads(tmp_path: Path) -> None:
    path = write_flow(tmp_path)
    path.write_text(path.read_text().replace("structure.png", "exemplar.png"))
    before = (tmp_path / "exemplar.png").read_bytes()
    with pytest.raises(InputError, match="would replace a source of the flow"):
        flow_run.texloom_flow.fn(str(path), store=str(tmp_path / "artifacts"), out=str(tmp_path))
    assert (tmp_path / "exemplar.png").read_bytes() == before
    assert not (tmp_path / "artifacts").exists()


@pytest.fixture(scope="module")
def server(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Server]:
    made = Server(tmp_path_factory.mktemp("server"))
    try:
        with temporary_settings({PREFECT_API_URL: made.url, PREFECT_HOME: made.folder / "home"}):
            yield made
    finally:
        made.stop()


@pytest.mark.usefixtures("server")
@pytest.mark.filterwarnings("ignore")
def test_a_server_shows_steps_progress_and_pictures(tmp_path: Path) -> None:
    from prefect.client.orchestration import get_client

    path = write_flow(tmp_path, SYNTHESIS)
    execute(
        open_run(path, start__size="48", texture__occurrence="11")
    )  # what the local engine has made, the server's finds
    listener = Events()
    run = open_run(path, start__size="48", texture__occurrence="12")
    exports = flow_run.execute_as_flow_run(run, listener, tmp_path / "out")
    assert exports["texture.exr"].exists()
    assert listener.states == {"start": "cached", "texture": "ran"}
    with get_client(sync_client=True) as client:
        assert "synthesis" in {entry.name for entry in client.read_flows()}
        start, texture = sorted(client.read_task_runs(), key=lambda task: task.name)
    assert (start.name, start.state.name) == ("start", "Cached")
    assert (texture.name, texture.state.name) == ("texture", "Completed")
    assert texture.total_run_time > timedelta(0)
    assert [given.id for given in texture.task_inputs["wait_for"]] == [start.id]
    _, _, artifacts = shown()
    ours = {name: artifact.type for name, artifact in artifacts.items() if artifact.task_run_id == texture.id}
    assert ours == {
        "synthesis-texture": "image",
        "synthesis-texture-scale": "image",
        "synthesis-texture-progress": "progress",
    }
    assert execute(open_run(path, start__size="48", texture__occurrence="12")).states == {
        "start": "cached",
        "texture": "cached",
    }


@pytest.mark.usefixtures("server")
@pytest.mark.filterwarnings("ignore")
def test_steps_of_a_cluster_are_shown(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """With pictures of their scales, which come from its workers."""
    pytest.importorskip("distributed")
    addresses = []

    class Cluster(dask_cluster.DaskCluster):
        def __init__(self, *given: Any):
            super().__init__(*given)
            addresses.append(self.client.scheduler.address)

    monkeypatch.setattr(dask_cluster, "DaskCluster", Cluster)
    listener = Events()
    run = open_run(write_flow(tmp_path, f"runner: {{name: dask, workers: 1}}\n{SYNTHESIS}"), start__size="32")
    flow_run.execute_as_flow_run(run, listener, tmp_path / "out")
    assert listener.states == {"start": "ran", "texture": "ran"}
    assert [address[:16] for address in addresses] == ["tls://127.0.0.1:"]
    _, states, artifacts = shown()
    assert states == [("start", "Completed"), ("texture", "Completed")]
    assert {"synthesis-start", "synthesis-texture", "synthesis-texture-scale"} <= set(artifacts)


SCORED = """
flow: scored
sources:
  exemplar: exemplar.png
steps:
  edges: {stage: analysis.edges, inputs: {image: exemplar}}
  start: {stage: synthesis.initialise, inputs: {image: exemplar}, params: {size: 16, method: pixels}}
  scores: {stage: evaluation.metrics, inputs: {exemplar: exemplar, image: start.image}}
  all: {stage: evaluation.tabulate, gather: {tables: scores.table}}
exports:
  edges.png: edges.strength
  start.png: start.image
  all.json: all.table
"""


def shown() -> tuple[FlowRun, list[tuple[str, str]], dict[str, Any]]:
    """The last flow run, its task runs with their states, its artifacts."""
    from prefect.client.orchestration import get_client
    from prefect.client.schemas.filters import ArtifactFilter, FlowRunFilter

    with get_client(sync_client=True) as client:
        run = max(client.read_flow_runs(), key=lambda run: run.created or run.start_time)
        mine = FlowRunFilter.model_validate({"id": {"any_": [run.id]}})
        tasks = client.read_task_runs(flow_run_filter=mine)
        artifacts = client.read_artifacts(
            artifact_filter=ArtifactFilter.model_validate({"flow_run_id": {"any_": [run.id]}})
        )
    states = sorted((task.name, task.state.name) for task in tasks if task.state is not None)
    return run, states, {artifact.key or "": artifact for artifact in artifacts}


@pytest.mark.usefixtures("server")
@pytest.mark.filterwarnings("ignore")
def test_any_runner_is_a_flow_run_that_its_parameters_repeat(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    write_flow(tmp_path, SCORED, side=24)
    monkeypatch.chdir(tmp_path)
    overrides = Overrides(
        {"exemplar": "exemplar.png"},
        {"edges.finest": "2.5"},
        seeds=range(4, 6),
        runner={"name": "threads", "workers": 2},
    )
    opened = Run(open_flow(Path("flow.yaml"), overrides), Store(Path("artifacts")))
    exports = flow_run.execute_as_flow_run(opened, Events(), Path("out"))
    assert set(exports) == {"all.json", "edges.png", "contact_sheet.png", "4/start.png", "5/start.png"}
    steps = {"edges", "all", "contact_sheet"}
    steps |= {f"{seed}/{step}" for seed in (4, 5) for step in ("start", "scores", "thumbnail")}
    run, states, artifacts = shown()
    assert states == sorted((step, "Completed") for step in steps)
    assert run.name == "scored, exemplar.png, 2 seeds"
    assert {name: value for name, value in run.parameters.items() if value not in (None, False)} == {
        "flow": str(tmp_path / "flow.yaml"),
        "source": {"exemplar": str(tmp_path / "exemplar.png")},
        "set": {"edges.finest": 2.5},
        "export": {},
        "seeds": [4, 5],
        "store": str(tmp_path / "artifacts"),
        "out": str(tmp_path / "out"),
        "runner": "threads",
        "workers": 2,
    }
    assert {row["name"] for row in json.loads(artifacts["scored-all-scores"].data)} == {"4", "5"}
    assert artifacts["scored-scores-scores"].type == "table"
    first = files(tmp_path / "out")

    (tmp_path / "elsewhere").mkdir()
    monkeypatch.chdir(tmp_path / "elsewhere")
    again = tmp_path / "again"
    returned = flow_run.texloom_flow(**{**run.parameters, "out": str(again)})
    assert returned == {name: str(again / name) for name in exports}
    run, states, artifacts = shown()
    assert states == sorted((step, "Cached") for step in steps)
    assert files(again) == first
    assert artifacts["scored-edges"].type == "image", "cached results are shown too"


@pytest.mark.usefixtures("server")
@pytest.mark.filterwarnings("ignore")
def test_the_parameters_of_a_comparison_repeat_it(tmp_path: Path) -> None:
    path = write_flow(tmp_path, SCORED.replace("edges.png: edges.strength", "scores.json: scores.table"), side=24)
    path.write_text(re.sub(r".* all.*\n", "", path.read_text()))
    (tmp_path / "theirs").mkdir()
    shutil.copy(tmp_path / "exemplar.png", tmp_path / "theirs")
    names = [str(path), str(shutil.copy(path, tmp_path / "other.yaml")), f"theirs={tmp_path / 'theirs'}"]
    flow = comparison_flow(
        names,
        Overrides(params={"flow_start.size": "16x20", "other_start.size": "16x20"}, seeds=2),
        str(tmp_path / "exemplar.png"),
    )
    opened = Run(flow, Store(tmp_path / "artifacts"))
    exports, steps = flow_run.execute_as_flow_run(opened, Events(), tmp_path / "out"), len(opened.plan())
    run, states, _ = shown()
    assert run.parameters["flow"] == names
    assert {state for _, state in states} <= {"Completed", "Cached"}
    again = flow_run.texloom_flow(**{**run.parameters, "out": str(tmp_path / "again")})
    assert set(again) == set(exports)
    assert len(states) == steps
    assert shown()[1] == [(step, "Cached") for step, _ in states]
    assert files(tmp_path / "again") == files(tmp_path / "out")


@pytest.mark.usefixtures("server")
@pytest.mark.filterwarnings("ignore")
@pytest.mark.parametrize("problem", [ZeroDivisionError("as asked"), KeyboardInterrupt()])
def test_what_ends_a_run_ends_its_task_run(tmp_path: Path, problem: BaseException) -> None:
    run = open_run(write_flow(tmp_path))

    def raises(**_: Any) -> None:
        raise problem

    step = run.flow.steps["structure"]
    broken = dataclasses.replace(step, stage=dataclasses.replace(step.stage, function=raises))
    run.flow = dataclasses.replace(run.flow, steps={**run.flow.steps, "structure": broken})
    is_failure = isinstance(problem, Exception)
    with pytest.raises(StepFailedError if is_failure else KeyboardInterrupt):
        flow_run.execute_as_flow_run(run, Events(), tmp_path / "out")
    assert shown()[1] == [("edges", "Completed"), ("structure", "Failed" if is_failure else "Crashed")]


@pytest.mark.usefixtures("server")
@pytest.mark.filterwarnings("ignore")
def test_a_server_that_falls_silent_stops_no_work(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def refused(*_: Any, **__: Any) -> None:
        raise httpx.ConnectError("refused")

    monkeypatch.setattr(SyncPrefectClient, "create_task_run", refused)
    monkeypatch.setattr(task_runs, "_PATIENCE", 1.0)
    listener = Events()
    flow_run.execute_as_flow_run(open_run(write_flow(tmp_path)), listener, tmp_path / "out")
    assert listener.states == {"edges": "ran", "structure": "ran", "distance": "ran"}
    assert any("the Prefect server does not answer: it lacks" in note for note in listener.notes)
    assert shown()[1] == []


@pytest.mark.usefixtures("server")
@pytest.mark.filterwarnings("ignore")
@pytest.mark.parametrize("problem", [None, ZeroDivisionError("as asked")])
def test_a_server_that_does_not_hear_the_end_changes_nothing(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, problem: Exception | None
) -> None:
    """What a run has made is there, and what has ended it is still told."""
    run = open_run(write_flow(tmp_path))

    def silent(*_: Any, **__: Any) -> None:
        raise httpx.ConnectError("refused")

    def ends(given: Run, *_: Any) -> dict[str, Path]:
        monkeypatch.setattr(SyncPrefectClient, "set_flow_run_state", silent)
        if problem is not None:
            raise problem
        return {"a.png": given.store.root / "a.png"}

    monkeypatch.setattr(flow_run, "compute", ends)
    listener = Events()
    with contextlib.nullcontext() if problem is None else pytest.raises(ZeroDivisionError):
        assert list(flow_run.execute_as_flow_run(run, listener, tmp_path / "out")) == ["a.png"]
    assert any("does not know that the run has ended" in note for note in listener.notes)


@pytest.mark.usefixtures("server")
@pytest.mark.filterwarnings("ignore")
def test_a_task_run_whose_worker_is_killed_has_crashed(tmp_path: Path) -> None:
    run = open_run(write_flow(tmp_path, f"runner: {{name: processes, workers: 1}}\n{ANALYSIS}", side=1200))

    def kill() -> None:
        """What is shown comes later than what happens: a worker that is not stopped may end the step before."""
        try:
            wait_for(lambda: shown()[1] == [("edges", "Running")])
        finally:
            for child in multiprocessing.active_children():
                child.kill()

    class Stopping(Events):
        def __call__(self, event: Event) -> None:
            super().__call__(event)
            if event == StepStarted("edges") and not killer.ident:
                for child in multiprocessing.active_children():
                    os.kill(child.pid or 0, signal.SIGSTOP)
                killer.start()

    killer = threading.Thread(target=contextvars.copy_context().run, args=(kill,))
    flow_run.execute_as_flow_run(run, Stopping(), tmp_path / "out")
    killer.join()
    completed = [(step, "Completed") for step in ("distance", "edges", "structure")]
    assert shown()[1] == sorted([("edges", "Crashed"), *completed])


def test_a_server_that_does_not_answer_is_an_error(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = write_flow(tmp_path)
    environment = {**os.environ, "PREFECT_API_URL": "http://127.0.0.1:9/api"}
    given = [sys.executable, "-m", "texloom", "run", str(path), "--store", str(tmp_path / "artifacts")]
    done = subprocess.run(given, capture_output=True, text=True, env=environment, check=False)
    assert done.returncode == 2
    assert "no Prefect server answers at PREFECT_API_URL=http://127.0.0.1:9/api" in done.stderr
    assert len(done.stderr.splitlines()) == 1
    assert not (tmp_path / "artifacts").exists()


LIBRARY = """
flow: library
sources:
  exemplar: {each: "library/*.png"}
steps:
  edges: {stage: analysis.edges, inputs: {image: exemplar}, params: {detector: gradient}}
exports:
  edges.png: edges.strength
"""


@pytest.mark.long
def test_two_workers_run_the_deployments(server: Server, tmp_path: Path, rng: np.random.Generator) -> None:
    place = tmp_path / "deployed"
    (place / "library").mkdir(parents=True)
    for name in ("a", "b"):
        PIL.Image.fromarray(rng.integers(0, 256, (32, 32, 3), np.uint8)).save(place / "library" / f"{name}.png")
    (place / "library.yaml").write_text(LIBRARY)
    shutil.copy(ROOT / "prefect.yaml", place)
    worker = ("worker", "start", "--pool", "texloom", "--limit", "1", "--name")
    server.start(*worker, "one", "--type", "process")  # which creates the pool
    wait_for(lambda: server.post("work_pools/filter", {}))
    server.start(*worker, "two")
    server.call("deploy", "--all", "--no-prompt", folder=place)
    known = {entry["name"]: entry for entry in wait_for(lambda: server.post("deployments/filter", {}))}
    assert set(known) == {"run", "nightly"}
    assert [entry["schedule"]["cron"] for entry in known["nightly"]["schedules"]] == ["0 2 * * *"]

    common = {"flow": str(place / "library.yaml"), "source": {}, "store": str(place / "store"), "runner": "local"}
    runs = [
        server.post(
            f"deployments/{known[name]['id']}/create_flow_run",
            {"parameters": {**common, "out": str(place / f"out_{name}")}, "state": {"type": "SCHEDULED"}},
        )["id"]
        for name in ("run", "nightly")
    ]

    def states() -> list[str] | None:
        found = server.post("flow_runs/filter", {"flow_runs": {"id": {"any_": runs}}}) or []
        over = [run for run in found if run["state_type"] in ("COMPLETED", "FAILED", "CRASHED")]
        return [run["state_type"] for run in over] if len(over) == 2 else None

    try:
        assert wait_for(states) == ["COMPLETED", "COMPLETED"], server.logs()
    except TimeoutError:
        pytest.fail(server.logs())
    for name in ("run", "nightly"):
        assert sorted(path.parent.name for path in (place / f"out_{name}").rglob("edges.png")) == ["a", "b"]
    workers = wait_for(lambda: server.post("work_pools/texloom/workers/filter", {}))
    assert {entry["name"] for entry in workers} == {"one", "two"}
    if not importlib.metadata.version("sqlalchemy").startswith("2.0."):
        return  # an environment that is older than the limit in pyproject.toml
    coming = {"deployment_id": {"any_": [known["nightly"]["id"]]}, "state": {"type": {"any_": ["SCHEDULED"]}}}
    assert wait_for(lambda: server.post("flow_runs/filter", {"flow_runs": coming}))
