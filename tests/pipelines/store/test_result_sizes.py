"""The index of sizes: listings are those of the files, whatever it holds, and it removes nothing."""

from __future__ import annotations

import array
import hashlib
import multiprocessing
import os
import shutil
import signal
import threading
import time
from pathlib import Path

import numpy as np
import pytest

from tests.pipelines.store.results import STAGE, finished, write_record
from texloom.pipelines.store import folders, housekeeping, result_sizes, usage
from texloom.pipelines.store.record import record_name
from texloom.pipelines.store.store import Store
from texloom.stages.analysis.structure.otsu import Otsu

KEYS = [hashlib.sha256(str(number).encode()).hexdigest() for number in range(8)]


@pytest.fixture(autouse=True)
def always(monkeypatch: pytest.MonkeyPatch) -> None:
    """Stores of few results have an index too."""
    monkeypatch.setattr(result_sizes, "_FEW", 0)


@pytest.fixture
def store(tmp_path: Path) -> Store:
    made = Store(tmp_path / "artifacts")
    made.create()
    for key in KEYS[:4]:
        finished(made, key)
    return made


def index(store: Store) -> Path:
    return store.root / "result_sizes"


def listed(store: Store) -> dict[str, int]:
    return {str(entry.key): entry.size for entry in housekeeping.entries(store)}


def on_disk(store: Store) -> dict[str, int]:
    """Bytes of the files of each result, and its record."""
    sizes = {}
    for folder in (store.root / "cache" / STAGE.name).iterdir():
        files = [*folder.iterdir(), store.records / record_name(STAGE.name, folder.name)]
        sizes[folder.name] = sum(path.stat().st_size for path in files)
    return sizes


def measured(store: Store, monkeypatch: pytest.MonkeyPatch) -> int:
    """How many results a listing measures."""
    size_of, seen = usage.size_of, []

    def watched(path: str | Path) -> int:
        seen.append(Path(path).name)
        return size_of(path)

    with monkeypatch.context() as patched:
        patched.setattr(usage, "size_of", watched)
        listed(store)
    return len([name for name in seen if name in KEYS])


def larger(store: Store, key: str) -> None:
    """Compute a result again, as a version of texloom whose files are larger."""
    noise = np.random.default_rng(1).random((200, 300)) > 0.5
    write_record(store, store.save(STAGE, key, Otsu(structure=noise, threshold=0.5), {}))


def write_index(store: Store, content: bytes) -> None:
    """An index by somebody who knows its form."""
    index(store).write_bytes(hashlib.sha256(content).hexdigest().encode() + b"\n" + content)


def test_what_was_measured_is_not_measured_again(store: Store, monkeypatch: pytest.MonkeyPatch) -> None:
    assert not index(store).exists()
    assert measured(store, monkeypatch) == 4
    assert measured(store, monkeypatch) == 0
    assert listed(store) == on_disk(store)
    index(store).unlink()
    assert listed(store) == on_disk(store)
    assert index(store).exists()


def test_a_few_new_results_are_measured_and_the_index_stays(store: Store, monkeypatch: pytest.MonkeyPatch) -> None:
    listed(store)
    before = index(store).read_bytes()
    monkeypatch.setattr(result_sizes, "_FEW", 1)
    finished(store, KEYS[4])
    assert measured(store, monkeypatch) == measured(store, monkeypatch) == 1
    assert index(store).read_bytes() == before
    finished(store, KEYS[5])
    assert [measured(store, monkeypatch), measured(store, monkeypatch)] == [2, 0]


def test_what_others_do_to_the_store_is_seen(store: Store) -> None:
    """Versions of texloom that know of no index, and users by hand, as nothing is told to it."""
    listed(store)
    finished(store, KEYS[4])
    shutil.rmtree(store.folder(STAGE.name, KEYS[0]))
    larger(store, KEYS[1])
    store.remove(STAGE.name, KEYS[2])
    assert listed(store) == on_disk(store)
    assert listed(store).keys() == {KEYS[1], KEYS[3], KEYS[4]}


def test_copies_of_a_store_are_measured(store: Store, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    listed(store)
    copy = Store(shutil.copytree(store.root, tmp_path / "copy"))
    larger(copy, KEYS[1])
    assert measured(copy, monkeypatch) == 4
    assert listed(copy) == on_disk(copy)
    moved = Store(store.root.rename(tmp_path / "moved"))
    assert measured(moved, monkeypatch) == 0


def test_a_result_without_a_record_is_not_noted(store: Store) -> None:
    """As of one that is just being written: its record comes later."""
    artifact = store.save(STAGE, KEYS[4], Otsu(structure=np.ones((9, 9), bool), threshold=0.5), {})
    listed(store)
    write_record(store, artifact)
    assert listed(store) == on_disk(store)


@pytest.mark.parametrize("damage", ["empty", "cut", "altered", "odd", "folder"])
def test_a_broken_index_is_as_good_as_none(store: Store, damage: str) -> None:
    listed(store)
    content = index(store).read_bytes()
    if damage == "folder":
        index(store).unlink()
        index(store).mkdir()
    elif damage == "odd":
        write_index(store, content[65:-3])
    else:
        index(store).write_bytes({"empty": b"", "cut": content[:-16]}.get(damage, content[:-1] + b"\xff"))
    assert listed(store) == on_disk(store)
    assert index(store).is_dir() or index(store).read_bytes() == content


def test_an_index_that_is_a_link_is_neither_read_nor_written_through(store: Store, tmp_path: Path) -> None:
    listed(store)
    other = index(store).rename(tmp_path / "other")
    before = other.read_bytes()
    index(store).symlink_to(other)
    larger(store, KEYS[0])
    assert listed(store) == on_disk(store)
    assert other.read_bytes() == before
    assert not index(store).is_symlink()


def test_a_false_index_removes_nothing(store: Store) -> None:
    """It can have sizes only, of what is there by other evidence, and those count for nothing before a removal."""
    housekeeping.set_limit(store, 10**6)
    folder = store.root / "cache" / STAGE.name
    tokens = [result_sizes.token(path.name, path.stat().st_ino) for path in folder.iterdir()]
    sizes = [2**64 - 1] * len(tokens)
    write_index(store, array.array("Q", [*tokens, 7, *sizes, 7]).tobytes())
    assert max(listed(store).values()) == 2**64 - 1
    assert housekeeping.over(store, 10**6) == []
    assert housekeeping.keep_limit(store) == []
    assert housekeeping.prune(store, 1) == []
    assert listed(store).keys() == set(KEYS[:4])


def test_how_much_goes_under_a_limit_is_measured(store: Store) -> None:
    listed(store)
    for number, key in enumerate(KEYS[:4]):
        store.touch(store.location(STAGE.name, key), time.time_ns() - (100 - number) * 10**9)
    housekeeping.set_limit(store, housekeeping.total_size(store, measured=True) - 1)
    assert [entry.key for entry in housekeeping.keep_limit(store)] == [KEYS[0]]
    assert housekeeping.total_size(store, measured=True) == sum(
        path.stat().st_size for path in store.root.rglob("*") if path.is_file()
    )


def test_the_size_of_a_store_by_the_index_is_the_measured_one(store: Store) -> None:
    store.checkpoints(STAGE.name, KEYS[0]).save(1, Otsu(structure=np.ones((9, 9), bool), threshold=0.5))
    listed(store)
    assert housekeeping.total_size(store) == housekeeping.total_size(store, measured=True)


def test_a_store_that_cannot_be_written_is_listed(store: Store, monkeypatch: pytest.MonkeyPatch) -> None:
    def refused(*_: object) -> None:
        raise OSError(30, "Read-only file system")

    monkeypatch.setattr(folders.Folder, "write", refused)
    assert listed(store) == on_disk(store)
    assert not index(store).exists()


def test_nothing_is_written_to_the_store_of_another_user(
    store: Store, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("XDG_CONFIG_HOME", str(tmp_path / "other"))
    assert listed(store) == on_disk(store)
    assert not index(store).exists()


# -- processes


def list_until_killed(root: str, ready: multiprocessing.synchronize.Event) -> None:
    """List a store of which the index is never as old as the store, again and again."""
    result_sizes._FEW = -(10**6)
    ready.set()
    while True:
        listed(Store(Path(root)))


def listing(store: Store) -> multiprocessing.context.SpawnProcess:
    context = multiprocessing.get_context("spawn")
    ready = context.Event()
    process = context.Process(target=list_until_killed, args=(str(store.root), ready))
    process.start()
    assert ready.wait(60)
    return process


def test_processes_list_while_others_write_and_remove(store: Store) -> None:
    others = [listing(store) for _ in range(2)]
    try:
        for _ in range(5):
            for key in KEYS:
                finished(store, key)
                assert listed(store) == on_disk(store)
            for key in KEYS[::2]:
                store.remove(STAGE.name, key)
            assert listed(store) == on_disk(store)
    finally:
        for process in others:
            process.kill()
            process.join()
    assert listed(store) == on_disk(store)


def test_a_kill_in_the_middle_of_writing_loses_nothing(store: Store) -> None:
    listed(store)
    for _ in range(4):
        process = listing(store)
        time.sleep(0.1)
        os.kill(process.pid or 0, signal.SIGKILL)
        process.join()
        assert listed(store) == on_disk(store)
    housekeeping.tidy(store)
    assert [path.name for path in store.root.iterdir() if path.name.startswith(".new-")] == []


def test_threads_of_one_process_list_at_once(store: Store) -> None:
    found: list[dict[str, int]] = []
    threads = [threading.Thread(target=lambda: found.append(listed(store))) for _ in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert found == [on_disk(store)] * 4
