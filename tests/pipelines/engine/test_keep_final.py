"""``keep: final``: what only other steps take is not kept, and is computed again where something takes it."""

from __future__ import annotations

import dataclasses
import multiprocessing
import shutil
from collections.abc import Mapping
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from texloom.pipelines.engine.attempt import compute
from texloom.pipelines.engine.events import Event, Note, StepReport
from texloom.pipelines.engine.plan_summary import summary
from texloom.pipelines.engine.run import Run
from texloom.pipelines.flow.command_list import only_item
from texloom.pipelines.flow.loader import load_flow
from texloom.pipelines.flow.model import Overrides
from texloom.pipelines.store import exchange, housekeeping
from texloom.pipelines.store.history import History
from texloom.pipelines.store.record import encode_record, record_name
from texloom.pipelines.store.store import Artifact, Store
from texloom.stages.vocabulary.declare import InputError

FLOW = """\
flow: tiny
keep: final
sources:
  exemplar: {each: pictures/*.png}
steps:
  strength: {stage: analysis.edges, inputs: {image: exemplar}, params: {detector: gradient}}
  structure: {stage: analysis.otsu, inputs: {strength: strength.strength}}
  distance: {stage: analysis.signed_distance, inputs: {structure: structure.structure}}
exports:
  distance.exr: distance.field
"""


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    (tmp_path / "pictures").mkdir()
    rng = np.random.default_rng(1)
    for name in "abc":
        values = rng.integers(0, 255, (48, 64), np.uint8)
        Image.fromarray(values).save(tmp_path / "pictures" / f"{name}.png")
    (tmp_path / "set.yaml").write_text(FLOW)
    (tmp_path / "one.yaml").write_text(FLOW.replace("{each: pictures/*.png}", "pictures/a.png"))
    return tmp_path


def opened(folder: Path, flow: str = "one.yaml", **overrides: object) -> Run:
    return Run(load_flow(folder / flow, Overrides(**overrides)), Store(folder / "store"))


def run(one: Run) -> tuple[dict[str, str], list[str]]:
    """Step to its state, and what is told."""
    events: list[Event] = []
    compute(one, events.append, one.store.root.parent / "out")
    states: dict[str, str] = {}
    for event in events:
        if isinstance(event, StepReport) and (event.label not in states or event.state != "cached"):
            states[event.label] = event.state
    return states, [event.text for event in events if isinstance(event, Note)]


def plan(one: Run) -> dict[str, str]:
    return {step.name: step.state for step in one.plan()}


def artifact(one: Run, step: str) -> Artifact:
    found = one.shared.artifacts[step]
    return dataclasses.replace(one.store.find(found.stage, found.key) or found)


def files(one: Run, step: str) -> set[str]:
    return {path.name for path in artifact(one, step).folder.iterdir()}


def size(folder: Path) -> int:
    """Bytes of the files but the manifests, which have times."""
    return sum(path.stat().st_size for path in folder.rglob("*.[!j]*") if path.is_file())


def test_only_final_results_are_left_and_all_is_cached(folder: Path) -> None:
    whole = opened(folder, keep="all")
    run(whole)
    kept = size(whole.store.root / "cache")
    shutil.rmtree(whole.store.root)
    first = opened(folder)
    assert first.flow.intermediate == {"strength", "structure"}
    states, notes = run(first)
    assert set(states.values()) == {"ran"}
    saved = sum(first.left_out.values())
    assert len(first.left_out) == 2
    assert "keep: final: 2 intermediate results left out of the store, " in notes[-1]
    assert files(first, "strength") == files(first, "structure") == {"manifest.json"}
    assert "result.exr" in files(first, "distance")
    assert size(first.store.root / "cache") == kept - saved
    again = opened(folder)
    assert plan(again) == dict.fromkeys(states, "cached")
    states, notes = run(opened(folder))
    assert set(states.values()) == {"cached"}
    assert notes == []
    verified = list(housekeeping.verify(first.store))
    assert [problem for _, problem in verified] == [None] * 3
    assert {entry.key: entry.left_out for entry, _ in verified if entry.left_out} == first.left_out


def test_what_a_change_takes_is_computed_again(folder: Path) -> None:
    run(opened(folder))
    expected = opened(folder, params={"structure.min_extent": "0.2"}, keep="all")
    expected.store = Store(folder / "other")
    run(expected)
    changed = opened(folder, params={"structure.min_extent": "0.2"})
    planned = {step.name: step for step in changed.plan()}
    assert planned["strength"].state == "run"
    assert planned["strength"].reasons == ("was left out, and structure takes it",)
    states, _ = run(opened(folder, params={"structure.min_extent": "0.2"}))
    assert states["strength"] == states["structure"] == "ran"
    for name, one in expected.shared.artifacts.items():
        found = changed.store.find(one.stage, one.key)
        assert found is not None, name
        assert found.outputs == one.outputs


def test_an_export_of_what_was_left_out_is_written(folder: Path) -> None:
    run(opened(folder))
    asked = {"strength.exr": "strength.strength"}
    assert plan(opened(folder, exports=asked)) == {"strength": "run", "structure": "cached", "distance": "cached"}
    more = opened(folder, exports=asked)
    assert run(more)[0] == {"strength": "ran", "structure": "cached", "distance": "cached"}
    assert (folder / "out" / "strength.exr").exists()
    assert "result.exr" in files(more, "strength"), "it is exported now"


def test_items_of_a_set_are_left_out_one_by_one_and_found_again(folder: Path) -> None:
    first = opened(folder, "set.yaml")
    states, notes = run(first)
    assert len(states) == 9
    assert "6 intermediate results" in notes[-1]
    assert {step.state for step in opened(folder, "set.yaml").plan()} == {"cached"}
    states, _ = run(opened(folder, "set.yaml"))
    assert set(states.values()) == {"cached"}
    changed = opened(folder, "set.yaml", params={"structure.min_extent": "0.2"})
    states, _ = run(changed)
    assert [state for label, state in states.items() if label.endswith("strength")] == ["ran"] * 3


def test_one_item_keeps_what_others_and_gathering_steps_take(folder: Path) -> None:
    text = FLOW.replace(
        "exports:", "  report: {stage: evaluation.contact_sheet, gather: {images: thumb.image}}\nexports:"
    )
    text = text.replace("  report", "  thumb: {stage: evaluation.thumbnail, inputs: {image: exemplar}}\n  report")
    (folder / "gather.yaml").write_text(text)
    flow = load_flow(folder / "gather.yaml")
    assert flow.intermediate == {"strength", "structure"}
    assert only_item(flow, "a").intermediate == {"strength", "structure"}


def test_a_run_under_way_has_what_it_takes(folder: Path) -> None:
    """What a later run uses stays, and what is taken away under a run is computed again."""
    one = opened(folder, keep="all")
    run(one)
    found = artifact(one, "strength")
    assert one.store.leave_out(found, History(one.store, "x").now - 10**15) is None
    assert "result.exr" in files(one, "strength")
    with one.store.lock(record_name(found.stage, found.key)):
        assert one.store.leave_out(found, History(one.store, "x").now) is None
    assert one.store.leave_out(found, History(one.store, "x").now) is not None
    assert files(one, "strength") == {"manifest.json"}
    assert one.store.leave_out(found, History(one.store, "x").now) is not None, "it may be repeated"


def test_files_of_others_keep_a_result_whole(folder: Path) -> None:
    one = opened(folder, keep="all")
    run(one)
    found = artifact(one, "strength")
    (found.folder / "notes.txt").write_text("mine")
    assert one.store.leave_out(found, History(one.store, "x").now) is None
    assert "result.exr" in files(one, "strength")
    assert "notes.txt" in files(one, "strength")


@pytest.mark.parametrize("left_out", [0, -1, True, "1", None, [], 2.5])
def test_a_record_of_other_form_is_not_believed(folder: Path, left_out: object) -> None:
    """Without its files a result is broken, unless its record has the form of one that was left out."""
    run(opened(folder))
    one = opened(folder)
    one.plan()
    found = artifact(one, "strength")
    name = record_name(found.stage, found.key)
    content: Mapping[str, object] = {**found.record, "left_out": left_out}
    (one.store.records / name).write_bytes(encode_record(dict(content), name))
    assert plan(opened(folder))["strength"] == "run"
    assert run(opened(folder))[0] == {"strength": "ran", "structure": "cached", "distance": "cached"}


def test_an_altered_manifest_is_computed_again(folder: Path) -> None:
    run(opened(folder))
    one = opened(folder)
    one.plan()
    manifest = artifact(one, "strength").folder / "manifest.json"
    manifest.write_text(manifest.read_text().replace("64", "65", 1) + " ")
    assert [problem for _, problem in housekeeping.verify(one.store)].count(None) == 2
    assert run(opened(folder))[0]["strength"] == "ran"


def test_sizes_are_those_of_the_files_and_pruning_removes_all(folder: Path) -> None:
    one = opened(folder, keep="all")
    run(one)
    before = {entry.key: entry.size for entry in housekeeping.entries(one.store)}
    final = opened(folder)
    run(final)
    assert final.left_out.keys() <= before.keys()
    after = {entry.key: entry.size for entry in housekeeping.entries(one.store)}
    assert after == {entry.key: entry.size for entry in housekeeping.entries(one.store, measured=True)}
    housekeeping.prune(one.store, 0)
    assert housekeeping.entries(one.store) == []
    assert list((one.store.root / "records").iterdir()) == []


def test_they_are_not_uploaded(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    one = opened(folder)
    run(one)
    uploaded: list[str] = []
    monkeypatch.setattr(exchange.Exchange, "is_there", lambda _: False)
    monkeypatch.setattr(exchange.Exchange, "upload", lambda self, _: uploaded.append(self._stage))
    monkeypatch.setattr(exchange, "remote_at", lambda _: None)
    assert exchange.push(one.store).left_out == 2
    assert uploaded == ["analysis.signed_distance"]


def test_the_plan_says_what_will_be_left_out(folder: Path) -> None:
    one = opened(folder)
    told = summary(one, one.plan())
    assert 0 < told.left_out < told.disk
    assert "is left out at the end (keep: final)" in str(told)
    all_kept = opened(folder, keep="all")
    assert summary(all_kept, all_kept.plan()).left_out == 0


@pytest.mark.parametrize("value", ["most", "3", "[final]", "{a: b}", "true"])
def test_other_words_are_refused(folder: Path, value: str) -> None:
    (folder / "bad.yaml").write_text(FLOW.replace("keep: final", f"keep: {value}"))
    with pytest.raises(InputError, match=r"bad.yaml: keep: must be all or final, got "):
        load_flow(folder / "bad.yaml")


def test_the_history_has_what_was_left_out(folder: Path) -> None:
    one = opened(folder)
    run(one)
    known = History(one.store, "tiny")
    assert known.steps["strength"]["left_out"] == one.shared.artifacts["strength"].left_out > 0
    found = known.find("strength", {})
    assert found is not None
    assert found.left_out > 0


def test_a_large_set_finds_them_by_its_history(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("texloom.pipelines.engine.run._MANY", 2)
    run(opened(folder, "set.yaml"))
    assert set(run(opened(folder, "set.yaml"))[0].values()) == {"cached"}
    third = opened(folder, "set.yaml")
    with monkeypatch.context() as patched:
        patched.setattr(Store, "read_record", None)  # not called
        assert set(run(third)[0].values()) == {"cached"}


def test_workers_compute_what_is_taken_again(folder: Path) -> None:
    run(opened(folder, "set.yaml"))
    changed = {"params": {"structure.min_extent": "0.2"}, "runner": {"name": "processes", "workers": 2}}
    states, _ = run(opened(folder, "set.yaml", **changed))
    assert sorted(states.values()) == ["ran"] * 9


def test_items_that_share_results_share_what_is_left_out(folder: Path) -> None:
    shutil.copy(folder / "pictures" / "a.png", folder / "pictures" / "d.png")
    states, _ = run(opened(folder, "set.yaml"))
    assert len(states) == 12
    assert "failed" not in states.values()
    assert set(run(opened(folder, "set.yaml"))[0].values()) == {"cached"}


def remove_again_and_again(root: str, ready: multiprocessing.synchronize.Event) -> None:
    """Another process that prunes, limits, lists and verifies a store until it is killed."""
    store = Store(Path(root))
    ready.set()
    while True:
        housekeeping.prune(store, 0)
        housekeeping.entries(store)
        for _ in housekeeping.verify(store):
            pass


def test_runs_beside_prune_have_their_results(folder: Path) -> None:
    expected = opened(folder, keep="all")
    expected.store = Store(folder / "other")
    run(expected)
    opened(folder).store.create()
    context = multiprocessing.get_context("spawn")
    ready = context.Event()
    process = context.Process(target=remove_again_and_again, args=(str(folder / "store"), ready))
    process.start()
    try:
        assert ready.wait(60)
        for _ in range(10):
            one = opened(folder)
            run(one)
            assert one.shared.artifacts.keys() == expected.shared.artifacts.keys()
            for name, found in one.shared.artifacts.items():
                assert found.outputs == expected.shared.artifacts[name].outputs
    finally:
        process.kill()
        process.join()
    run(opened(folder))
    assert {problem for _, problem in housekeeping.verify(opened(folder).store)} == {None}


def test_a_kill_between_record_and_files_loses_nothing(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    one = opened(folder, keep="all")
    run(one)

    def killed(*_: object) -> None:
        raise OSError(5, "killed")

    monkeypatch.setattr("texloom.pipelines.store.store.keep_manifest", killed)
    assert run(opened(folder))[0]["distance"] == "cached"
    monkeypatch.undo()
    assert set(run(opened(folder))[0].values()) == {"cached"}
    assert {problem for _, problem in housekeeping.verify(one.store)} == {None}
    asked = {"strength.exr": "strength.strength"}
    assert run(opened(folder, exports=asked))[0] == {"strength": "ran", "structure": "cached", "distance": "cached"}
