"""A folder is a store only by texloom's own marker, and only what texloom wrote is removed from it."""

from __future__ import annotations

import hashlib
import json
import os
import shutil
import signal
import stat
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from tests.pipelines.store.results import KEY, STAGE, finished, result
from texloom.pipelines.media.array_sources import file_source
from texloom.pipelines.store import folders, housekeeping, ownership, usage, written
from texloom.pipelines.store.history import History
from texloom.pipelines.store.record import record_name
from texloom.pipelines.store.store import Store
from texloom.stages.vocabulary.declare import InputError


@pytest.fixture(autouse=True)
def config(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The configuration folder of a new user."""
    monkeypatch.setenv("XDG_CONFIG_HOME", str(tmp_path / "config"))
    return tmp_path / "config"


@pytest.fixture
def store(tmp_path: Path) -> Store:
    made = Store(tmp_path / "store")
    made.create()
    return made


@pytest.fixture
def user(tmp_path: Path) -> Path:
    """A folder with a file of the user."""
    folder = tmp_path / "user"
    folder.mkdir()
    (folder / "thesis.txt").write_text("mine")
    os.utime(folder / "thesis.txt", (0, 0))
    os.utime(folder, (0, 0))
    return folder


def as_other_user(monkeypatch: pytest.MonkeyPatch, folder: Path) -> None:
    monkeypatch.setenv("XDG_CONFIG_HOME", str(folder))


# -- the marker


def test_a_store_is_marked_by_its_first_write(store: Store, config: Path) -> None:
    key = config / "texloom" / "store.key"
    assert stat.S_IMODE(key.stat().st_mode) == 0o600
    (marker,) = (store.root / "markers").iterdir()
    assert json.loads(marker.read_text()).keys() == {"identity", "hmac"}
    assert bytes.fromhex(key.read_text()) not in b"".join(path.read_bytes() for path in store.root.rglob("*.key"))
    assert ownership.marked(store.root) == store.identity() == (store.root / "identity").read_text()
    Store(store.root).check_owned()


def test_a_marker_of_another_key_counts_for_nothing(store: Store, config: Path) -> None:
    """Whoever makes a folder can write a marker, but not with the user's key."""
    (marker,) = (store.root / "markers").iterdir()
    forged = json.loads(marker.read_text())
    marker.write_text(json.dumps({**forged, "identity": "0" * 32}))
    assert ownership.marked(store.root) is None
    for content in ("", "[]", "{}", '{"identity": 3, "hmac": 4}', '{"identity": "é", "hmac": "é"}'):
        marker.write_text(content)
        with pytest.raises(InputError, match="store adopt"):
            Store(store.root).check_owned()


def test_a_folder_of_other_content_is_no_store(user: Path) -> None:
    store = Store(user)
    for refused in (store.check_owned, store.create, lambda: store.ready("runs")):
        with pytest.raises(InputError, match="holds files and is no store"):
            refused()
    assert [path.name for path in user.iterdir()] == ["thesis.txt"]


def test_the_readme_of_the_repository_is_no_other_content(tmp_path: Path) -> None:
    shutil.copy(Path(__file__).parents[3] / "artifacts" / "README.md", tmp_path)
    Store(tmp_path / "new").check_owned()
    (tmp_path / "some").mkdir()
    (tmp_path / "README.md").rename(tmp_path / "some" / "README.md")
    Store(tmp_path / "some").create()
    (tmp_path / "theirs").mkdir()
    (tmp_path / "theirs" / "README.md").write_text("# My project")
    with pytest.raises(InputError, match="holds files"):
        Store(tmp_path / "theirs").create()


def test_another_user_adopts_a_store(store: Store, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    as_other_user(monkeypatch, tmp_path / "other")
    with pytest.raises(InputError, match="another user or machine made it; `texloom store adopt --store /"):
        store.check_owned()
    store.adopt()
    store.check_owned()
    assert len(list((store.root / "markers").iterdir())) == 2
    as_other_user(monkeypatch, tmp_path / "config")
    Store(store.root).check_owned()


KILLED = """
import os, signal, sys
from pathlib import Path
from texloom.pipelines.store import folders
from texloom.pipelines.store.store import Store

calls, last = 0, int(sys.argv[2])
def counted(function):
    def call(*arguments, **options):
        global calls
        calls += 1
        if calls == last:
            os.kill(os.getpid(), signal.SIGKILL)
        return function(*arguments, **options)
    return call

for name in ("open", "mkdir", "link", "replace", "unlink", "makedirs"):
    setattr(os, name, counted(getattr(os, name)))
Store(Path(sys.argv[1])).create()
"""


def test_a_kill_while_a_store_is_marked_leaves_one_that_can_be_used(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Whichever call was the last one."""
    for last in (5, 9, 12, 16, 20, 24):
        root = tmp_path / str(last)
        monkeypatch.setenv("XDG_CONFIG_HOME", str(tmp_path / f"config-{last}"))
        done = subprocess.run([sys.executable, "-c", KILLED, str(root), str(last)], check=False)
        assert done.returncode == -signal.SIGKILL
        Store(root).create()
        assert ownership.marked(root) is not None


def test_the_root_itself_may_be_a_link(tmp_path: Path) -> None:
    (tmp_path / "disk").mkdir()
    (tmp_path / "store").symlink_to(tmp_path / "disk")
    finished_in = Store(tmp_path / "store")
    finished_in.create()
    finished(finished_in)
    assert (tmp_path / "disk" / "cache").is_dir()


# -- without a key


@pytest.fixture
def no_key(config: Path) -> str:
    """A user of whom no key can be kept."""
    config.write_text("no folder")
    return str(config)


def test_without_a_key_runs_use_a_store_and_nothing_is_removed(no_key: str, tmp_path: Path) -> None:
    store = Store(tmp_path / "store")
    store.create()
    artifact = finished(store)
    again = Store(store.root)
    again.check_owned()
    again.create()
    assert again.find(STAGE.name, KEY) is not None
    assert no_key in str(ownership.keeps_no_key())
    housekeeping.set_limit(again, 0)
    assert housekeeping.keep_limit(again) == []
    assert "does not apply" in str(housekeeping.foreign_limit(again))
    with pytest.raises(InputError, match="no key can be kept"):
        housekeeping.prune(again, 0)
    assert artifact.folder.exists()


def test_without_a_key_other_folders_are_no_stores_either(no_key: str, user: Path) -> None:
    with pytest.raises(InputError, match="holds files and is no store"):
        Store(user).check_owned()


# -- limits


def test_a_limit_of_somebody_else_does_not_apply(
    store: Store, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    artifact = finished(store)
    housekeeping.set_limit(store, 1)
    assert (housekeeping.limit(store), housekeeping.foreign_limit(store)) == (1, None)
    ours = json.loads((store.root / "settings.json").read_text())
    (store.root / "settings.json").write_text(json.dumps({**ours, "limit": 2}))
    for _ in range(2):
        assert housekeeping.limit(store) is None
        assert "not set by this user and does not apply" in str(housekeeping.foreign_limit(store))
        assert housekeeping.keep_limit(store) == []
        as_other_user(monkeypatch, tmp_path / "other")
        (store.root / "settings.json").write_text(json.dumps(ours))
        store.adopt()
    assert artifact.folder.exists()


# -- links


LINKED = ("records", "locks", "history", "log", "running", "exports", "runs", "sources", "cache", "checkpoints")


@pytest.mark.parametrize("name", [*LINKED, "written", "markers"])
def test_a_folder_that_is_a_link_is_refused(store: Store, user: Path, name: str) -> None:
    shutil.rmtree(store.root / name, ignore_errors=True)
    (store.root / name).symlink_to(user)
    with pytest.raises(InputError, match=f"store/{name} is a link"):
        store.check_owned()


@pytest.mark.parametrize("name", LINKED)
def test_links_are_not_followed_by_what_writes_and_removes(store: Store, user: Path, name: str) -> None:
    """Also where they were put there after the check."""
    finished(store)
    housekeeping.set_limit(store, 0)
    shutil.rmtree(store.root / name, ignore_errors=True)
    for stem in (record_name(STAGE.name, KEY), KEY, f"{KEY}.png", "0" * 32 + ".json", STAGE.name):
        (user / stem).write_text("mine")
    (user / f"{record_name(STAGE.name, KEY)}.lock").write_text("mine")
    before = {path: path.read_bytes() for path in user.iterdir()}
    times = {path: path.stat().st_mtime_ns for path in user.iterdir()}
    (store.root / name).symlink_to(user)
    history = History(store, "thesis.txt")
    history.used["a"] = KEY
    actions = [
        lambda: store.write_record(record_name(STAGE.name, KEY), b"{}"),
        lambda: store.save(STAGE, KEY, result(), {}),
        lambda: store.checkpoints(STAGE.name, KEY).save(1, result()),
        lambda: store.lock(record_name(STAGE.name, KEY)).acquire(),
        lambda: store.forget(STAGE.name, KEY),
        lambda: store.drop_checkpoints(STAGE.name, KEY),
        lambda: history.save({"a": 1}),
        lambda: housekeeping.prune(store, 0),
        lambda: housekeeping.keep_limit(store),
    ]
    problems = []
    for action in actions:
        try:
            action()
        except OSError as error:
            problems.append(str(error))
    assert [problem for problem in problems if "is a link" not in problem] == []
    assert {path: path.read_bytes() for path in user.iterdir()} == before
    assert {path: path.stat().st_mtime_ns for path in user.iterdir()} == times


@pytest.mark.parametrize("name", ["settings.json", "size.json"])
def test_files_replace_links_and_write_through_none(store: Store, user: Path, name: str) -> None:
    (store.root / name).symlink_to(user / "thesis.txt")
    housekeeping.set_limit(store, 10**9)
    usage.measured(store, 3)
    assert (user / "thesis.txt").read_text() == "mine"


def test_a_record_is_not_written_through_a_link(store: Store, user: Path) -> None:
    name = record_name(STAGE.name, KEY)
    (store.records / f".new-{name}").symlink_to(user / "thesis.txt")
    (store.records / name).symlink_to(user / "thesis.txt")
    store.write_record(name, b"{}")
    assert (user / "thesis.txt").read_text() == "mine"
    assert (store.records / name).read_bytes() == b"{}"


def test_without_descriptors_of_folders_links_are_refused_too(
    store: Store, user: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """As on Windows."""
    monkeypatch.setattr(folders, "_HAS_HANDLES", False)
    finished(store)
    assert [entry.key for entry in housekeeping.prune(store, 0)] == [KEY]
    shutil.rmtree(store.records)
    store.records.symlink_to(user)
    with pytest.raises(OSError, match="link"):
        store.write_record("a", b"")


# -- what is removed


def old(path: Path) -> Path:
    for one in (path, *path.rglob("*")):
        os.utime(one, (1, 1), follow_symlinks=False)
    return path


def test_folders_of_the_user_beside_those_of_runs_stay(store: Store) -> None:
    """As in a project whose ``artifacts`` had been one before."""
    mine = [store.root / "runs" / "experiment1" / "a.txt", store.root / "sources" / "data.csv"]
    mine += [store.root / "cache" / STAGE.name / "notes.txt", store.root / "records" / "notes.txt"]
    mine += [store.root / "log" / "a.json", store.root / "locks" / "a.lock", store.root / "exports" / "a.txt"]
    mine += [store.root / "checkpoints" / "a" / "b.txt", store.root / "sources" / KEY / "a.png"]
    for path in mine:
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text("mine")
    old(store.root)
    housekeeping.prune(store, 0)
    housekeeping.set_limit(store, 0)
    housekeeping.keep_limit(store)
    assert [path for path in mine if not path.exists()] == []


def test_exports_that_were_changed_stay_and_others_go(store: Store) -> None:
    folder = store.root / "runs" / "flow-1"
    (folder / "maps").mkdir(parents=True)
    for name in ("a.png", "b.png", "maps/c.png"):
        (folder / name).write_text(name)
    files = {name: hashlib.sha256(name.encode()).hexdigest() for name in ("a.png", "b.png", "maps/c.png")}
    written.add(store.root, "flow-1", files)
    (folder / "a.png").write_text("edited")
    (folder / "maps" / "mine.txt").write_text("mine")
    old(store.root)
    housekeeping.prune(store, 0)
    left = {str(path.relative_to(folder)) for path in folder.rglob("*")}
    assert left == {"a.png", "maps", "maps/mine.txt"}
    assert housekeeping.other_entries(store) == []


def test_a_note_of_files_elsewhere_removes_nothing(store: Store, user: Path) -> None:
    digest = hashlib.sha256(b"mine").hexdigest()
    names = [
        "../../../user/thesis.txt",
        str(user / "thesis.txt"),
        "link/thesis.txt",
        "x/../../../../user/thesis.txt",
    ]
    (store.root / "runs" / "flow-1").mkdir(parents=True)
    (store.root / "runs" / "flow-1" / "link").symlink_to(user)
    written.add(store.root, "flow-1", dict.fromkeys(names, digest))
    old(store.root)
    housekeeping.prune(store, 0)
    assert (user / "thesis.txt").read_text() == "mine"


def test_arrays_go_if_they_hold_what_was_written(store: Store) -> None:
    folder = store.ready("sources")
    kept, gone = (Path(file_source(np.full((9, 9), level, np.uint8), folder)) for level in (1, 2))
    maps = Path(file_source({"albedo": np.zeros((9, 9, 3), np.uint8), "height": np.zeros((9, 9))}, folder))
    content = b"dropped"
    own = folder / hashlib.sha256(f"a.png:{hashlib.sha256(content).hexdigest()};".encode()).hexdigest()[:16]
    own.mkdir()
    (own / "a.png").write_bytes(content)
    kept.write_bytes(b"edited")
    old(store.root)
    assert {entry.folder for entry in housekeeping.prune(store, 0)} == {gone, maps.parent, own}
    assert list(folder.iterdir()) == [kept]


def test_a_file_of_the_user_in_a_result_stays(store: Store) -> None:
    artifact = finished(store)
    (artifact.folder / "notes.csv").write_text("mine")
    store.touch(artifact, 1)
    housekeeping.prune(store, 30)
    assert [path.name for path in artifact.folder.iterdir()] == ["notes.csv"]
    with pytest.raises(OSError, match="holds files that texloom did not write"):
        store.save(STAGE, KEY, result(), {})
    assert [path.name for path in artifact.folder.parent.iterdir()] == [KEY]


def test_a_result_whose_manifest_is_lost_goes_by_its_record(store: Store) -> None:
    artifact = finished(store)
    (artifact.folder / "manifest.json").write_text("{")
    store.touch(artifact, 1)
    assert [entry.key for entry in housekeeping.prune(store, 30)] == [KEY]


def test_an_empty_folder_of_a_run_goes(store: Store) -> None:
    for name in ("flow-20260101-120000", "flow-20260101-120000-2", "experiment"):
        (store.root / "runs" / name).mkdir(parents=True)
    old(store.root)
    housekeeping.prune(store, 0)
    assert [path.name for path in (store.root / "runs").iterdir()] == ["experiment"]


def test_a_store_in_the_own_cache_folder_needs_no_adoption(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    store = Store(tmp_path / "cache" / "texloom" / "store")
    store.create()
    as_other_user(monkeypatch, tmp_path / "new config")
    store.check_owned()
    Store(store.root).create()
    assert ownership.marked(store.root) is not None
    (tmp_path / "cache" / "texloom").chmod(0o777)
    as_other_user(monkeypatch, tmp_path / "newer config")
    with pytest.raises(InputError, match="another user or machine made it"):
        store.check_owned()
