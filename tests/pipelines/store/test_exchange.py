"""Results shared through object storage: found there, checked, uploaded, and runs that go on when it fails."""

from __future__ import annotations

import contextlib
import dataclasses
import importlib.util
import json
import os
import secrets
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
import PIL.Image
import pytest

pytest.importorskip("fsspec")
import fsspec
from fsspec.implementations.memory import MemoryFileSystem

import texloom as api
from tests.pipelines.cli.test_main import texloom
from tests.pipelines.engine.test_choices import CHOOSING, write
from tests.pipelines.flows import Events, files, write_flow
from texloom.pipelines.engine.events import Recorder, Shared
from texloom.pipelines.engine.executors import worker
from texloom.pipelines.engine.footprint import Footprint
from texloom.pipelines.engine.preflight import Preflight
from texloom.pipelines.engine.run import Run
from texloom.pipelines.engine.scheduler import execute
from texloom.pipelines.flow.command_list import command_list
from texloom.pipelines.flow.model import Overrides
from texloom.pipelines.flow.seed_sheet import open_flow
from texloom.pipelines.store import exchange, housekeeping, remote
from texloom.pipelines.store.keep import keep_record
from texloom.pipelines.store.result_files import MANIFEST
from texloom.pipelines.store.store import Store
from texloom.stages.vocabulary.declare import InputError

STEPS = ("edges", "structure", "distance")


class Flaky(MemoryFileSystem):
    """A storage in memory that answers as it is told: each request takes the next of `answers`."""

    protocol = "flaky"
    store: ClassVar[dict[str, Any]] = {}
    pseudo_dirs: ClassVar[list[str]] = [""]
    answers: ClassVar[list[str]] = []
    """drop: the request is lost; lose: it is done and its answer is lost; hang; deny; the rest is answered"""
    requests: ClassVar[list[str]] = []

    @classmethod
    def _strip_protocol(cls, path: str) -> str:
        return MemoryFileSystem._strip_protocol(path.replace("flaky://", "memory://"))

    def _answer(self, method: str, path: str, request: Any) -> Any:
        self.requests.append(f"{method} {path.rpartition('/')[0]}")
        what = self.answers.pop(0) if self.answers else ""
        if what == "drop":
            raise ConnectionResetError("connection reset")
        if what == "deny":
            raise PermissionError("access denied")
        if what == "hang":
            time.sleep(0.4)
        answer = request()
        if what == "lose":
            raise ConnectionResetError("connection reset")
        return answer

    def cat_file(self, path: str, start: Any = None, end: Any = None, **_: Any) -> bytes:
        return bytes(self._answer("GET", path, lambda: MemoryFileSystem.cat_file(self, path, start, end)))

    def pipe_file(self, path: str, value: bytes, mode: str = "overwrite", **_: Any) -> None:
        self._answer("PUT", path, lambda: MemoryFileSystem.pipe_file(self, path, value, mode))

    def put_file(self, lpath: str, rpath: str, mode: str = "overwrite", **_: Any) -> None:
        content = Path(lpath).read_bytes()
        self._answer("PUT", rpath, lambda: MemoryFileSystem.pipe_file(self, rpath, content, mode))

    def ls(self, *_: Any, **__: Any) -> Any:
        raise AssertionError("it must not be listed")


@pytest.fixture
def url(monkeypatch: pytest.MonkeyPatch) -> Iterator[str]:
    """Address of a new storage, which is tried at once and soon again."""
    fsspec.register_implementation("flaky", Flaky, clobber=True)
    monkeypatch.setattr(remote, "_PAUSE", 0.001)
    monkeypatch.setattr(remote, "_SECONDS", 0.2)
    monkeypatch.delenv("PREFECT_API_URL", raising=False)
    Flaky.answers.clear()
    Flaky.requests.clear()
    yield f"flaky://{secrets.token_hex(8)}/prefix"
    Flaky.store.clear()
    Flaky.answers.clear()


@dataclasses.dataclass
class Done:
    """How a run on a store of its own went."""

    store: Store
    states: set[str]
    shared: dict[str, int]
    warnings: list[str]
    exports: dict[str, bytes]


def run(folder: Path, name: str, url: str) -> Done:
    """Run the flow on the store called ``name``."""
    path = folder / "flow.yaml" if (folder / "flow.yaml").exists() else write_flow(folder)
    opened = Run(open_flow(path, Overrides()), Store(folder / name, url))
    recorder = Recorder(Events())
    execute(opened, recorder, folder / f"{name}_out")
    states = {str(report.state) for report in recorder.reports.values()}
    return Done(opened.store, states, recorder.shared, recorder.warnings, files(folder / f"{name}_out"))


def objects(url: str, kind: str) -> dict[str, bytes]:
    """The objects in a folder of the storage."""
    start = f"/{url.partition('://')[2]}/{kind}/"
    return {name: bytes(value.getvalue()) for name, value in Flaky.store.items() if name.startswith(start)}


def put(name: str, content: bytes) -> None:
    MemoryFileSystem.pipe_file(Flaky(), name, content)


@pytest.fixture(scope="module")
def alone(tmp_path_factory: pytest.TempPathFactory) -> Done:
    """A run without a shared store."""
    return run(tmp_path_factory.mktemp("alone"), "alone", "")


# -- two stores


def test_what_one_store_has_another_one_does_not_compute(tmp_path: Path, url: str, alone: Done) -> None:
    first = run(tmp_path, "first", url)
    assert first.states == {"ran"}
    assert first.shared == {"fetched": 0, "uploaded": 3, "failed": 0}
    Flaky.requests.clear()
    second = run(tmp_path, "second", url)
    assert second.states == {"cached"}
    assert second.shared == {"fetched": 3, "uploaded": 0, "failed": 0}
    assert not second.warnings
    assert alone.exports == first.exports == second.exports
    assert files(first.store.root / "cache") == files(second.store.root / "cache")
    assert [problem for _, problem in housekeeping.verify(second.store)] == [None] * 3
    assert sum("/records/" in one for one in Flaky.requests) == 3, "one request for a record"
    assert all(one.startswith("GET") for one in Flaky.requests)
    Flaky.requests.clear()
    assert run(tmp_path, "second", url).shared == {"fetched": 0, "uploaded": 0, "failed": 0}
    assert not Flaky.requests, "what the store here has is not asked for"
    assert len(housekeeping.prune(second.store, days=-1)) == 3
    assert not files(second.store.root / "cache")


def test_workers_share_too(tmp_path: Path, url: str) -> None:
    path = write_flow(tmp_path)
    for name, expected in (("first", "uploaded"), ("second", "fetched")):
        opened = Run(open_flow(path, Overrides()), Store(tmp_path / name, url))
        opened.store.create()
        step = opened.flow.steps["edges"]
        spec = opened.task(step, opened.parts(step, opened.shared), opened.shared)
        payload = worker.Payload(spec.to_json(), str(tmp_path / name), 1, remote=url)
        answer = worker.compute_once(payload, lambda _: None)
        assert Shared(**answer["shared"]) == Shared(**{expected: True})
        assert ("seconds" in answer) == (expected == "uploaded")


def test_the_first_record_stays(tmp_path: Path, url: str) -> None:
    """Two machines that computed the same at the same time; the files of both differ by the times of the runs."""
    first, second = run(tmp_path, "first", url), run(tmp_path, "second", "")
    records = objects(url, "records")
    for entry in housekeeping.entries(second.store):
        ours = exchange.Exchange(url, str(entry.stage), str(entry.key))
        ours.upload(second.store)
        assert not ours.outage
        manifests = [
            store.folder(str(entry.stage), str(entry.key)) / MANIFEST for store in (first.store, second.store)
        ]
        assert ours.uploaded == (manifests[0].read_bytes() == manifests[1].read_bytes())
    assert objects(url, "records") == records
    assert run(tmp_path, "third", url).states == {"cached"}


# -- plans


SET = """
flow: set
sources: {exemplar: {each: 'walls/*.png'}}
steps:
  edges: {stage: analysis.edges, inputs: {image: exemplar}, params: {detector: gradient}}
  structure: {stage: analysis.otsu, inputs: {strength: edges.strength}}
exports: {structure.png: structure.structure}
"""


def planned(folder: Path, name: str, url: str) -> Run:
    """A run on a store of its own that has been planned."""
    opened = Run(open_flow(folder / "flow.yaml", Overrides()), Store(folder / name, url))
    assert opened.first_plan
    return opened


def states_of(opened: Run) -> dict[str, str]:
    return {"/".join(filter(None, (step.item, step.name))): step.state for step in opened.first_plan}


def test_a_plan_asks_for_records_alone(tmp_path: Path, url: str) -> None:
    run(tmp_path, "first", url)
    (record,) = [name for name in objects(url, "records") if "/analysis.signed_distance/" in name]
    Flaky.requests.clear()
    assert states_of(planned(tmp_path, "second", url)) == dict.fromkeys(STEPS, "fetch")
    assert len(Flaky.requests) == 3
    assert all(one.startswith("GET") and "/records/" in one for one in Flaky.requests)
    assert not (tmp_path / "second").exists()
    put(record, b"{}")
    opened = planned(tmp_path, "second", url)
    assert states_of(opened) == {"edges": "fetch", "structure": "fetch", "distance": "run"}
    (reason,) = opened.first_plan[-1].reasons
    assert " is refused: " in reason
    run(tmp_path, "second", "")
    Flaky.requests.clear()
    assert set(states_of(planned(tmp_path, "second", url)).values()) == {"cached"}
    assert not Flaky.requests


def test_a_plan_of_a_set_asks_for_every_item(tmp_path: Path, url: str) -> None:
    (tmp_path / "walls").mkdir()
    for number in range(20):
        picture = np.random.default_rng(number).integers(0, 256, (24, 24)).astype(np.uint8)
        PIL.Image.fromarray(picture).save(tmp_path / "walls" / f"{number:02}.png")
    (tmp_path / "flow.yaml").write_text(SET)
    (tmp_path / "walls" / "07.png").rename(tmp_path / "seventh.png")
    run(tmp_path, "first", url)
    (tmp_path / "seventh.png").rename(tmp_path / "walls" / "07.png")
    opened = planned(tmp_path, "second", url)
    expected = {f"{number:02}/{step}": "fetch" for number in range(20) for step in ("edges", "structure")}
    assert states_of(opened) == expected | {"07/edges": "run", "07/structure": "wait"}
    assert list(states_of(opened)) == list(expected), "in the order of the items"
    assert list(opened.scopes) == [item.name for item in opened.items]


def test_a_plan_knows_what_was_chosen_elsewhere(tmp_path: Path, url: str, rng: np.random.Generator) -> None:
    write(tmp_path, CHOOSING, rng)
    first = run(tmp_path, "first", url)
    opened = planned(tmp_path, "second", url)
    assert set(states_of(opened).values()) == {"fetch"}
    assert [step.name for step in opened.skipped()] == ["noise_part", "noise_scores"]
    recorder = Recorder(Events())
    execute(opened, recorder, tmp_path / "out")  # of a run whose plan was made before, as of large exemplars
    assert recorder.shared == {"fetched": first.shared["uploaded"], "uploaded": 0, "failed": 0}
    assert files(tmp_path / "out") == first.exports


def test_a_large_result_that_is_fetched_is_not_refused(
    tmp_path: Path, url: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    run(tmp_path, "first", url)
    monkeypatch.setattr(Run, "footprint", lambda _: Footprint(memory=0, disk=2**60, in_memory={}))
    alone, shared = (
        Run(open_flow(tmp_path / "flow.yaml", Overrides()), Store(tmp_path / "b", one)) for one in ("", url)
    )
    with pytest.raises(InputError, match=r"are free there$"):
        Preflight(alone).check(tmp_path / "out")
    Preflight(shared).check(tmp_path / "out")


def test_a_plan_is_made_without_a_storage_that_does_not_answer(tmp_path: Path, url: str) -> None:
    path = write_flow(tmp_path)
    run(tmp_path, "first", url)
    Flaky.answers[:] = ["", *["drop"] * 99]
    result = texloom("plan", path, "--store", tmp_path / "second", "--remote", url)
    assert result.code == 0
    assert result.err.startswith(f"shared store: {url}: ")
    assert result.err.count("\n") == 1
    assert "1 to fetch, 1 to run, 1 waiting; fetches " in result.out


# -- a storage that fails


FAULTS = {
    "lookup dropped": ["drop", "drop"],
    "lookup hangs": ["hang"],
    "uploads dropped": ["", "drop", "", "drop", "drop"],
    "answers of uploads lost": ["", "lose", "lose", "", "lose", "lose"],
    "upload hangs": ["", "hang"],
}


@pytest.mark.parametrize("fault", FAULTS)
def test_requests_are_tried_again(tmp_path: Path, url: str, fault: str) -> None:
    Flaky.answers[:] = FAULTS[fault]
    first = exchange_with(tmp_path, url, "first")
    assert (first.uploaded, first.outage) == (True, "")
    Flaky.answers[:] = ["drop", "hang", "", "drop", "drop"]
    second = exchange_with(tmp_path, url, "second")
    assert (second.fetched, second.outage) == (True, "")


NO_ANSWER = {
    "no network": ["drop"] * 99,
    "no answer": ["hang"] * 3 + ["drop"] * 99,
    "no access": ["deny"],
    "no network after the lookup": ["", "drop", "drop", "drop"],
}


@pytest.mark.parametrize("case", NO_ANSWER)
def test_a_run_goes_on_without_it(tmp_path: Path, url: str, alone: Done, case: str) -> None:
    Flaky.answers[:] = NO_ANSWER[case]
    done = run(tmp_path, "first", url)
    assert done.states == {"ran"}
    assert done.exports == alone.exports
    assert done.shared == {"fetched": 0, "uploaded": 0, "failed": 3}
    (warning,) = done.warnings
    assert warning.startswith(f"shared store: {url}: ")
    assert warning.endswith("; the run goes on without it")
    assert len(Flaky.requests) <= 4, "it is not asked again for a while"
    assert not objects(url, "records")


def test_workers_are_told_that_it_does_not_answer(tmp_path: Path, url: str) -> None:
    store = Store(tmp_path / "first", url)
    assert not worker.shared_part(store, "key")["outage"]
    assert worker.shared_part(Store(tmp_path / "first"), "key") == {}
    remote.remote_at(url).rest("no answer")
    assert worker.shared_part(store, "key")["outage"] == "no answer"
    path = write_flow(tmp_path)
    opened = Run(open_flow(path, Overrides()), store)
    store.create()
    step = opened.flow.steps["edges"]
    spec = opened.task(step, opened.parts(step, opened.shared), opened.shared)
    payload = worker.Payload(spec.to_json(), str(store.root), 1, remote=url, outage="no answer")
    answer = worker.compute_once(payload, lambda _: None)
    assert Shared(**answer["shared"]) == Shared(outage="no answer", is_known=True)
    assert not Flaky.requests


def test_after_a_rest_it_is_asked_again(tmp_path: Path, url: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(remote, "_REST", 0.0)
    Flaky.answers[:] = ["drop"] * 3
    assert run(tmp_path, "first", url).shared == {"fetched": 0, "uploaded": 2, "failed": 1}


# -- what is not as it should be


def changed(**changes: Any) -> Any:
    return lambda record: json.dumps({**json.loads(record), **changes}).encode()


def with_file(name: str, **changes: Any) -> Any:
    def change(record: bytes) -> bytes:
        found = json.loads(record)
        entry = {**next(iter(found["files"].values())), **changes}
        return json.dumps({**found, "files": {**found["files"], name: entry}}).encode()

    return change


REFUSED = {
    "no JSON": (lambda record: record[:-9], "it cannot be read"),
    "empty": (lambda _: b"", "it cannot be read"),
    "a list": (lambda _: b"[]", "it cannot be read"),
    "nested": (lambda _: b"[" * 100_000, "it cannot be read"),
    "large": (lambda record: record + b" " * (1 << 24), "it is too large"),
    "another key": (changed(key="0" * 64), "it is that of another result"),
    "other outputs": (changed(outputs={"image": "0" * 64}), "its outputs are not those of the stage"),
    "numbers": (changed(outputs=3), "it cannot be read"),
    "upwards": (with_file("../x.png"), "it lists '../x.png', which no such result has"),
    "absolute": (with_file("/tmp/x.png"), "it lists '/tmp/x.png', which no such result has"),
    "unknown": (with_file("run.py"), "it lists 'run.py', which no such result has"),
    "manifest": (with_file("manifest.json"), "it lists 'manifest.json', which no such result has"),
    "digest": (with_file("result.exr", sha256="../../secret"), "its entry of result.exr is not one"),
    "bytes": (with_file("result.exr", bytes=-1), "its entry of result.exr is not one"),
    "true": (with_file("result.exr", bytes=True), "its entry of result.exr is not one"),
    "longer": (with_file("result.exr", bytes=1 << 19), "result.exr is missing, or not what its record says"),
    "endless": (with_file("result.exr", bytes=1 << 61), "its files have 23058430092"),
    "missing": (with_file("result.exr", sha256="0" * 64), "result.exr is missing, or not what its record says"),
}


@pytest.mark.parametrize("case", REFUSED)
def test_a_record_is_refused_and_replaced(tmp_path: Path, url: str, case: str) -> None:
    change, message = REFUSED[case]
    shared = stored(tmp_path, url)
    (name, record), *_ = objects(url, "records").items()
    put(name, change(record))
    got = exchange_with(tmp_path, url, "second")
    assert (got.fetched, got.uploaded) == (False, True)
    assert message in got.refusal
    assert "\n" not in got.refusal
    assert not list((tmp_path / "second" / "cache").rglob(".new-*"))
    assert objects(url, "records")[name] != change(record)
    assert exchange_with(tmp_path, url, "third").fetched
    assert shared


@pytest.mark.parametrize("content", [b"", b"x", None])
def test_a_file_is_refused(tmp_path: Path, url: str, content: bytes | None) -> None:
    stored(tmp_path, url)
    for name, whole in objects(url, "files").items():
        put(name, bytes(len(whole)) if content is None else content)
    got = exchange_with(tmp_path, url, "second")
    assert "missing, or not what its record says" in got.refusal
    assert got.uploaded
    assert exchange_with(tmp_path, url, "third").fetched


def stored(folder: Path, url: str) -> exchange.Exchange:
    """One result in the storage."""
    return exchange_with(folder, url, "first")


def exchange_with(folder: Path, url: str, name: str) -> exchange.Exchange:
    """What passes for the first step of the flow on the store called ``name``."""
    path = folder / "flow.yaml" if (folder / "flow.yaml").exists() else write_flow(folder)
    opened = Run(open_flow(path, Overrides()), Store(folder / name, url))
    opened.store.create()
    step = opened.flow.steps["edges"]
    spec = opened.task(step, opened.parts(step, opened.shared), opened.shared)
    of_step = exchange.exchange_of(opened.store, spec.parts.stage, spec.parts.key)
    assert of_step is not None

    def work() -> dict[str, Any]:
        return worker._compute(spec, opened.store, 1, lambda _: None)["record"]

    keep_record(opened.store, spec.parts.stage, spec.parts.key, work, of_step)
    return of_step


def test_a_refusal_is_told_once(tmp_path: Path, url: str) -> None:
    first = run(tmp_path, "first", url)
    for name in objects(url, "records"):
        put(name, b"{}")
    done = run(tmp_path, "second", url)
    assert (done.states, done.exports) == ({"ran"}, first.exports)
    assert done.shared == {"fetched": 0, "uploaded": 3, "failed": 3}
    assert len(done.warnings) == 3
    assert done.warnings[0].endswith(".json is refused: it cannot be read; computing it")


def test_what_cannot_be_decoded_is_computed_and_replaced(tmp_path: Path, url: str) -> None:
    """Files of the right digests that hold nothing of use are found out when they are read."""
    first = run(tmp_path, "first", url)
    for entry in housekeeping.entries(first.store):
        folder = first.store.folder(str(entry.stage), str(entry.key))
        manifest = json.loads((folder / MANIFEST).read_bytes())
        bad = {**next(iter(manifest["files"].values())), "bytes": 3, "sha256": sha256(b"bad")}
        record = {**manifest, "files": dict.fromkeys(manifest["files"], bad)}
        prefix = f"/{url.partition('://')[2]}"
        put(f"{prefix}/files/{sha256(b'bad')}", b"bad")
        put(f"{prefix}/records/{entry.stage}/{entry.key}.json", json.dumps(record).encode())
    done = run(tmp_path, "second", url)
    assert done.exports == first.exports
    assert run(tmp_path, "third", url).exports == first.exports


def sha256(content: bytes) -> str:
    import hashlib

    return hashlib.sha256(content).hexdigest()


# -- how it is named


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ("bucket", "--remote bucket: must be like s3://BUCKET/PREFIX"),
        ("", "--remote: the value is empty"),
        ("simplecache::s3://a/b", "--remote simplecache::s3://a/b: must be like s3://BUCKET/PREFIX"),
        ("nothing://a/b", "--remote nothing://a/b: fsspec knows no protocol nothing"),
        (
            "s3://name:word@bucket/a",
            "--remote: an address holds no user or password; give those as the storage's variables say",
        ),
    ],
)
def test_other_addresses_are_refused(given: str, message: str) -> None:
    with pytest.raises(InputError) as caught:
        remote.check_url(given, "--remote")
    assert str(caught.value) == message
    result = texloom("plan", "quilting", "--remote", given)
    assert (result.code, result.err) == (2, f"texloom: {message}\n")


def test_what_is_not_installed_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(importlib.util, "find_spec", lambda name: None)
    with pytest.raises(
        InputError, match=r"^--remote s3://a/b: fsspec is not installed; pip install 'texloom\[remote\]'$"
    ):
        remote.check_url("s3://a/b", "--remote")
    monkeypatch.setattr(importlib.util, "find_spec", lambda name: None if name == "s3fs" else name)
    with pytest.raises(
        InputError, match=r"^--remote s3://a/b: s3fs is not installed; pip install 'texloom\[remote\]'$"
    ):
        remote.check_url("s3://a/b", "--remote")


def test_python_and_the_variable(tmp_path: Path, url: str, monkeypatch: pytest.MonkeyPatch) -> None:
    path = write_flow(tmp_path)
    done = api.run(path, store=tmp_path / "a", out=tmp_path / "out", remote=url)
    assert done.shared == {"fetched": 0, "uploaded": 3, "failed": 0}
    monkeypatch.setenv("TEXLOOM_REMOTE", url)
    result = texloom("run", path, "--store", tmp_path / "b", "--out", tmp_path / "out_b", "--json")
    assert json.loads(result.out)["shared"] == {"remote": url, "fetched": 3, "uploaded": 0, "failed": 0}
    assert "3 cached in " in result.err
    assert "; 3 fetched; " in result.err
    planned = json.loads(texloom("plan", path, "--store", tmp_path / "c", "--json").out)
    assert planned["summary"]["states"] == {"fetch": 3}
    kept = files(tmp_path / "a" / "cache")
    assert planned["summary"]["fetched"] == sum(
        len(content) for name, content in kept.items() if not name.endswith(MANIFEST)
    )
    monkeypatch.delenv("TEXLOOM_REMOTE")
    assert {step.state for step in api.plan(path, store=tmp_path / "c", remote=url)} == {"fetch"}
    assert {step.state for step in api.plan(path, store=tmp_path / "c")} == {"run", "wait"}
    assert not (tmp_path / "c").exists()
    opened = Run(open_flow(path, Overrides()), Store(tmp_path / "b", url))
    (line,) = command_list(opened.flow, [], tmp_path / "b", tmp_path / "out", False, url).lines()
    assert line.endswith(f"--remote {url}")


def test_push(tmp_path: Path, url: str) -> None:
    first = run(tmp_path, "first", "")
    words = ("store", "push", "--store", first.store.root)
    assert texloom(*words).err == "texloom: --remote: required; or set TEXLOOM_REMOTE\n"
    broken = next(first.store.root.rglob("result.exr"))
    broken.write_bytes(broken.read_bytes()[:-1])
    result = texloom(*words, "--remote", url)
    assert (result.code, result.out) == (1, f"{url}: 2 uploaded, 0 there before, 1 broken\n")
    run(tmp_path, "first", "")
    report = json.loads(texloom(*words, "--remote", url, "--json").out)
    assert report == {"remote": url, "uploaded": 1, "present": 2, "broken": 0, "left_out": 0, "outage": ""}
    assert run(tmp_path, "second", url).states == {"cached"}
    Flaky.answers[:] = ["", "deny"]
    result = texloom(*words, "--remote", url)
    assert (result.code, result.out) == (1, f"{url}: 0 uploaded, 1 there before, 0 broken\n")
    assert result.err == f"texloom: {url}: access denied; push again to go on\n"


def test_without_a_shared_store_fsspec_is_not_imported() -> None:
    code = (
        "import sys; from texloom.pipelines.store import exchange, keep, location; location.shared_store(None); "
        "import texloom.pipelines.engine.opening; print({'fsspec', 's3fs'} & set(sys.modules))"
    )
    variables = {**os.environ, "TEXLOOM_REMOTE": ""}
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False, env=variables)
    assert (done.stdout, done.stderr) == ("set()\n", "")


# -- a server that speaks S3


@pytest.mark.skipif(
    importlib.util.find_spec("moto") is None or importlib.util.find_spec("s3fs") is None,
    reason="moto[server] and s3fs are not installed",
)
@pytest.mark.filterwarnings("default")
def test_s3(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    import boto3
    from moto.server import ThreadedMotoServer

    monkeypatch.delenv("PREFECT_API_URL", raising=False)
    for name, value in {"ACCESS_KEY_ID": "a", "SECRET_ACCESS_KEY": "b", "DEFAULT_REGION": "us-east-1"}.items():
        monkeypatch.setenv(f"AWS_{name}", value)
    server = ThreadedMotoServer(ip_address="127.0.0.1", port=0, verbose=False)
    server.start()
    try:
        host, port = server.get_host_and_port()
        monkeypatch.setenv("AWS_ENDPOINT_URL", f"http://{host}:{port}")
        boto3.client("s3").create_bucket(Bucket="textures")
        url = "s3://textures/shared"
        first = run(tmp_path, "first", url)
        assert first.shared == {"fetched": 0, "uploaded": 3, "failed": 0}
        assert set(states_of(planned(tmp_path, "second", url)).values()) == {"fetch"}
        second = run(tmp_path, "second", url)
        assert (second.states, second.shared["fetched"], second.exports) == ({"cached"}, 3, first.exports)
        at = remote.remote_at(url)
        assert at.write("records/one", b"first")
        assert not at.write("records/one", b"second"), "the condition of the write holds"
        assert at.write("records/one", b"first")
        assert at.write("records/one", b"third", replace=True)
        assert at.read("records/one", 0, 99) == b"third"
        assert at.read("records/none", 0, 99) is None
        assert at.write("records/empty", b"")
        assert at.read("records/empty", 0, 99) == b""
        other = run(tmp_path, "third", "s3://nobody/shared")
        assert other.states == {"ran"}
        assert other.warnings == [
            "shared store: s3://nobody/shared: The specified bucket does not exist; the run goes on without it"
        ]
    finally:
        with contextlib.suppress(Exception):
            server.stop()
