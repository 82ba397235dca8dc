"""Runs: what is computed, what is cached, what is lost when something breaks."""

from __future__ import annotations

import contextlib
import contextvars
import dataclasses
import json
import multiprocessing
import os
import re
import shutil
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from prefect.client.schemas.objects import FlowRun

from tests.crowds import crowd
from tests.pipelines.engine.prefect.test_records import result_store
from tests.pipelines.flows import ANALYSIS, SYNTHESIS, Events, files, open_run, run_local, start_run, write_flow
from texloom.pipelines.engine.events import Event, StepProgress
from texloom.pipelines.engine.prefect import flow_run, records, task_runners
from texloom.pipelines.engine.run import Run, StepFailedError
from texloom.pipelines.flow.compare import comparison_flow
from texloom.pipelines.flow.contact_sheet import open_flow
from texloom.pipelines.flow.model import Overrides
from texloom.pipelines.store import codec
from texloom.pipelines.store.store import BrokenArtifactError, Store
from texloom.stages.vocabulary.declare import InputError


def execute(run: Run, out: Path | None = None) -> Events:
    return run_local(run, out or run.store.root / "out")


def artifact_folder(run: Run, step: str) -> Path:
    plan = {entry.name: entry for entry in run.plan()}
    assert plan[step].key is not None
    return run.store.folder(plan[step].stage, str(plan[step].key))


def test_the_second_run_computes_nothing(tmp_path: Path) -> None:
    path = write_flow(tmp_path)
    first, second = execute(open_run(path), tmp_path / "1"), execute(open_run(path), tmp_path / "2")
    assert first.states == {"edges": "ran", "structure": "ran", "distance": "ran"}
    assert second.states == {"edges": "cached", "structure": "cached", "distance": "cached"}
    for name in ("structure.png", "distance.exr"):
        assert (tmp_path / "1" / name).read_bytes() == (tmp_path / "2" / name).read_bytes()


def test_a_changed_param_runs_its_step_and_what_follows(tmp_path: Path) -> None:
    path = write_flow(tmp_path)
    execute(open_run(path))
    changed = execute(open_run(path, edges__detector="gradient"))
    assert changed.states == {"edges": "ran", "structure": "ran", "distance": "ran"}
    changed = execute(open_run(path, structure__min_extent="0.3"))
    assert changed.states["edges"] == "cached"
    assert changed.states["structure"] == "ran"


def test_an_equal_result_stops_the_wave(tmp_path: Path) -> None:
    path = write_flow(tmp_path)
    execute(open_run(path))
    run = open_run(path)
    step = run.flow.steps["edges"]
    newer = dataclasses.replace(step, stage=dataclasses.replace(step.stage, version=99))
    run.flow = dataclasses.replace(run.flow, steps={**run.flow.steps, "edges": newer})
    assert [entry.state for entry in run.plan()] == ["run", "wait", "wait"]
    assert execute(run).states == {"edges": "ran", "structure": "cached", "distance": "cached"}


@pytest.mark.parametrize("how", ["cut", "altered", "gone"])
def test_a_broken_artifact_is_said_and_made_again(tmp_path: Path, how: str) -> None:
    path = write_flow(tmp_path)
    run = open_run(path)
    execute(run)
    file = artifact_folder(run, "structure") / "result.exr"
    whole = file.read_bytes()
    if how == "gone":
        file.unlink()
    else:
        file.write_bytes(whole[:-10] if how == "cut" else whole[:-1] + bytes([whole[-1] ^ 1]))
    assert "broken" in {entry.name: entry for entry in run.plan()}["structure"].reasons[0]
    heard = execute(open_run(path))
    assert heard.states == {"edges": "cached", "structure": "ran", "distance": "cached"}
    assert any("structure" in note and "broken" in note for note in heard.notes)
    assert file.read_bytes() == whole


def test_damage_that_only_reading_finds_is_made_good_in_the_same_run(tmp_path: Path) -> None:
    path = write_flow(tmp_path)
    run = open_run(path)
    execute(run)
    file = artifact_folder(run, "structure") / "result.exr"
    before, whole = file.stat(), file.read_bytes()
    file.write_bytes(whole[:-1] + bytes([whole[-1] ^ 1]))
    os.utime(file, ns=(before.st_atime_ns, before.st_mtime_ns))
    (run.store.root / "out" / "structure.png").unlink()  # or nothing would be read
    heard = execute(open_run(path))
    assert heard.states["structure"] == "ran"
    assert heard.notes == [
        "structure: the stored result is broken (result.exr has been altered); computing it again"
    ]


def test_a_failed_stage_leaves_no_record_and_the_steps_before_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = write_flow(tmp_path)
    run = open_run(path)
    broken = dataclasses.replace(run.flow.steps["structure"].stage, function=_raise)
    run.flow = dataclasses.replace(
        run.flow,
        steps={**run.flow.steps, "structure": dataclasses.replace(run.flow.steps["structure"], stage=broken)},
    )
    listener = Events()
    with pytest.raises(StepFailedError) as failure:
        run_local(run, tmp_path / "out", listener)
    assert failure.value.step == "structure"
    assert isinstance(failure.value.__cause__, ZeroDivisionError)
    assert listener.states == {"edges": "ran", "structure": "failed"}
    assert not (tmp_path / "out").exists()
    assert execute(open_run(path)).states == {"edges": "cached", "structure": "ran", "distance": "ran"}


def _raise(**_arguments: Any) -> None:
    raise ZeroDivisionError("as asked")


def test_a_full_disk_fails_the_step_and_loses_nothing(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = write_flow(tmp_path)
    write = codec.write

    def full(*_: Any, **__: Any) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(codec, "write", full)
    with pytest.raises(StepFailedError, match="No space left on device"):
        execute(open_run(path))
    monkeypatch.setattr(codec, "write", write)
    assert execute(open_run(path)).states["edges"] == "ran"


def test_plan_gives_reasons(tmp_path: Path) -> None:
    path = write_flow(tmp_path)
    fresh = open_run(path).plan()
    assert [(entry.state, entry.reasons) for entry in fresh] == [
        ("run", ("never run before",)),
        ("wait", ("waits for edges",)),
        ("wait", ("waits for structure",)),
    ]
    assert not (tmp_path / "artifacts").exists()
    execute(open_run(path))
    changed = open_run(path, edges__finest="3.0").plan()
    assert changed[0].reasons == ("param finest: 1.5 -> 3.0",)
    write_flow(tmp_path, side=72)
    assert open_run(path).plan()[0].reasons == ("input image changed",)


def test_nothing_changes_a_plan_but_what_it_depends_on(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = write_flow(tmp_path)
    execute(open_run(path))
    monkeypatch.setenv("TEXLOOM_THREADS", "1")
    (tmp_path / "exemplar.png").touch()
    assert {entry.state for entry in open_run(path).plan()} == {"cached"}


def test_checkpoints_belong_to_a_key(tmp_path: Path) -> None:
    """A long step that was interrupted goes on; with another param it starts anew."""
    path = write_flow(tmp_path, SYNTHESIS)
    run = open_run(path)

    class Stopper(Events):
        def __call__(self, event: Event) -> None:
            if isinstance(event, StepProgress) and event.progress.scale == 3:
                raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        run_local(run, tmp_path / "out", Stopper())
    other = execute(open_run(path, texture__occurrence="20"))
    assert other.notes == []
    resumed = execute(open_run(path))
    assert resumed.notes == ["texture: goes on after scale 2 of an interrupted run"]
    assert min(progress.scale for progress in resumed.progress if progress.scale) == 3

    whole = write_flow(tmp_path / "whole", SYNTHESIS)
    execute(open_run(whole))
    assert _digest(open_run(path)) == _digest(open_run(whole))


def _digest(run: Run) -> str:
    entry = next(entry for entry in run.plan() if entry.name == "texture")
    artifact = run.store.find(entry.stage, str(entry.key))
    assert artifact is not None
    return artifact.outputs["image"]


def test_a_killed_run_goes_on_where_it_was(tmp_path: Path) -> None:
    path = write_flow(tmp_path, SYNTHESIS.replace("size: 96", "size: 256"), side=128)
    process = start_run(path)
    deadline = time.monotonic() + 120
    while not list((tmp_path / "artifacts" / "checkpoints").glob("*/*/0[2-9]")):
        assert time.monotonic() < deadline
        assert process.poll() is None, process.communicate()[1]
        time.sleep(0.01)
    process.send_signal(signal.SIGKILL)
    process.communicate()
    again = start_run(path)
    report, said = again.communicate(timeout=120)
    assert again.returncode == 0, said
    assert "goes on after scale" in said
    assert {step["name"]: step["state"] for step in json.loads(report)["steps"]} == {
        "start": "cached",
        "texture": "ran",
    }
    whole = write_flow(tmp_path / "whole", SYNTHESIS.replace("size: 96", "size: 256"), side=128)
    execute(open_run(whole))
    assert _digest(open_run(path)) == _digest(open_run(whole))


def test_three_runners_on_one_store_compute_each_step_once(tmp_path: Path) -> None:
    assert crowd(tmp_path, ("local", "threads", "processes", "local")) == []


def test_a_lock_outlives_no_process(tmp_path: Path) -> None:
    """SIGKILL in the middle of a step leaves no lock behind."""
    path = write_flow(tmp_path)
    store = open_run(path).store
    store.create()
    locks = store.locks
    holder = subprocess.Popen(
        [
            sys.executable,
            "-c",
            "import sys, time, filelock\nlock = filelock.FileLock(sys.argv[1])\nlock.acquire()\n"
            "print('held', flush=True)\ntime.sleep(60)",
            str(locks / "one.lock"),
        ],
        stdout=subprocess.PIPE,
    )
    assert holder.stdout is not None
    assert holder.stdout.readline() == b"held\n"
    manager = records.FileLocks(open_run(path).store)
    assert manager.is_locked("one")
    assert not manager.acquire_lock("one", "me", acquire_timeout=0)
    holder.kill()
    holder.communicate()
    assert manager.acquire_lock("one", "me", acquire_timeout=5)
    assert manager.is_lock_holder("one", "me")
    assert not manager.is_lock_holder("one", "you")
    with pytest.raises(ValueError, match="not held"):
        manager.release_lock("one", "you")
    manager.release_lock("one", "me")
    assert not manager.is_locked("one")


def test_a_record_of_a_broken_artifact_reads_as_missing(tmp_path: Path) -> None:
    run = open_run(write_flow(tmp_path))
    execute(run)
    folder = artifact_folder(run, "edges")
    results = result_store(run.store)
    name = next(path.name for path in run.store.records.iterdir() if path.name.startswith("analysis-edges"))
    assert results.exists(name)
    (folder / "result.exr").unlink()
    assert not results.exists(name)
    with pytest.raises(BrokenArtifactError):
        run.store.find("analysis.edges", folder.name)


def test_a_deployment_replaces_nothing_that_it_reads(tmp_path: Path) -> None:
    path = write_flow(tmp_path)
    path.write_text(path.read_text().replace("structure.png", "exemplar.png"))
    before = (tmp_path / "exemplar.png").read_bytes()
    with pytest.raises(InputError, match="would replace a source of the flow"):
        flow_run.texloom_flow.fn(str(path), store=str(tmp_path / "artifacts"), out=str(tmp_path))
    assert (tmp_path / "exemplar.png").read_bytes() == before
    assert not (tmp_path / "artifacts").exists()


@pytest.fixture(scope="module")
def server(tmp_path_factory: pytest.TempPathFactory) -> Iterator[None]:
    from prefect.testing.utilities import prefect_test_harness

    with prefect_test_harness(server_startup_timeout=120):
        yield


@pytest.mark.usefixtures("server")
@pytest.mark.filterwarnings("ignore")
def test_a_server_shows_steps_progress_and_pictures(tmp_path: Path) -> None:
    from prefect.client.orchestration import get_client

    path = write_flow(tmp_path, SYNTHESIS)
    execute(open_run(path, texture__occurrence="11"))  # what the local engine has made, the server's finds
    listener = Events()
    run = open_run(path, texture__occurrence="12")
    exports = flow_run.execute_as_flow_run(run, listener, tmp_path / "out")
    assert exports["texture.exr"].exists()
    assert listener.states == {"start": "cached", "texture": "ran"}
    with get_client(sync_client=True) as client:
        flows = {entry.name for entry in client.read_flows()}
        tasks = {entry.name: entry.state.name for entry in client.read_task_runs() if entry.state is not None}
        artifacts = {entry.key: entry.type for entry in client.read_artifacts()}
    assert "synthesis" in flows
    assert tasks == {"start": "Cached", "texture": "Completed"}
    assert artifacts["synthesis-texture"] == "image"
    assert artifacts["synthesis-texture-progress"] == "progress"
    assert execute(open_run(path, texture__occurrence="12")).states == {"start": "cached", "texture": "cached"}


@pytest.mark.usefixtures("server")
@pytest.mark.filterwarnings("ignore")
def test_a_cluster_of_this_machine_needs_credentials(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip("prefect_dask")
    addresses = []

    class Cluster(task_runners.DaskCluster):
        def __init__(self, run: Run, workers: int):
            super().__init__(run, workers)
            addresses.append(self.client.scheduler.address)

    monkeypatch.setattr(task_runners, "DaskCluster", Cluster)
    listener = Events()
    run = open_run(write_flow(tmp_path, f"runner: {{name: dask, workers: 1}}\n{ANALYSIS}"))
    flow_run.execute_as_flow_run(run, listener, tmp_path / "out")
    assert listener.states == {"edges": "ran", "structure": "ran", "distance": "ran"}
    assert [address[:16] for address in addresses] == ["tls://127.0.0.1:"]


SCORED = """
flow: scored
sources:
  exemplar: exemplar.png
steps:
  edges: {stage: analysis.edges, inputs: {image: exemplar}}
  start: {stage: synthesis.initialise, inputs: {image: exemplar}, params: {size: 32, method: pixels}}
  scores: {stage: evaluation.metrics, inputs: {exemplar: exemplar, image: start.image}}
  all: {stage: evaluation.tabulate, gather: {tables: scores.table}}
exports:
  edges.png: edges.strength
  start.png: start.image
  all.json: all.table
"""


def shown(ended: int = 0) -> tuple[FlowRun, list[tuple[str, str]], dict[str, Any]]:
    """The last flow run, its task runs with their states, its artifacts.

    The server records task runs some time after what they do: this waits until so many have ended.
    """
    from prefect.client.orchestration import get_client
    from prefect.client.schemas.filters import ArtifactFilter, FlowRunFilter

    with get_client(sync_client=True) as client:
        run = max(client.read_flow_runs(), key=lambda run: run.created or run.start_time)
        mine = FlowRunFilter.model_validate({"id": {"any_": [run.id]}})
        for _ in range(600):
            tasks = client.read_task_runs(flow_run_filter=mine)
            if sum(task.state is not None and task.state.is_final() for task in tasks) >= ended:
                break
            time.sleep(0.1)
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
    write_flow(tmp_path, SCORED)
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
    run, states, artifacts = shown(len(steps))
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
    run, states, artifacts = shown(len(steps))
    assert states == sorted((step, "Cached") for step in steps)
    assert files(again) == first
    assert artifacts["scored-edges"].type == "image", "cached results are shown too"


@pytest.mark.usefixtures("server")
@pytest.mark.filterwarnings("ignore")
def test_the_parameters_of_a_comparison_repeat_it(tmp_path: Path) -> None:
    path = write_flow(tmp_path, SCORED.replace("edges.png: edges.strength", "scores.json: scores.table"))
    path.write_text(re.sub(r".* all.*\n", "", path.read_text()))
    (tmp_path / "theirs").mkdir()
    shutil.copy(tmp_path / "exemplar.png", tmp_path / "theirs")
    names = [str(path), str(shutil.copy(path, tmp_path / "other.yaml")), f"theirs={tmp_path / 'theirs'}"]
    flow = comparison_flow(
        names,
        Overrides(params={"flow_start.size": "32x40", "other_start.size": "32x40"}, seeds=2),
        str(tmp_path / "exemplar.png"),
    )
    opened = Run(flow, Store(tmp_path / "artifacts"))
    exports, steps = flow_run.execute_as_flow_run(opened, Events(), tmp_path / "out"), len(opened.plan())
    run, states, _ = shown(steps)
    assert run.parameters["flow"] == names
    assert {state for _, state in states} <= {"Completed", "Cached"}
    again = flow_run.texloom_flow(**{**run.parameters, "out": str(tmp_path / "again")})
    assert set(again) == set(exports)
    assert len(states) == steps
    assert shown(steps)[1] == [(step, "Cached") for step, _ in states]
    assert files(tmp_path / "again") == files(tmp_path / "out")


@pytest.mark.usefixtures("server")
@pytest.mark.filterwarnings("ignore")
def test_a_task_run_whose_worker_is_killed_has_crashed(tmp_path: Path) -> None:
    run = open_run(write_flow(tmp_path, f"runner: {{name: processes, workers: 1}}\n{ANALYSIS}", side=900))

    def kill() -> None:
        states: list[tuple[str, str]] = []
        while states != [("edges", "Running")]:
            with contextlib.suppress(ValueError):  # no flow run so far
                states = shown()[1]
            time.sleep(0.02)
        for child in multiprocessing.active_children():
            child.kill()

    killer = threading.Thread(target=contextvars.copy_context().run, args=(kill,))
    killer.start()
    flow_run.execute_as_flow_run(run, Events(), tmp_path / "out")
    killer.join()
    completed = [(step, "Completed") for step in ("distance", "edges", "structure")]
    assert shown(4)[1] == sorted([("edges", "Crashed"), *completed])


def test_a_server_that_does_not_answer_is_an_error(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = write_flow(tmp_path)
    environment = {**os.environ, "PREFECT_API_URL": "http://127.0.0.1:9/api"}
    given = [sys.executable, "-m", "texloom", "run", str(path), "--store", str(tmp_path / "artifacts")]
    done = subprocess.run(given, capture_output=True, text=True, env=environment, check=False)
    assert done.returncode == 2
    assert "no Prefect server answers at PREFECT_API_URL=http://127.0.0.1:9/api" in done.stderr
    assert len(done.stderr.splitlines()) == 1
    assert not (tmp_path / "artifacts").exists()
