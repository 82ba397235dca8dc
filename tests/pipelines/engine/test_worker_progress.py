"""Progress of steps that other processes compute."""

from __future__ import annotations

import contextlib
import dataclasses
import queue
import socket
import time
from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.pipelines.flows import Events, open_run, write_flow
from texloom.pipelines.engine import worker_progress
from texloom.pipelines.engine.scheduler import execute
from texloom.pipelines.engine.worker_progress import DatagramReceiver, ProgressSender
from texloom.pipelines.flow.model import Runner
from texloom.stages.vocabulary.progress import Progress

QUILTING = """
flow: quilting
sources:
  exemplar: exemplar.png
steps:
  texture: {stage: synthesis.quilting, inputs: {image: exemplar}, params: {size: 96}}
exports:
  texture.exr: texture.image
"""

Received = queue.Queue[tuple[int, Progress]]


@contextlib.contextmanager
def receiving() -> Iterator[tuple[DatagramReceiver, Received]]:
    received: Received = queue.Queue()
    receiver = DatagramReceiver(lambda number, progress: received.put((number, progress)))
    try:
        yield receiver, received
    finally:
        receiver.close()


def test_reports_arrive_without_their_pictures() -> None:
    with receiving() as (receiver, received):
        said = Progress(0.25, scale=1, scales=3, iteration=2, iterations=9, energy=0.5, preview=lambda: None)  # type: ignore[arg-type,return-value]
        ProgressSender(receiver.channel, 7)(said)
        assert received.get(timeout=10) == (7, dataclasses.replace(said, preview=None))


def test_frequent_reports_are_left_out_but_not_the_last(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(worker_progress, "_SECONDS", 1000.0)
    with receiving() as (receiver, received):
        send = ProgressSender(receiver.channel, 1)
        for done in (0.1, 0.2, 0.3, 1.0):
            send(Progress(done))
        assert [received.get(timeout=10)[1].done for _ in range(2)] == [0.1, 1.0]
        assert received.empty()


@pytest.mark.parametrize("text", ["words", "[]", "[1, 2]", '["a", {"done": 1}]', '[1, {"unknown": 1}]', "\xff"])
def test_other_datagrams_are_ignored(text: str) -> None:
    with receiving() as (receiver, received), socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sender:
        for name in (receiver.channel.name, "other"):
            sender.sendto(name.encode() + text.encode("latin-1"), ("127.0.0.1", receiver.channel.port))
        ProgressSender(receiver.channel, 1)(Progress(1.0))
        assert received.get(timeout=10) == (1, Progress(1.0))


def test_a_run_that_has_gone_stops_no_worker() -> None:
    with receiving() as (receiver, _):
        channel = receiver.channel
    began = time.monotonic()
    for _ in range(3):
        ProgressSender(channel, 1)(Progress(0.5))
    assert time.monotonic() - began < 5


@pytest.mark.filterwarnings("ignore")
@pytest.mark.parametrize("runner", ["processes", "dask"])
def test_workers_tell_how_far_they_are(tmp_path: Path, runner: str) -> None:
    if runner == "dask":
        pytest.importorskip("prefect_dask")
    run = open_run(write_flow(tmp_path, QUILTING))
    run.flow = dataclasses.replace(run.flow, runner=Runner(runner, 1))
    listener = Events()
    execute(run, listener, tmp_path / "out")
    assert listener.states == {"texture": "ran"}
    done = [progress.done for progress in listener.progress]
    assert done
    assert done == sorted(done)
