"""Runs: what is computed, what is cached, what is lost when something breaks."""

from __future__ import annotations

import dataclasses
import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import filelock
import pytest

from tests.crowds import crowd
from tests.pipelines.flows import SYNTHESIS, Events, open_run, run_local, start_run, write_flow
from tests.printed import next_line
from texloom.pipelines.engine.events import Event, StepProgress
from texloom.pipelines.engine.run import Run, StepFailedError
from texloom.pipelines.store import codec


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
    assert next_line(holder) == b"held\n"
    with pytest.raises(filelock.Timeout):
        store.lock("one", timeout=0).acquire()
    holder.kill()
    holder.communicate()
    with store.lock("one", timeout=5):
        pass
