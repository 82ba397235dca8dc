"""Runs whose store fails, see `tests.faults`, and what becomes of a task when a disk does not answer."""

from __future__ import annotations

import errno
import os
from pathlib import Path

import pytest

from tests import faults
from tests.pipelines.engine.test_scheduler import Bench, one_by_one, opened
from tests.pipelines.flows import files, write_set
from texloom.pipelines.engine import attempt
from texloom.pipelines.engine.executors.executor import Outcome
from texloom.pipelines.errors import UnreachableError
from texloom.pipelines.store import store as stores
from texloom.pipelines.store.record import record_name
from texloom.pipelines.store.result_files import BrokenArtifactError
from texloom.pipelines.store.store import Store

NO_ANSWER = OSError(errno.EIO, os.strerror(errno.EIO))


@pytest.fixture(scope="module")
def shared(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Where the files that a whole run makes are kept for all faults."""
    return tmp_path_factory.mktemp("faults")


@pytest.mark.skipif(os.name == "nt", reason="descriptors by /proc, signals of processes")
@pytest.mark.parametrize("fault", ["comes_back", "moved"])
def test_nothing_is_lost(shared: Path, fault: str) -> None:
    assert faults.tried(shared, fault, "local") == []


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setattr(attempt.time, "sleep", lambda _: None)
    return write_set(tmp_path).parent


def test_a_disk_that_answers_again_is_waited_for(folder: Path) -> None:
    left = ["a-1/start"] * 3

    def raised(label: str) -> Outcome | None:
        return Outcome(error=NO_ANSWER) if left and label == left[-1] and left.pop() else None

    listener, _ = Bench(instead=raised).run(opened(folder))
    assert not left
    assert set(listener.items.values()) == {None}
    waits = [note for note in listener.notes if note.endswith("; waiting for it")]
    assert waits == [f"--store {folder / 'artifacts'}: {NO_ANSWER}; waiting for it"] * 3
    assert files(folder / "out") == one_by_one(folder)


def test_what_is_never_read_fails_by_itself(folder: Path) -> None:
    """As one file in a bad sector."""
    bench = Bench(instead=lambda label: Outcome(error=NO_ANSWER) if label == "b-2/start" else None)
    listener, _ = bench.run(opened(folder))
    assert {name: problem for name, problem in listener.items.items() if problem} == {
        "b-2": f"start failed: {NO_ANSWER}"
    }


def test_a_store_that_is_gone_is_not_made_anew(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(attempt, "_PATIENCE", 0.0)
    run = opened(folder)

    def moved(label: str) -> Outcome | None:
        if label == "c-1/start":
            run.store.root.rename(folder / "moved")
        return None

    with pytest.raises(UnreachableError, match="is not there any more; was it moved, or its disk unmounted"):
        Bench(instead=moved).run(run)
    assert not run.store.root.exists()
    listener, _ = Bench().run(opened(folder, "moved"), "again")
    assert "cached" in listener.states.values()
    assert files(folder / "again") == one_by_one(folder)


def test_a_store_that_goes_while_its_folders_are_made(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    store = Store(tmp_path / "store")
    store.create()
    probe = stores.probe_folder
    monkeypatch.setattr(stores, "probe_folder", lambda root: (store.root.rename(tmp_path / "moved"), probe(root)))
    with pytest.raises(UnreachableError):
        store.create()


def test_a_lock_that_was_made_where_a_store_was_goes(tmp_path: Path) -> None:
    """`filelock` makes the folder of its file; the empty root may be where a disk is mounted, and stays."""
    store = Store(tmp_path / "store")
    store.create()
    lock = store.lock(record_name("analysis.otsu", "0" * 64))
    store.root.rename(tmp_path / "moved")
    with lock:
        assert store.locks.is_dir()
    assert not store.is_there()
    assert list(store.root.iterdir()) == []
    store.locks.mkdir()
    (store.locks / "yarn.lock").touch()
    assert not store.is_there()
    assert [path.name for path in store.locks.iterdir()] == ["yarn.lock"]


def test_a_record_that_cannot_be_read(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """It is broken where the disk answers otherwise, and stays where the disk does not."""

    def unreadable(_: str) -> bytes:
        raise NO_ANSWER

    store = Store(tmp_path / "store")
    store.create()
    monkeypatch.setattr(stores, "small_file", unreadable)
    with pytest.raises(BrokenArtifactError, match="its record cannot be read"):
        store.read_record("one")
    (tmp_path / "store" / "identity").unlink()
    with pytest.raises(UnreachableError):
        store.read_record("one")
