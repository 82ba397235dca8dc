"""What runs do with their store: what they leave in it, and what they need to be able to write."""

from __future__ import annotations

import errno
import io
import json
import os
import random
import shutil
import signal
import subprocess
import sys
import time
from collections import Counter
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import PIL.Image
import pytest

from tests.pipelines.flows import (
    SYNTHESIS,
    environment,
    files,
    open_run,
    run_local,
    start_run,
    write_flow,
    write_set,
)
from texloom.pipelines.engine.preflight import Preflight
from texloom.pipelines.engine.scheduler import execute
from texloom.pipelines.store import housekeeping, run_log
from texloom.pipelines.store.atomic import file_digest
from texloom.pipelines.store.store import Store
from texloom.stages.vocabulary.declare import InputError


@pytest.fixture
def flow(tmp_path: Path) -> Path:
    return write_flow(tmp_path / "project")


def run(flow: Path, out: str = "out", **params: str) -> dict[str, str]:
    """Step to its state."""
    opened = open_run(flow, **params)
    Preflight(opened).check(flow.parent / out)
    return run_local(opened, flow.parent / out).states


def store_of(flow: Path) -> Store:
    return Store(flow.parent / "artifacts")


def age(store: Store, days: float) -> None:
    """Make all results look as if not used for so long."""
    for entry in housekeeping.entries(store):
        then = time.time_ns() - int(days * 86400e9)
        store.touch(store.location(str(entry.stage), str(entry.key)), then)


def test_checkpoints_end_with_their_result(tmp_path: Path) -> None:
    flow = write_flow(tmp_path, SYNTHESIS)
    assert run(flow, texture__preset="fast", start__size="48")["texture"] == "ran"
    assert list((tmp_path / "artifacts" / "checkpoints").rglob("*.exr")) == []
    assert list((tmp_path / "artifacts" / "checkpoints").glob("*/*")) == []


def test_a_run_is_logged_with_its_results(flow: Path) -> None:
    run(flow)
    for _ in range(2):
        run(flow, structure__min_extent="0.3")
    last, first = run_log.read(store_of(flow).root)
    assert list(last.steps) == list(first.steps) == ["edges", "structure", "distance"]
    assert last.steps["edges"] == first.steps["edges"]
    assert last.flow == "small"
    assert last.sources == {"exemplar": str(flow.parent / "exemplar.png")}


def test_what_a_run_left_that_was_killed_at_its_end_goes_with_the_next_one(flow: Path) -> None:
    """It has computed all, so that the next one computes nothing."""
    run(flow)
    root = store_of(flow).root
    left = [root / "history" / ".new-01234567-small", root / "log" / ".new-01234567-entry.json"]
    for path in left:
        path.touch()
    assert set(run(flow).values()) == {"cached"}
    assert not any(path.exists() for path in left)


def test_the_limit_is_obeyed_at_the_end_of_a_run(flow: Path) -> None:
    run(flow)
    store = store_of(flow)
    before = {entry.key for entry in housekeeping.entries(store)}
    age(store, 1)
    housekeeping.set_limit(store, 1)
    run(flow, edges__finest="2")
    left = {entry.key for entry in housekeeping.entries(store)}
    assert len(left) == 3, "what the last run used is kept"
    assert len(left & before) == 2, "equal edges keep the later steps cached"
    assert set(run(flow, edges__finest="2").values()) == {"cached"}


@pytest.mark.parametrize("days", [0.0, 30.0])
def test_pruning_beside_a_run_harms_nothing(flow: Path, days: float, monkeypatch: pytest.MonkeyPatch) -> None:
    """Not even when it comes between the writing of a result and its record."""
    save = Store.save

    def save_and_prune(store: Store, *arguments: Any) -> Any:
        housekeeping.prune(Store(store.root), days)
        artifact = save(store, *arguments)
        housekeeping.prune(Store(store.root), days)
        return artifact

    monkeypatch.setattr(Store, "save", save_and_prune)
    assert set(run(flow).values()) == {"ran"}
    monkeypatch.undo()
    assert set(run(flow).values()) == {"cached"}


KILLED_EXPORT = """
import os, signal, sys
from pathlib import Path
from tests.pipelines.flows import open_run, run_local
from texloom.pipelines.store import codec
codec.file_digest = lambda _: os.kill(os.getpid(), signal.SIGKILL)
flow = Path(sys.argv[1])
run_local(open_run(flow), flow.parent / "out")
"""


def test_what_a_killed_export_left_goes_with_the_next_run(flow: Path) -> None:
    run(flow, "other")
    store = store_of(flow)
    killed = subprocess.run(
        [sys.executable, "-c", KILLED_EXPORT, str(flow)], check=False, env=environment(flow.parent)
    )
    assert killed.returncode == -signal.SIGKILL
    (left,) = flow.parent.glob("out/.new-*")
    for folder in (store.exports, store.root / "history", store.root):
        (folder / ".new-01234567-note").touch()
    run(flow, edges__finest="3")
    assert not left.exists()
    assert not list(store.root.rglob(".new-*"))
    assert sorted(files(flow.parent / "out")) == ["distance.exr", "structure.png"]


@pytest.fixture
def read_only(monkeypatch: pytest.MonkeyPatch) -> Callable[[Path], None]:
    """Make a folder one that can only be read, also for a user who may do anything."""

    def protect(folder: Path) -> None:
        def refusing(function: Callable[..., Any], writes: Callable[..., bool]) -> Callable[..., Any]:
            def call(path: Any, *arguments: Any, **options: Any) -> Any:
                handle = options.get("dir_fd", options.get("src_dir_fd"))
                place = path if handle is None else f"/proc/self/fd/{handle}/{path}"
                inside = isinstance(place, str | os.PathLike) and Path(place).resolve().is_relative_to(folder)
                if inside and writes(*arguments, **options):
                    raise OSError(errno.EROFS, os.strerror(errno.EROFS), str(path))
                return function(path, *arguments, **options)

            return call

        access = os.access
        monkeypatch.setattr(
            os, "access", lambda path, mode: access(path, mode) and not Path(path).is_relative_to(folder)
        )
        for name in ("mkdir", "unlink", "rename", "replace", "utime"):
            monkeypatch.setattr(os, name, refusing(getattr(os, name), lambda *_, **__: True))
        creating = os.O_CREAT | os.O_RDWR | os.O_WRONLY
        monkeypatch.setattr(os, "open", refusing(os.open, lambda flags, *_, **__: bool(flags & creating)))
        monkeypatch.setattr(io, "open", refusing(io.open, lambda mode="r", *_, **__: mode not in ("r", "rb")))

    return protect


def test_a_run_that_is_cached_needs_no_writable_store(flow: Path, read_only: Callable[[Path], None]) -> None:
    run(flow)
    run(flow, structure__min_extent="0.3")
    before = files(flow.parent / "artifacts")
    read_only(flow.parent / "artifacts")
    assert set(run(flow, "new").values()) == {"cached"}, "with another history than that of the last run"
    assert files(flow.parent / "new").keys() == {"structure.png", "distance.exr"}
    with pytest.raises(InputError, match="cannot be written"):
        run(flow, "new", edges__finest="3")
    opened = open_run(flow)
    with pytest.raises(InputError, match=r"--out .* cannot be written"):
        Preflight(opened).check(opened.new_out())
    assert files(flow.parent / "artifacts") == before
    assert [problem for _, problem in housekeeping.verify(store_of(flow))] == [None] * 5


def test_exports_of_a_run_are_safe_from_others(flow: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Also if nothing is computed."""
    run(flow)
    opened = open_run(flow)
    out = opened.new_out()
    from texloom.pipelines.engine.exports import Export

    write = Export.write

    def prune_and_write(export: Export, *arguments: Any) -> None:
        housekeeping.prune(store_of(flow), 0)
        write(export, *arguments)

    monkeypatch.setattr(Export, "write", prune_and_write)
    execute(opened, lambda _: None, out)
    assert files(opened.out_folder(out)).keys() == {"structure.png", "distance.exr"}


WRONG = [None, -1, "x", [], {}, {"a": {}}, ["a"], "\ud800"]


@pytest.fixture
def mounts(tmp_path: Path) -> Iterator[tuple[Path, Path]]:
    """A folder under two paths: a second mount where that is permitted, else a link."""
    first, second = tmp_path / "first", tmp_path / "second"
    first.mkdir()
    second.mkdir()
    mount, unmount = shutil.which("mount"), shutil.which("umount")
    bound = [mount, "--bind", str(first), str(second)] if mount and unmount else ["false"]
    is_mount = subprocess.run(bound, check=False, capture_output=True).returncode == 0
    if not is_mount:
        second.rmdir()
        second.symlink_to(first)
    yield first, second
    if is_mount:
        subprocess.run([str(unmount), str(second)], check=True)


@pytest.mark.skipif(sys.platform == "win32", reason="no mounts")
def test_four_processes_share_a_store_that_two_of_them_see_elsewhere(
    tmp_path: Path, mounts: tuple[Path, Path]
) -> None:
    path = write_set(tmp_path / "project")
    options = [("--store", mount, "--out", f"out{number}{mount.name}") for number in (1, 2) for mount in mounts]
    processes = [start_run(path, *given) for given in options]
    reports = []
    for process in processes:
        said, problems = process.communicate(timeout=300)
        assert process.returncode == 0, problems
        reports.append(json.loads(said))
    ran = Counter(step["key"] for report in reports for step in report["steps"] if step["state"] == "ran")
    assert len(ran) == len(housekeeping.entries(Store(mounts[0])))
    assert set(ran.values()) == {1}, "each is computed once, whatever the path"
    assert len({tuple(sorted(files(path.parent / given[-1]).items())) for given in options}) == 1
    for mount in mounts:
        assert all(problem is None for _, problem in housekeeping.verify(Store(mount)))


def altered(document: Any, rng: random.Random) -> Any:
    """JSON with one value, anywhere in it, replaced or left out."""
    places: list[tuple[Any, Any]] = []

    def visit(value: Any) -> None:
        entries = value.items() if isinstance(value, dict) else enumerate(value) if isinstance(value, list) else ()
        for name, entry in entries:
            places.append((value, name))
            visit(entry)

    visit(document)
    if not places or rng.random() < 0.1:
        return rng.choice(WRONG)
    where, name = rng.choice(places)
    if rng.random() < 0.2:
        del where[name]
    else:
        where[name] = rng.choice(WRONG)
    return document


def alter_store(store: Store, rng: random.Random) -> str:
    """Alter some JSON of a store, and the digest that a record has of it; what it was."""
    paths = [path for path in sorted(store.root.rglob("*")) if path.is_file()]
    path = rng.choice([path for path in paths if path.suffix == ".json" or path.parent == store.records])
    document = json.loads(path.read_text())
    if path.parent == store.records and rng.random() < 0.7:
        document["result"] = json.dumps(altered(json.loads(document["result"]), rng))
    else:
        document = altered(document, rng)
    path.write_text(json.dumps(document))
    if path.name == "manifest.json" and rng.random() < 0.7:
        (record,) = store.records.glob(f"*-{path.parent.name}")
        outer = json.loads(record.read_text())
        inner = json.loads(outer["result"]) | {"manifest": file_digest(path)}
        if isinstance(document, dict) and rng.random() < 0.5:
            inner["outputs"] = document.get("outputs")
        record.write_text(json.dumps(outer | {"result": json.dumps(inner)}))
    return f"{path.relative_to(store.root)}: {path.read_text()}"


def test_altered_json_is_found_and_computed_again(flow: Path) -> None:
    run(flow)
    whole, out = flow.parent / "artifacts", flow.parent / "out"
    housekeeping.set_limit(store_of(flow), 10**9)
    pictures = [path.name for path in out.glob("*.png")]
    expected = {name: (out / name).read_bytes() for name in pictures}
    shutil.move(whole, flow.parent / "whole")
    for seed in range(40):
        shutil.copytree(flow.parent / "whole", whole)
        shutil.rmtree(out)
        what = alter_store(store_of(flow), random.Random(seed))
        try:
            for extent in ("0.015", "0.3"):
                open_run(flow, structure__min_extent=extent).plan()
            store = store_of(flow)
            list(housekeeping.verify(store))
            run_log.read(store.root)
            run(flow)
            housekeeping.keep_limit(store)
            housekeeping.prune(store, 30)
        except Exception as error:
            raise AssertionError(what) from error
        assert {name: decoded(out / name) for name in pictures} == {
            name: decoded(content) for name, content in expected.items()
        }, what
        shutil.rmtree(whole)


def decoded(picture: Path | bytes) -> bytes:
    """The pixels of a picture, without what it says of its origin."""
    return PIL.Image.open(io.BytesIO(picture) if isinstance(picture, bytes) else picture).tobytes()
