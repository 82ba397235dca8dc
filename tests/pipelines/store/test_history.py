"""What is kept of the last runs of a flow."""

from __future__ import annotations

import hashlib
import os
from pathlib import Path
from typing import Any

import pytest

from tests.pipelines.store.results import KEY, STAGE, finished
from texloom.pipelines.store import checked_json
from texloom.pipelines.store.history import History
from texloom.pipelines.store.store import Store

PARTS = {"stage": STAGE.name, "params": {"smallest": 3}}


@pytest.fixture
def store(tmp_path: Path) -> Store:
    made = Store(tmp_path / "artifacts")
    made.create()
    return made


def run(store: Store, *steps: str) -> History:
    history = History(store, "flow")
    for step in steps:
        history.add(step, PARTS, store.location(STAGE.name, KEY), is_new=False)
    history.save()
    return history


def test_a_result_is_as_the_last_run_left_it(store: Store) -> None:
    artifact = finished(store)
    history = History(store, "flow")
    history.add("a", PARTS, artifact, is_new=True)
    history.save()
    assert History(store, "flow").find("a", PARTS) == artifact
    assert History(store, "flow").find("a", {**PARTS, "params": {"smallest": 4}}) is None
    assert History(store, "flow").find("b", PARTS) is None
    assert History(store, "other").find("a", PARTS) is None
    store.touch(artifact, history.now + 1)
    assert History(store, "flow").find("a", PARTS) is None


def test_steps_of_earlier_runs_are_kept_up_to_a_number(store: Store, monkeypatch: pytest.MonkeyPatch) -> None:
    finished(store)
    run(store, "a", "b")
    run(store, "c")
    assert set(History(store, "flow").steps) == {"a", "b", "c"}
    monkeypatch.setattr("texloom.pipelines.store.history._MOST_STEPS", 3)
    run(store, "c", "d")
    assert set(History(store, "flow").steps) == {"c", "d"}


@pytest.mark.parametrize(
    "document",
    [
        {},
        {"steps": 5, "exports": [1]},
        {"steps": {"a": 5}, "exports": {"b": {"key": 5, "files": []}}},
        {"steps": {"a": {"stage": STAGE.name, "key": "../elsewhere", "manifest": "", "outputs": {}, "folder": []}}},
        {"steps": {"a": {"stage": STAGE.name, "key": KEY, "manifest": "", "outputs": {"b": 1}, "folder": []}}},
        {
            "steps": {
                "a": {"stage": STAGE.name, "key": KEY, "manifest": "", "outputs": {}, "inputs": 5, "folder": []}
            }
        },
    ],
)
def test_what_others_wrote_is_as_good_as_absent(store: Store, document: dict[str, Any]) -> None:
    """They can compute the digest too."""
    checked_json.write(store.root / "history" / "flow", document)
    history = History(store, "flow")
    assert (history.steps, history.exports, history.find("a", PARTS)) == ({}, {}, None)


@pytest.mark.parametrize("content", [b"[1]", b"[" * 100_000, b"5", b"no"])
def test_a_table_that_is_none(tmp_path: Path, content: bytes) -> None:
    path = tmp_path / "table.json"
    path.write_bytes(hashlib.sha256(content).hexdigest().encode() + b"\n" + content)
    assert checked_json.read(path) == {}


def test_what_was_altered_is_as_good_as_absent(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "folder" / "table.json"
    checked_json.write(path, {"a": [1]})
    assert checked_json.read(path) == {"a": [1]}
    with monkeypatch.context() as patch:
        patch.setattr(checked_json, "_MAX_SIZE", 10)
        assert checked_json.read(path) == {}
    path.write_bytes(path.read_bytes().replace(b"1]", b"2]"))
    assert checked_json.read(path) == checked_json.read(tmp_path / "none") == {}
    os.mkfifo(tmp_path / "pipe")
    assert checked_json.read(tmp_path / "pipe") == {}
