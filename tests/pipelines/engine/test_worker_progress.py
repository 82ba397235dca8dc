"""Progress of steps that other processes compute."""

from __future__ import annotations

import dataclasses
import io
from pathlib import Path

import PIL.Image
import pytest

from tests.pipelines.flows import SYNTHESIS, Events, open_run, write_flow
from texloom.pipelines.engine.attempt import compute
from texloom.pipelines.engine.events import Event, Listener, StepProgress, StepReport, StepStarted
from texloom.pipelines.engine.executors import worker
from texloom.pipelines.engine.run import Run
from texloom.pipelines.flow.model import Runner

Reported = list[StepProgress]


def reported(run: Run, step: str) -> Reported:
    """What a worker tells of a step whose inputs are there."""
    run.plan()
    task = run.task(run.flow.steps[step], run.parts(run.flow.steps[step], run.shared), run.shared)
    told: list[Event] = []
    run.store.create()
    worker.compute_once(worker.Payload(task.to_json(), str(run.store.root), 1), told.append)
    return [event for event in told if isinstance(event, StepProgress)]


def test_frequent_reports_are_left_out_but_neither_the_last_nor_pictures(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(worker, "_SECONDS", 1000.0)
    path = write_flow(tmp_path, SYNTHESIS.replace("size: 96", "size: 32"), side=32)
    start = open_run(path)
    start.shows_scales = True
    reported(start, "start")
    run = open_run(path)
    run.shows_scales = True
    told = reported(run, "texture")
    assert all(event.progress.preview is None for event in told)
    assert [event.progress.done for event in told if not event.picture][-1:] == [1.0]
    pictures = [event for event in told if event.picture]
    scales = [event.progress.scale for event in pictures]
    assert scales == list(range(1, pictures[0].progress.scales + 1))
    assert len(told) <= len(pictures) + 2
    with PIL.Image.open(io.BytesIO(pictures[-1].picture)) as picture:
        assert picture.format == "PNG"


QUILTING = """
flow: quilting
sources:
  exemplar: exemplar.png
steps:
  texture: {stage: synthesis.quilting, inputs: {image: exemplar}, params: {size: 96}}
exports:
  texture.exr: texture.image
"""


def compute_on(folder: Path, text: str, runner: str, listener: Listener) -> Run:
    """Compute a flow on one worker; its run."""
    if runner == "dask":
        pytest.importorskip("distributed")
    run = open_run(write_flow(folder, text))
    run.flow = dataclasses.replace(run.flow, runner=Runner(runner, 1))
    compute(run, listener, folder / "out")
    return run


@pytest.mark.filterwarnings("ignore")
@pytest.mark.parametrize("runner", ["processes", "dask"])
def test_workers_tell_how_far_they_are(tmp_path: Path, runner: str) -> None:
    listener = Events()
    compute_on(tmp_path, QUILTING, runner, listener)
    assert listener.states == {"texture": "ran"}
    done = [progress.done for progress in listener.progress]
    assert done
    assert done == sorted(done)


THREE = """
flow: three
sources:
  exemplar: exemplar.png
steps:
  edges: {stage: analysis.edges, inputs: {image: exemplar}, params: {detector: gradient}}
  density: {stage: analysis.autocorrelation, inputs: {image: exemplar}}
  texture: {stage: synthesis.quilting, inputs: {image: exemplar}, params: {size: 32}}
exports:
  edges.png: edges.strength
  texture.exr: texture.image
"""


@pytest.mark.filterwarnings("ignore")
@pytest.mark.parametrize("runner", ["processes", "dask"])
def test_a_step_has_begun_when_a_worker_computes_it(tmp_path: Path, runner: str) -> None:
    """And not when it waits for the worker."""
    told: list[Event] = []
    run = compute_on(tmp_path, THREE, runner, told.append)
    events = [event for event in told if isinstance(event, StepStarted | StepReport)]
    for name in run.flow.steps:
        kinds = [type(one) for one in events if name == (one.step if isinstance(one, StepStarted) else one.name)]
        assert kinds == [StepStarted, StepReport]
    if runner == "processes":  # Dask's client receives answers and events in two threads
        assert [type(event) for event in events] == [StepStarted, StepReport] * len(run.flow.steps)
