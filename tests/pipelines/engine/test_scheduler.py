"""Several steps at a time: the same results whoever computes them, nothing lost when a worker or a run dies."""

from __future__ import annotations

import dataclasses
import json
import os
import re
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import pytest

from tests.pipelines.flows import (
    BRANCHES,
    SET,
    Events,
    environment,
    files,
    paint,
    run_local,
    start_run,
    write_flow,
    write_set,
)
from texloom.pipelines.engine.attempt import compute
from texloom.pipelines.engine.events import Event, Recorder, StepProgress, StepStarted
from texloom.pipelines.engine.executors import worker
from texloom.pipelines.engine.executors.executor import Executor, Outcome, StepTask
from texloom.pipelines.engine.executors.inline import InlineExecutor
from texloom.pipelines.engine.run import Run, StepFailedError
from texloom.pipelines.engine.task_spec import TaskSpec, check_same, run_task
from texloom.pipelines.flow.loader import load_flow
from texloom.pipelines.flow.model import Overrides, Runner
from texloom.pipelines.store.result_files import program_version
from texloom.pipelines.store.store import Store
from texloom.stages.vocabulary.declare import InputError
from texloom.stages.vocabulary.progress import Progress

LONG = """
flow: long
sources:
  exemplar: {each: pictures/*.png}
steps:
  edges: {stage: analysis.edges, inputs: {image: exemplar}}
  structure: {stage: analysis.otsu, inputs: {strength: edges.strength}}
exports:
  structure.png: structure.structure
"""


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    return write_set(tmp_path).parent


def opened(folder: Path, store: str = "artifacts", flow: str = "flow.yaml", **runner: Any) -> Run:
    return Run(load_flow(folder / flow, Overrides(runner=runner)), Store(folder / store))


class Bench(Executor):
    """An executor that computes a task at once, or does with it what the test says."""

    def __init__(self, slots: int = 2, instead: Callable[[str], Outcome | None] = lambda _: None, ahead: int = 0):
        self.free = slots
        self.more = ahead
        self.instead = instead
        self.given: list[tuple[str, int]] = []
        self.stopped: list[bool] = []

    def slots(self) -> int:
        return self.free

    def ahead(self) -> int:
        return self.more

    def submit(self, task: StepTask) -> None:
        self.given.append((task.spec.label, task.threads))
        outcome = self.instead(task.spec.label)
        if outcome is None:
            InlineExecutor(self.store).submit(task)
        else:
            task.end(outcome)

    def stop(self, at_once: bool) -> None:
        self.stopped.append(at_once)

    def run(self, run: Run, out: str = "out") -> tuple[Events, dict[str, Path]]:
        self.store, listener = run.store, Events()
        return listener, compute(run, listener, run.store.root.parent / out, lambda _: self)


def one_by_one(folder: Path, flow: str = "flow.yaml") -> dict[str, bytes]:
    run_local(opened(folder, "other", flow), folder / "one_by_one")
    return files(folder / "one_by_one")


@pytest.fixture(scope="module")
def of_set(tmp_path_factory: pytest.TempPathFactory) -> dict[str, bytes]:
    """The files of the set of `folder`."""
    return one_by_one(write_set(tmp_path_factory.mktemp("set")).parent)


def test_the_same_files_as_one_step_after_the_other(folder: Path, of_set: dict[str, bytes]) -> None:
    bench = Bench()
    listener, _ = bench.run(opened(folder))
    assert files(folder / "out") == of_set
    assert set(listener.states.values()) <= {"ran", "cached"}
    assert listener.items == dict.fromkeys(["a-1", "a-2", "b-1", "b-2", "c-1", "c-2"])
    assert bench.stopped == [False]
    # a key is computed once, though two items want it
    labels = [label for label, _ in bench.given]
    assert sum(label.endswith("/edges") for label in labels) == 3
    again = Bench()
    listener, _ = again.run(opened(folder))
    assert again.given == []
    assert set(listener.states.values()) == {"cached"}


def test_what_gathers_sees_who_failed(folder: Path) -> None:
    (folder / "flow.yaml").write_text(SET.replace("seed: [1, 2]\n", ""))
    (folder / "pictures" / "b.png").write_bytes(b"no picture")
    _, exports = Bench().run(opened(folder))
    rows = json.loads(exports["all.json"].read_text())["rows"]
    assert [(row["name"], row["failed"]) for row in rows] == [("a", False), ("b", True), ("c", False)]
    assert files(folder / "out") == one_by_one(folder)


def test_what_does_not_depend_on_what_failed_goes_on(folder: Path) -> None:
    (folder / "flow.yaml").write_text(BRANCHES)
    listener, exports = Bench().run(opened(folder))
    assert all("lattice" in str(problem) for problem in listener.items.values())
    assert set(exports) == {"a/start.png", "b/start.png", "c/start.png", "both.json"}
    assert files(folder / "out") == one_by_one(folder)


def test_processors_are_divided_and_one_step_alone_has_all(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("TEXLOOM_THREADS", "8")
    bench = Bench(slots=3, ahead=2)
    bench.run(opened(folder))
    assert [threads for _, threads in bench.given[:5]] == [2, 2, 2, 2, 2]
    alone = Bench(slots=3)
    path = write_flow(folder)
    alone.run(Run(load_flow(path), Store(folder / "artifacts")))
    assert [threads for _, threads in alone.given] == [8, 8, 8]


def test_a_failed_item_stops_nobody(folder: Path) -> None:
    (folder / "pictures" / "b.png").write_bytes(b"no picture")

    def raised(label: str) -> Outcome | None:
        return Outcome(error=ZeroDivisionError()) if label == "c-2/start" else None

    listener, _ = Bench(instead=raised).run(opened(folder))
    assert {name for name, problem in listener.items.items() if problem} == {"b-1", "b-2", "c-2"}
    assert listener.items["c-2"] == "start failed: ZeroDivisionError()"
    assert "pictures/b.png" in str(listener.items["b-1"])
    paint(folder / "pictures" / "b.png", seed=9)
    bench = Bench()
    bench.run(opened(folder))
    labels = {label for label, _ in bench.given}
    assert labels >= {"b-1/start", "b-2/start", "c-2/start"}
    assert not labels & {"a-1/start", "c-1/start", "c-1/edges"}


def test_a_picture_that_is_broken_inside_is_told_once(folder: Path) -> None:
    """Two steps meet it; they say the same, which is also what is said of it when one step follows the other."""
    broken = folder / "pictures" / "b.png"
    whole = broken.read_bytes()
    broken.write_bytes(whole[: len(whole) // 2])
    told, _ = Bench().run(opened(folder))
    before = run_local(opened(folder, "other"), folder / "one_by_one")
    assert str(told.items["b-1"]).startswith("sources.exemplar: ")
    assert told.items == before.items


def test_what_loses_its_worker_is_computed_again_and_the_next_time_alone(
    folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("TEXLOOM_THREADS", "8")
    deaths: list[str] = []

    def dies(label: str) -> Outcome | None:
        if label.endswith("/edges") and deaths.count(label) < (4 if label.startswith("b") else 3):
            deaths.append(label)
            return Outcome(error=OSError("its worker was killed"), is_lost=True)
        return None

    bench = Bench(instead=dies)
    listener, _ = bench.run(opened(folder))
    assert [threads for label, threads in bench.given if label == "a-1/edges"] == [4, 4, 8, 8]
    assert {name for name, problem in listener.items.items() if problem} == {"b-1", "b-2"}
    assert "its worker was killed" in str(listener.items["b-1"])
    assert any("a-1/edges: its worker was killed; computing it again" in note for note in listener.notes)


def test_a_broken_result_is_made_again(folder: Path, of_set: dict[str, bytes]) -> None:
    run = opened(folder)
    Bench().run(run)
    start = next((run.store.root / "cache" / "synthesis.initialise").glob("*/result.exr"))
    before, whole = start.stat(), start.read_bytes()
    start.write_bytes(whole[:-1] + bytes([whole[-1] ^ 1]))
    os.utime(start, ns=(before.st_atime_ns, before.st_mtime_ns))
    for record in run.store.records.glob("evaluation-metrics-*"):
        record.unlink()
    listener, _ = Bench().run(opened(folder))
    assert any("broken" in note for note in listener.notes)
    assert start.read_bytes() == whole
    assert files(folder / "out") == of_set


def test_without_a_set_the_first_problem_ends_the_run(tmp_path: Path) -> None:
    path = write_flow(tmp_path)
    run = Run(load_flow(path), Store(tmp_path / "artifacts"))
    bench = Bench(instead=lambda label: Outcome(error=MemoryError("no\nmemory")) if label == "structure" else None)
    with pytest.raises(StepFailedError) as failure:
        bench.run(run)
    assert (failure.value.step, failure.value.reason) == ("structure", "no\nmemory")
    assert str(failure.value) == r"structure failed: no\nmemory", "one line"
    assert bench.stopped == [True]
    refuses = Bench(instead=lambda _: Outcome(error=InputError("too small")))
    with pytest.raises(InputError, match=r"steps\.structure: too small"):
        refuses.run(Run(load_flow(path), Store(tmp_path / "artifacts")))


def test_exports_that_a_refusal_names_are_written(tmp_path: Path) -> None:
    def run() -> Run:
        return Run(load_flow(write_flow(tmp_path)), Store(tmp_path / "artifacts"))

    def fail(run: Run, out: str, told: str) -> tuple[list[str], dict[str, Path]]:
        refusal = Outcome(error=InputError(told))
        bench, listener = Bench(instead=lambda label: refusal if label == "distance" else None), Events()
        recorder, bench.store = Recorder(listener), run.store
        with pytest.raises(InputError, match=re.escape(told)):
            compute(run, recorder, tmp_path / out, lambda _: bench)
        return listener.notes, recorder.exports

    told = "too small: see structure.png, not distance.exr"
    for named in ("too small", "see infrastructure.png"):
        assert fail(run(), "out", named) == ([], {})
    assert not (tmp_path / "out").exists()
    notes, exports = fail(run(), "out", told)
    assert notes == [f"written for a look: structure.png; {tmp_path / 'out'}"]
    assert exports == {"structure.png": tmp_path / "out" / "structure.png"}
    failed = files(tmp_path / "out")
    fail(run(), "artifacts/runs/one", told)
    assert not (tmp_path / "artifacts" / "runs").exists(), "in a store nobody looks"
    Bench().run(run())
    whole = files(tmp_path / "out")
    assert sorted(whole) == ["distance.exr", "structure.png"]
    assert failed == {"structure.png": whole["structure.png"]}


# -- what a worker looks at before it computes


def task_of(folder: Path) -> tuple[Run, TaskSpec]:
    run = opened(folder)
    run.plan()
    scope, step = run.scopes["a-1"], run.flow.steps["edges"]
    assert scope is not None
    return run, run.task(step, run.parts(step, scope), scope)


def test_a_task_is_text_and_comes_back_whole(folder: Path) -> None:
    _, task = task_of(folder)
    assert TaskSpec.from_json(task.to_json()) == task
    check_same(task)


def test_another_texloom_or_store_is_refused(folder: Path, tmp_path: Path) -> None:
    run, task = task_of(folder)
    older = dataclasses.replace(task, parts=dataclasses.replace(task.parts, code="0" * 64))
    with pytest.raises(InputError, match=r"code of analysis\.edges changed"):
        check_same(older)
    run.store.create()
    identity = run.store.identity()
    assert run.store.identity() == identity
    run.store.check_identity(identity)
    with pytest.raises(InputError, match="is another folder there"):
        run.store.check_identity("0" * 32)
    with pytest.raises(InputError, match="is not there"):
        Store(tmp_path / "nowhere").check_identity(identity)
    elsewhere = worker.Payload(task.to_json(), str(tmp_path / "nowhere"), 1, identity)
    with pytest.raises(InputError, match="nowhere"):
        worker.compute_once(elsewhere, Events())
    assert not (tmp_path / "nowhere").exists()


def test_a_worker_says_whether_it_can_work_for_a_run(folder: Path) -> None:
    store = opened(folder).store
    identity, version = store.identity(), program_version()
    with store.lock(worker.PROBE):
        assert worker.probe_worker(str(store.root), identity, version).problem == ""
        assert "texloom 0" in worker.probe_worker(str(store.root), identity, "texloom 9").problem
        assert "is not there" in worker.probe_worker(str(folder / "x"), identity, version).problem
    assert "flock" in worker.probe_worker(str(store.root), identity, version).problem


# -- real threads and processes


def test_threads(folder: Path, of_set: dict[str, bytes]) -> None:
    run = opened(folder, name="threads", workers=2)
    assert run.flow.runner == Runner("threads", 2)
    run_local(run, folder / "out")
    assert files(folder / "out") == of_set


def known(path: Path) -> bytes:
    """What ``/proc`` tells; nothing of a process or thread that has ended, as those do that ask the system."""
    try:
        return path.read_bytes()
    except (FileNotFoundError, ProcessLookupError):
        return b""


def children(process: int) -> Iterator[int]:
    for thread in Path(f"/proc/{process}/task").iterdir():
        for child in map(int, known(thread / "children").split()):
            if b"spawn_main" in known(Path(f"/proc/{child}/cmdline")):
                yield child


def until(what: Callable[[], Any], process: subprocess.Popen[str]) -> None:
    deadline = time.monotonic() + 150
    while not what():
        assert time.monotonic() < deadline
        assert process.poll() is None, process.communicate()[1]
        time.sleep(0.02)


@pytest.mark.skipif(not Path("/proc/self/task").exists(), reason="needs /proc")
def test_processes_that_are_killed(folder: Path) -> None:
    """A worker dies, then the run; then the rest is computed, with the same bits as one step after the other."""
    path = folder / "long.yaml"
    path.write_text(LONG)
    for name in "abcde":
        paint(folder / "pictures" / f"{name}.png", side=900, seed=ord(name))
    options = ("--runner", "processes", "--workers", 2, "--out", folder / "out", "--store", folder / "artifacts")
    first = start_run(path, *options)
    locks = folder / "artifacts" / "locks"
    until(lambda: list(locks.glob("analysis-edges-*")), first)
    os.kill(next(children(first.pid)), signal.SIGKILL)
    until(lambda: list((folder / "out").glob("*/structure.png")), first)
    workers = list(children(first.pid))
    first.kill()
    assert "its worker was killed; computing it again" in first.communicate()[1]
    deadline = time.monotonic() + 20
    while any(Path(f"/proc/{pid}").exists() for pid in workers):
        assert time.monotonic() < deadline, "workers outlive the run"
        time.sleep(0.05)
    before = opened(folder, "artifacts", flow="long.yaml").plan()
    listener = run_local(opened(folder, "artifacts", flow="long.yaml"), folder / "out")
    states = {f"{plan.item}/{plan.name}": plan.state for plan in before}
    assert list(states.values()).count("cached") >= 2
    assert set(states.values()) != {"cached"}
    assert all(listener.states[label] == "cached" for label, state in states.items() if state == "cached")
    assert files(folder / "out") == one_by_one(folder, "long.yaml")


@pytest.mark.skipif(not Path("/proc/self/task").exists(), reason="needs /proc")
@pytest.mark.parametrize(
    ("runner", "number", "code"),
    [("processes", signal.SIGINT, 130), ("processes", signal.SIGTERM, 143), ("dask", signal.SIGTERM, 143)],
)
def test_signals_while_workers_start(tmp_path: Path, runner: str, number: signal.Signals, code: int) -> None:
    """The workers receive the signal too, from a terminal or a batch system, and are still importing."""
    path = write_flow(tmp_path, side=1500)  # which takes some seconds
    run = start_run(path, "--runner", runner, "--workers", 2)
    until(lambda: any(b"pydantic_core" in known(Path(f"/proc/{pid}/maps")) for pid in children(run.pid)), run)
    for process in children(run.pid):
        os.kill(process, number)
    time.sleep(1)  # which they would take for a traceback
    os.kill(run.pid, number)
    _, errors = run.communicate(timeout=60)
    assert (run.returncode, "Traceback" in errors) == (code, False), errors
    assert errors.splitlines()[-1].endswith("what is finished is kept, and the next run goes on from there")


def test_a_signal_does_not_interrupt_a_submission(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Half-way, the task might run though nobody waits for it."""
    submit, ended = ThreadPoolExecutor.submit, []

    def submit_under_signal(*arguments: Any, **options: Any) -> Any:
        if threading.current_thread() is not threading.main_thread():  # a stage has threads of its own
            return submit(*arguments, **options)
        signal.raise_signal(signal.SIGINT)
        ended.append(submit(*arguments, **options))
        return ended[-1]

    monkeypatch.setattr(ThreadPoolExecutor, "submit", submit_under_signal)
    with pytest.raises(KeyboardInterrupt):
        run_local(opened(folder, name="threads", workers=1), folder / "out")
    assert len(ended) == 1


def test_tasks_that_an_interruption_cancels_have_not_failed(folder: Path) -> None:
    class Interrupting(Events):
        started = 0

        def __call__(self, event: Event) -> None:
            if isinstance(event, StepStarted):
                self.started += 1
                if self.started == 2:  # two workers compute two tasks, and others wait
                    raise KeyboardInterrupt
            super().__call__(event)

    listener = Interrupting()
    with pytest.raises(KeyboardInterrupt):
        run_local(opened(folder, name="processes", workers=2), folder / "out", listener)
    assert listener.states
    assert "failed" not in listener.states.values()


PAIR = """
flow: pair
sources:
  exemplar: pictures/a.png
steps:
  density: {stage: analysis.autocorrelation, inputs: {image: exemplar}}
  edges: {stage: analysis.edges, inputs: {image: exemplar}}
  structure: {stage: analysis.otsu, inputs: {strength: edges.strength}}
exports:
  density.exr: density.density
  structure.png: structure.structure
"""


@pytest.fixture
def pair(folder: Path, monkeypatch: pytest.MonkeyPatch) -> Callable[[Callable[..., Any]], None]:
    """Set what is done instead of computing a step; ``density`` and ``edges`` then wait for each other."""
    (folder / "flow.yaml").write_text(PAIR)
    monkeypatch.setenv("TEXLOOM_THREADS", "2")
    both = threading.Barrier(2, timeout=60)

    def instead(compute: Callable[..., Any]) -> None:
        def together(spec: TaskSpec, *given: Any) -> Any:
            if spec.step != "structure":
                both.wait()
            return compute(spec, *given)

        monkeypatch.setattr("texloom.pipelines.engine.executors.inline.run_task", together)

    return instead


def test_independent_steps_of_one_item_are_computed_side_by_side(
    folder: Path, pair: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    with monkeypatch.context() as alone:
        alone.setenv("TEXLOOM_THREADS", "1")
        expected = one_by_one(folder)
    pair(run_task)
    listener = run_local(opened(folder), folder / "out")
    assert listener.states == dict.fromkeys(["density", "edges", "structure"], "ran")
    assert files(folder / "out") == expected


def test_what_is_computed_beside_a_failure_is_kept(folder: Path, pair: Any) -> None:
    def compute(spec: TaskSpec, *given: Any) -> Any:
        if spec.step == "density":
            raise RuntimeError("no density")
        return run_task(spec, *given)

    pair(compute)
    with pytest.raises(StepFailedError, match="no density"):
        run_local(opened(folder), folder / "out")
    states = {plan.name: plan.state for plan in opened(folder).plan()}
    assert states == {"density": "run", "edges": "cached", "structure": "run"}


def test_ctrl_c_interrupts_both_of_two_steps(folder: Path, pair: Any) -> None:
    ended = []

    def compute(spec: TaskSpec, stage: Any, inputs: Any, threads: Any, listener: Callable[[Event], None]) -> Any:
        if threading.current_thread() is threading.main_thread():
            raise KeyboardInterrupt
        try:
            while True:
                listener(StepProgress(spec.label, Progress(0.5)))
        finally:
            ended.append(spec.step)

    pair(compute)
    with pytest.raises(KeyboardInterrupt):
        run_local(opened(folder), folder / "out")
    assert ended == ["edges"]


@pytest.mark.filterwarnings("ignore")
def test_a_dask_cluster_with_other_working_folders(folder: Path, tmp_path: Path, of_set: dict[str, bytes]) -> None:
    pytest.importorskip("distributed")
    scheduler = subprocess.Popen(
        [sys.executable, "-m", "distributed.cli.dask_scheduler", "--host", "127.0.0.1", "--port", "0",
         "--no-dashboard", "--scheduler-file", str(tmp_path / "scheduler.json")],
        stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL, cwd=tmp_path, env=environment(tmp_path),
    )  # fmt: skip
    worker_process = None
    try:
        told = tmp_path / "scheduler.json"
        until(lambda: told.exists() and told.read_text().endswith("}"), scheduler)  # it is not written at once
        address = json.loads(told.read_text())["address"]
        (tmp_path / "elsewhere").mkdir()
        worker_process = subprocess.Popen(
            [sys.executable, "-m", "distributed.cli.dask_worker", address, "--nthreads", "2", "--no-dashboard",
             "--no-nanny"],
            stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL, cwd=tmp_path / "elsewhere",
            env=environment(tmp_path),
        )  # fmt: skip
        listener = run_local(opened(folder, name="dask", address=address), folder / "out")
        assert set(listener.states.values()) <= {"ran", "cached"}
        assert len(listener.items) == 6
        assert files(folder / "out") == of_set
    finally:
        for process in (worker_process, scheduler):
            if process is not None:
                process.terminate()
                process.wait(30)
