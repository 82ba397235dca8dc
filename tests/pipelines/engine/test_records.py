"""Records that somebody else has written: they are computed again, and what they name is never loaded or called."""

from __future__ import annotations

import base64
import dataclasses
import hashlib
import json
import os
import pickle
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from tests.pipelines.cli.test_main import texloom
from tests.pipelines.flows import ANALYSIS, Events, files, open_run, run_local, write_flow
from texloom.pipelines.engine.attempt import MAX_RESTARTS
from texloom.pipelines.engine.run import Run
from texloom.pipelines.engine.scheduler import execute
from texloom.pipelines.flow.model import Runner
from texloom.pipelines.store import codec
from texloom.pipelines.store.folders import Folder
from texloom.pipelines.store.keep import keep_record
from texloom.pipelines.store.record import SERIALIZER, decode_record, record_name
from texloom.pipelines.store.result_files import BrokenArtifactError
from texloom.pipelines.store.store import Artifact, BrokenStoreError, Store

GATHERING = """steps:
  start: {stage: synthesis.initialise, inputs: {image: exemplar}, params: {size: 32, method: pixels}}
  scores: {stage: evaluation.metrics, inputs: {exemplar: exemplar, image: start.image}}
  all: {stage: evaluation.tabulate, gather: {tables: scores.table}}"""
"""what is gathered is read from the store, not taken from memory"""
RAN = {"edges": "ran", "structure": "ran", "distance": "ran"}
CACHED = dict.fromkeys(RAN, "cached")
_MARK = "TEXLOOM_TEST_MARK"


@pytest.fixture
def mark(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A file that is there once a record has had its way."""
    monkeypatch.setenv(_MARK, str(tmp_path / "mark"))
    monkeypatch.delenv("PREFECT_API_URL", raising=False)
    return tmp_path / "mark"


def fire(_: Any = None) -> dict[str, Any]:
    Path(os.environ[_MARK]).touch()
    return {}


class Fires:
    def __reduce__(self) -> Any:
        return fire, ()


_PICKLE = base64.b64encode(pickle.dumps(Fires())).decode()
_OURS = {"serializer": {"type": SERIALIZER}}
PICKLED = {"metadata": {"serializer": {"type": "pickle"}}, "result": _PICKLE}
POISONS: dict[str, dict[str, Any]] = {
    "pickled": PICKLED,
    "JSON that calls": {
        "metadata": {"serializer": {"type": "json", "object_decoder": f"{__name__}.fire"}},
        "result": "{}",
    },
    "without metadata": {"result": _PICKLE},
    "older": {"metadata": _OURS, "serializer": {"type": "pickle"}, "data": _PICKLE},
}
local = run_local


def with_workers(name: Any) -> Callable[[Run, Path], Events]:
    def run_with(run: Run, out: Path) -> Events:
        listener = Events()
        run.flow = dataclasses.replace(run.flow, runner=Runner(name, 2))
        execute(run, listener, out)
        return listener

    return run_with


processes = with_workers("processes")
dask = with_workers("dask")


def runs_in_spite_of(poison: Any, execute: Callable[[Run, Path], Events], mark: Path) -> None:
    path = write_flow(mark.parent)
    run = open_run(path)
    local(run, mark.parent / "before")
    for record in run.store.records.iterdir():
        record.write_text(json.dumps(poison))
    assert {plan.state for plan in open_run(path).plan()} <= {"run", "wait"}
    assert execute(open_run(path), mark.parent / "after").states == RAN
    assert not mark.exists()
    assert files(mark.parent / "after") == files(mark.parent / "before")
    assert local(open_run(path), mark.parent / "after").states == CACHED


@pytest.mark.parametrize("poison", POISONS.values(), ids=POISONS)
def test_a_record_cannot_run_code(mark: Path, poison: Any) -> None:
    runs_in_spite_of(poison, local, mark)


@pytest.mark.parametrize("execute", [processes, dask], ids=["processes", "dask"])
def test_a_record_cannot_run_code_in_other_processes(mark: Path, execute: Any) -> None:
    runs_in_spite_of(PICKLED, execute, mark)


def test_a_record_that_comes_after_the_plan_cannot_run_code(mark: Path) -> None:
    run = open_run(write_flow(mark.parent))
    local(run, mark.parent / "out")
    step = run.flow.steps["edges"]
    parts = run.parts(step, run.shared)
    artifact = run.store.find(parts.stage, parts.key)
    assert artifact is not None
    record = run.store.records / record_name(parts.stage, parts.key)
    whole = record.read_bytes()
    assert keep_record(run.store, parts.stage, parts.key, dict) == (artifact.record, False)
    record.write_text(json.dumps(PICKLED))
    assert keep_record(run.store, parts.stage, parts.key, lambda: artifact.record) == (artifact.record, True)
    assert decode_record(record.read_bytes()) == decode_record(whole)
    assert run.store.lock(record.name, timeout=0).acquire().lock.is_locked
    assert not mark.exists()


def test_a_record_is_written_whole_or_not_at_all(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    run = open_run(write_flow(tmp_path))
    local(run, tmp_path / "out")
    path = next(run.store.records.iterdir())
    whole = path.read_bytes()
    fill = Folder.fill

    def stops(self: Folder, name: str, handle: int, content: bytes, durable: bool) -> None:
        fill(self, name, handle, content[:20], durable)
        raise OSError("full")

    monkeypatch.setattr(Folder, "fill", stops)
    with pytest.raises(OSError, match="full"):
        run.store.write_record(path.name, whole)
    monkeypatch.undo()
    assert path.read_bytes() == whole
    run.store.write_record(path.name, whole)
    assert not [left.name for left in run.store.records.iterdir() if left.name.startswith(".")]


# -- records that are altered in other ways


def another_record(path: Path) -> None:
    known = sorted(path.parent.iterdir())
    path.write_bytes(known[(known.index(path) + 1) % len(known)].read_bytes())


def manifest_too(path: Path) -> None:
    """An output is missing from record and manifest, and the digest between them is right."""
    whole = json.loads(path.read_text())
    record = json.loads(whole["result"])
    manifest = path.parents[1] / "cache" / record["stage"] / record["key"] / "manifest.json"
    content = json.dumps({**json.loads(manifest.read_text()), "outputs": {}}).encode()
    manifest.write_bytes(content)
    changed = {**record, "outputs": {}, "manifest": hashlib.sha256(content).hexdigest()}
    path.write_text(json.dumps({**whole, "result": json.dumps(changed)}))


def with_result(change: Callable[[dict[str, Any]], Any], **metadata: Any) -> Callable[[Path], None]:
    """Alters the record in a file, and what the file says of it."""

    def alter(path: Path) -> None:
        whole = json.loads(path.read_text())
        path.write_text(
            json.dumps({**whole, **metadata, "result": json.dumps(change(json.loads(whole["result"])))})
        )

    return alter


ALTERED: dict[str, Callable[[Path], object]] = {
    "no serializer": with_result(lambda record: {**record, "outputs": {}}, metadata={"type": SERIALIZER}),
    "JSON serializer": with_result(lambda _: "x", metadata={"serializer": {"type": "json"}}),
    "other serializer": with_result(lambda record: record, metadata={"serializer": {"type": "nobody's"}}),
    "another record": another_record,
    "no outputs": with_result(lambda record: {**record, "outputs": {}}),
    "odd outputs": with_result(lambda record: {**record, "outputs": {name: ["x"] for name in record["outputs"]}}),
    "no key": with_result(lambda record: {name: record[name] for name in record if name != "key"}),
    "a list": with_result(lambda _: [1, 2]),
    "text": lambda path: path.write_text("not JSON"),
    "deep": lambda path: path.write_text("[" * 100_000),
    "manifest too": manifest_too,
    "a folder": lambda path: (path.unlink(), (path / "inside").mkdir(parents=True)),
}


@pytest.mark.parametrize("alter", ALTERED.values(), ids=ALTERED)
def test_an_altered_record_is_made_good(mark: Path, alter: Callable[[Path], object]) -> None:
    folder = mark.parent
    path = write_flow(folder)
    store = open_run(path).store
    given = ("run", path, "--store", store.root, "--json", "--out")
    assert texloom(*given, folder / "before").code == 0
    for record in sorted(store.records.iterdir()):
        alter(record)
    planned = texloom("plan", path, "--store", store.root)
    assert planned.code == 0
    assert "broken" in planned.out
    again = texloom(*given, folder / "after")
    assert again.code == 0, again.err
    assert "Traceback" not in again.err
    assert files(folder / "after") == files(folder / "before")
    assert texloom(*given, folder / "after").states == CACHED


def test_a_result_that_is_broken_each_time_ends_the_run(mark: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def fails(*_: Any) -> Any:
        raise codec.ArtifactError("result.exr: cannot be read")

    path = write_flow(mark.parent, f"{ANALYSIS}  mask.png: structure.structure\n".replace("steps:", GATHERING))
    monkeypatch.setattr(codec, "read", fails)
    result = texloom("run", path, "--store", mark.parent / "store", "--json")
    assert result.code == 1
    assert "Traceback" not in result.err
    last = result.err.splitlines()[-1]
    assert last.startswith(
        "texloom: scores: the stored result is broken (result.exr: cannot be read), again and again"
    )
    assert result.report["error"] == last.removeprefix("texloom: ")
    restarts = [line for line in result.err.splitlines() if line.endswith("computing it again")]
    assert sum(line.startswith("scores") for line in restarts) == MAX_RESTARTS


def test_a_record_that_is_never_right_ends_the_run(mark: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = write_flow(mark.parent)
    check = Store.check_record

    def refused(self: Store, record: Any, stage: str, key: str, thorough: bool = False) -> Artifact:
        if stage == "analysis.otsu":
            raise BrokenArtifactError("as asked")
        return check(self, record, stage, key, thorough)

    local(open_run(path), mark.parent / "out")
    monkeypatch.setattr(Store, "check_record", refused)
    with pytest.raises(BrokenStoreError, match=r"^structure: the stored result is broken \(as asked\), again and"):
        local(open_run(path), mark.parent / "out")


@pytest.mark.parametrize("content", ["[]", '{"edges": 3}', '{"edges": {"params": 3, "inputs": []}}', "[" * 100_000])
def test_an_altered_history_is_no_history(mark: Path, content: str) -> None:
    path = write_flow(mark.parent)
    run = open_run(path)
    local(run, mark.parent / "out")
    (run.store.root / "history" / "small").write_text(content)
    given = (path, "--store", run.store.root, "--set", "edges.finest=3.0")
    planned = texloom("plan", *given)
    assert (planned.code, planned.err) == (0, "")
    assert "never run before" in planned.out
    assert texloom("run", *given, "--out", mark.parent / "out").code == 0
