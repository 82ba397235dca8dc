"""What is listed and verified of a store, and what is removed from it while runs go on."""

from __future__ import annotations

import hashlib
import multiprocessing
import os
import time
from pathlib import Path

import filelock
import pytest

from tests.pipelines.store.results import KEY, STAGE, finished, result, write_record
from texloom.pipelines.store import housekeeping, run_log, usage, written
from texloom.pipelines.store.history import History
from texloom.pipelines.store.record import record_name
from texloom.pipelines.store.run_log import LoggedRun
from texloom.pipelines.store.store import Artifact, Store
from texloom.stages.analysis.structure.otsu import Otsu

OTHER = KEY[::-1]


@pytest.fixture
def store(tmp_path: Path) -> Store:
    made = Store(tmp_path / "artifacts")
    made.create()
    return made


def age(path: Path, days: float) -> None:
    """Make a file or folder, and all that is in it, look as if not used for so long."""
    then = time.time() - days * 86400
    for found in (path, *path.rglob("*")):
        os.utime(found, (then, then))


def aged(artifact: Artifact, days: float) -> Artifact:
    """A result that was last used so long ago."""
    Store(artifact.folder.parents[2]).touch(artifact, time.time_ns() - int(days * 86400e9))
    return artifact


def names(folder: Path) -> list[str]:
    return sorted(path.name for path in folder.iterdir())


def total(store: Store) -> int:
    return sum(path.stat().st_size for path in store.root.rglob("*") if path.is_file())


def exports(store: Store, name: str = "flow-1") -> Path:
    """Exports of a run without ``--out``."""
    folder = store.root / "runs" / name
    folder.mkdir(parents=True)
    (folder / "texture.png").write_bytes(bytes(1000))
    written.add(store.root, name, {"texture.png": hashlib.sha256(bytes(1000)).hexdigest()})
    return folder


# -- prune


def test_prune_removes_what_was_not_used(store: Store) -> None:
    old, new = aged(finished(store), 40), finished(store, OTHER)
    store.checkpoints(STAGE.name, old.key).save(1, result())
    assert [entry.key for entry in housekeeping.prune(store, 30, dry_run=True)] == [old.key]
    assert old.folder.exists()
    assert [entry.key for entry in housekeeping.prune(store, 30)] == [old.key]
    assert not old.folder.exists()
    assert names(store.locks) == [], "that of a removed result goes with it"
    assert store.find(STAGE.name, old.key) is None
    assert store.checkpoints(STAGE.name, old.key).latest(Otsu) is None
    assert store.find(STAGE.name, new.key) is not None
    assert housekeeping.prune(store, 30) == []


def test_use_keeps_a_result_from_pruning(store: Store) -> None:
    artifact = aged(finished(store), 40)
    store.touch(artifact, time.time_ns())
    assert housekeeping.prune(store, 30) == []
    assert store.find(STAGE.name, KEY) is not None


def test_a_run_does_not_set_back_when_a_later_one_used_a_result(store: Store) -> None:
    artifact = finished(store)
    history = History(store, "flow")
    store.touch(artifact, history.now + 10**10)
    history.add("step", {}, artifact, is_new=False)
    assert store.used(artifact) > time.time()
    store.touch(artifact, history.now - 10**10)
    history.add("step", {}, artifact, is_new=False)
    assert store.used(artifact) == pytest.approx(history.now / 1e9)


def test_prune_leaves_alone_what_is_at_work(store: Store) -> None:
    artifact = aged(finished(store), 40)
    with filelock.FileLock(store.locks / f"{record_name(STAGE.name, KEY)}.lock"):
        assert housekeeping.prune(store, 30) == []
    assert artifact.folder.exists()


def test_prune_leaves_alone_what_is_being_written(store: Store) -> None:
    """A result or checkpoint whose writer holds the lock of its key, as old as it may be."""
    paths = [
        store.root / "cache" / STAGE.name / f".new-{KEY}-00000000",
        store.root / "checkpoints" / STAGE.name / KEY / ".new-01-00000000",
    ]
    for path in paths:
        path.mkdir(parents=True)
        age(path.parent, 40)
    with filelock.FileLock(store.locks / f"{record_name(STAGE.name, KEY)}.lock"):
        housekeeping.prune(store, 0)
        assert all(path.is_dir() for path in paths)
    housekeeping.prune(store, 0)
    assert not any(path.exists() for path in paths)


def test_prune_removes_what_nothing_needs(store: Store) -> None:
    finished(store)
    write_record(store, store.location(STAGE.name, OTHER))
    for name in (KEY, OTHER):
        (store.locks / f"{record_name(STAGE.name, name)}.lock").touch()
    (store.locks / "identity.lock").touch()
    history = History(store, "flow")
    history.add("step", {"stage": STAGE.name}, store.location(STAGE.name, KEY), is_new=True)
    history.save()
    run_log.write(store.root, LoggedRun("flow", {}, (1,), {"edges": OTHER}))
    run_log.write(store.root, LoggedRun("flow", {}, (1,), {"edges": KEY}))
    folder = exports(store)
    for place in (store.records, store.locks, folder, store.root / "history", store.root / "log"):
        age(place, 40)
    store.touch(store.location(STAGE.name, KEY), time.time_ns())
    removed = housekeeping.prune(store, 30)
    assert [entry.folder for entry in removed] == [folder]
    assert names(store.records) == [record_name(STAGE.name, KEY)]
    assert names(store.locks) == [f"{record_name(STAGE.name, KEY)}.lock", "identity.lock"]
    assert names(store.root / "history") == names(store.root / "runs") == []
    assert [run.steps for run in run_log.read(store.root)] == [{"edges": KEY}]


def test_a_lock_that_is_held_stays(store: Store) -> None:
    path = store.locks / f"{record_name(STAGE.name, KEY)}.lock"
    with filelock.FileLock(path):
        age(path, 40)
        housekeeping.prune(store, 30)
        assert path.exists()
    housekeeping.prune(store, 30)
    assert not path.exists()


def test_the_lock_that_removals_take_is_the_one_that_runs_wait_for(store: Store) -> None:
    lock = store.lock(record_name(STAGE.name, KEY), timeout=0)
    with store.try_lock(STAGE.name, KEY) as is_locked:
        assert is_locked
        with pytest.raises(filelock.Timeout):
            lock.acquire()
    with lock, store.try_lock(STAGE.name, KEY) as is_locked:
        assert not is_locked
    with lock:
        pass


def test_a_link_in_place_of_a_lock_is_not_followed(store: Store, tmp_path: Path) -> None:
    (store.locks / f"{record_name(STAGE.name, KEY)}.lock").symlink_to(tmp_path / "other")
    with store.try_lock(STAGE.name, KEY) as is_locked:
        assert not is_locked
    assert not (tmp_path / "other").exists()


# -- runs that are going on


def hold(root: str, ready: multiprocessing.synchronize.Event, wait: bool) -> None:
    """A run that has begun and goes on until it is killed, or ends at once without giving anything back."""
    store = Store(Path(root))
    with store.used_by_run():
        store.create()
        ready.set()
        if wait:
            time.sleep(600)
        os._exit(9)


def other_run(store: Store, wait: bool) -> multiprocessing.context.SpawnProcess:
    """Another process in which a run has begun."""
    context = multiprocessing.get_context("spawn")
    ready = context.Event()
    process = context.Process(target=hold, args=(str(store.root), ready, wait))
    process.start()
    assert ready.wait(60)
    return process


def test_what_a_run_uses_is_kept_until_it_ends(store: Store) -> None:
    before = aged(finished(store), 1)
    process = other_run(store, wait=True)
    try:
        used, folder = finished(store, OTHER), exports(store)
        housekeeping.set_limit(store, 0)
        assert [entry.key for entry in housekeeping.prune(store, 0)] == [before.key]
        assert housekeeping.keep_limit(store) == []
        assert used.folder.exists()
        assert folder.exists()
    finally:
        process.kill()
        process.join()
    assert {entry.folder for entry in housekeeping.prune(store, 0)} == {used.folder, folder}
    assert names(store.running) == []


def test_a_run_that_was_killed_keeps_nothing(store: Store) -> None:
    other_run(store, wait=False).join()
    assert len(names(store.running)) == 1
    artifact = finished(store)
    assert [entry.key for entry in housekeeping.prune(store, 0)] == [artifact.key]


def test_a_run_that_writes_nothing_leaves_no_trace(store: Store) -> None:
    with store.used_by_run() as lease:
        assert not lease.is_taken
    assert not store.running.exists()
    with store.used_by_run():
        store.create()
        assert len(names(store.running)) == 1
    assert names(store.running) == []


# -- the limit


def test_the_least_recently_used_goes_first(store: Store) -> None:
    keys = [f"{number:064x}" for number in range(4)]
    for number, key in enumerate(keys):
        aged(finished(store, key), 10 - number)
    folder = exports(store)
    age(folder, 9.5)
    housekeeping.set_limit(store, total(store) - 1)
    assert [entry.key for entry in housekeeping.keep_limit(store)] == [keys[0]]
    housekeeping.set_limit(store, total(store) - 1500)
    removed = housekeeping.keep_limit(store)
    assert [entry.folder for entry in removed] == [folder, store.folder(STAGE.name, keys[1])]
    assert store.find(STAGE.name, keys[2]) is not None


def test_a_run_measures_the_store_only_where_the_total_exceeds_the_limit(
    store: Store, monkeypatch: pytest.MonkeyPatch
) -> None:
    keys = [f"{number:064x}" for number in range(20)]
    for number, key in enumerate(keys[:10]):
        aged(finished(store, key), 100 - number)
    housekeeping.set_limit(store, total(store) + 8000)
    assert housekeeping.keep_limit(store, measure=False) == []
    with monkeypatch.context() as patched:
        patched.setattr(housekeeping, "entries", None)  # not called
        finished(store, keys[10])
        assert housekeeping.keep_limit(store, measure=False) == []
    known = usage.total(store)
    assert known is not None
    assert total(store) <= known <= total(store) + 5000
    for key in keys[11:]:
        finished(store, key)
    removed = [entry.key for entry in housekeeping.keep_limit(store, measure=False)]
    assert removed == keys[: len(removed)] != []
    assert total(store) <= 0.95 * (housekeeping.limit(store) or 0)
    (store.root / "size.json").write_text('{"bytes":')
    assert usage.total(store) is None


def test_without_a_limit_nothing_goes(store: Store) -> None:
    aged(finished(store), 1000)
    assert housekeeping.keep_limit(store) == []
    housekeeping.set_limit(store, 0)
    housekeeping.set_limit(store, None)
    assert housekeeping.keep_limit(store) == []


@pytest.mark.parametrize("content", ["", "[]", "{}", '{"limit": "20GB"}', '{"limit": true}', '{"limit": -1}'])
def test_altered_settings_are_no_limit(store: Store, content: str) -> None:
    aged(finished(store), 1000)
    (store.root / "settings.json").write_text(content)
    assert housekeeping.limit(store) is None
    assert housekeeping.keep_limit(store) == []


# -- verify


def test_verify_leaves_out_what_is_being_computed(store: Store) -> None:
    """Its files are there before its record."""
    artifact = store.save(STAGE, KEY, result(), {})
    with filelock.FileLock(store.locks / f"{record_name(STAGE.name, KEY)}.lock"):
        assert list(housekeeping.verify(store)) == []
    assert [problem for _, problem in housekeeping.verify(store)] == ["it has no record"]
    write_record(store, artifact)
    assert [problem for _, problem in housekeeping.verify(store)] == [None]


# -- the log


def test_a_run_that_is_repeated_is_logged_once(store: Store) -> None:
    first, second = LoggedRun("a", {"x": "y.png"}, (1,), {"edges": KEY}), LoggedRun("b", {}, (2,), {"edges": KEY})
    for run in (first, second):
        run_log.write(store.root, run)
    for number, path in enumerate(sorted((store.root / "log").iterdir())):
        os.utime(path, (number, number))
    last = run_log.read(store.root)[-1]
    run_log.write(store.root, first if last.flow == "a" else second)
    assert [run.flow for run in run_log.read(store.root)] == [last.flow, "b" if last.flow == "a" else "a"]


@pytest.mark.parametrize(
    "content",
    ["", "[]", "{}", "[" * 100_000, '{"flow": 1, "sources": {}, "seeds": [], "steps": {}}',
     '{"flow": "a", "sources": {}, "seeds": 3, "steps": {}}',
     '{"flow": "a", "sources": [], "seeds": [], "steps": {}}',
     '{"flow": "a", "sources": {}, "seeds": [], "steps": {"x": ["y"]}}'],
)  # fmt: skip
def test_an_altered_log_is_left_out(store: Store, content: str) -> None:
    run_log.write(store.root, LoggedRun("flow", {}, (1,), {"edges": KEY}))
    (path,) = (store.root / "log").iterdir()
    path.write_text(content)
    assert run_log.read(store.root) == []
    housekeeping.prune(store, 30)
    assert names(store.root / "log") == []
