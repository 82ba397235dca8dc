"""The artifact store: whole or not there."""

from __future__ import annotations

import errno
import json
import os
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests.pipelines.store.results import KEY, STAGE, finished, result
from texloom.pipelines.store import codec, housekeeping
from texloom.pipelines.store.history import History
from texloom.pipelines.store.record import SERIALIZER, record_name
from texloom.pipelines.store.result_files import BrokenArtifactError
from texloom.pipelines.store.store import Store
from texloom.stages.analysis.structure.otsu import Otsu
from texloom.stages.vocabulary.declare import InputError


@pytest.fixture
def store(tmp_path: Path) -> Store:
    made = Store(tmp_path / "artifacts")
    made.create()
    return made


def test_a_result_comes_back_bit_by_bit(store: Store) -> None:
    saved = finished(store)
    measured = store.find(STAGE.name, KEY)
    assert measured is not None
    assert measured.outputs == saved.outputs == codec.digests(result())
    values = store.load(measured, Otsu)
    np.testing.assert_array_equal(values["structure"], result().structure)
    assert values["threshold"] == 0.25
    assert set(store.load(measured, Otsu, ["threshold"])) == {"threshold"}


def test_without_a_record_there_is_no_result(store: Store) -> None:
    store.save(STAGE, KEY, result(), {})
    assert store.find(STAGE.name, KEY) is None


def test_looking_into_a_store_creates_nothing(tmp_path: Path) -> None:
    empty = Store(tmp_path / "nowhere")
    assert empty.find(STAGE.name, KEY) is None
    assert housekeeping.entries(empty) == []
    assert History(empty, "flow").steps == {}
    empty.check_writable()
    assert not empty.root.exists()


def cut(path: Path) -> None:
    path.write_bytes(path.read_bytes()[:-7])


def alter(path: Path) -> None:
    content = bytearray(path.read_bytes())
    content[len(content) // 2] ^= 1
    path.write_bytes(content)


@pytest.mark.parametrize("damage", [cut, alter, Path.unlink])
@pytest.mark.parametrize("file", ["result.exr", "manifest.json", "structure.png"])
def test_damage_is_found(store: Store, damage: Any, file: str) -> None:
    artifact = finished(store)
    damage(artifact.folder / file)
    with pytest.raises(BrokenArtifactError):
        store.find(STAGE.name, KEY)
    assert [problem is None for _, problem in housekeeping.verify(store)] == [False]


@pytest.mark.parametrize("content", ["", "{", "[]", '{"result": 3}', '{"result": "{}"}'])
def test_a_broken_record_is_no_record(store: Store, content: str) -> None:
    finished(store)
    (store.records / record_name(STAGE.name, KEY)).write_text(content)
    with pytest.raises(BrokenArtifactError, match="record"):
        store.find(STAGE.name, KEY)


@pytest.mark.parametrize("serializer", [None, "pickle", "json", {"type": "pickle"}, {"type": SERIALIZER, "x": 1}])
def test_a_record_in_another_form_is_not_read(store: Store, serializer: Any) -> None:
    finished(store)
    path = store.records / record_name(STAGE.name, KEY)
    record = json.loads(path.read_text())
    path.write_text(json.dumps({**record, "metadata": {"serializer": serializer}}))
    with pytest.raises(BrokenArtifactError, match="not one that texloom wrote"):
        store.find(STAGE.name, KEY)


def test_a_record_of_another_key_is_refused(store: Store) -> None:
    finished(store)
    other = store.records / record_name(STAGE.name, KEY[::-1])
    other.write_bytes((store.records / record_name(STAGE.name, KEY)).read_bytes())
    with pytest.raises(BrokenArtifactError, match="of another result"):
        store.find(STAGE.name, KEY[::-1])


def test_a_pipe_in_place_of_a_record_is_not_waited_for(store: Store) -> None:
    finished(store)
    path = store.records / record_name(STAGE.name, KEY)
    path.unlink()
    os.mkfifo(path)
    with pytest.raises(BrokenArtifactError, match="cannot be read"):
        store.find(STAGE.name, KEY)
    store.save(STAGE, KEY, result(), {})
    assert store.find(STAGE.name, KEY) is None


def test_damage_that_keeps_size_and_time_is_found_when_the_file_is_read(store: Store) -> None:
    artifact = finished(store)
    path = artifact.folder / "result.exr"
    before = path.stat()
    alter(path)
    os.utime(path, ns=(before.st_atime_ns, before.st_mtime_ns))
    measured = store.find(STAGE.name, KEY)
    assert measured is not None
    with pytest.raises(BrokenArtifactError, match=r"result\.exr has been altered"):
        store.load(measured, Otsu)
    assert [problem for _, problem in housekeeping.verify(store)] == ["result.exr has been altered"]


def test_a_store_can_be_moved(store: Store, tmp_path: Path) -> None:
    finished(store)
    store.root.rename(tmp_path / "elsewhere")
    moved = Store(tmp_path / "elsewhere")
    measured = moved.find(STAGE.name, KEY)
    assert measured is not None
    np.testing.assert_array_equal(moved.load(measured, Otsu)["structure"], result().structure)


def test_a_failed_write_leaves_nothing(store: Store, monkeypatch: pytest.MonkeyPatch) -> None:
    def write(_result: Any, folder: Path, *_: Any, **__: Any) -> list[str]:
        (folder / "result.exr").write_bytes(b"half of it")
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr(codec, "write", write)
    with pytest.raises(OSError, match=f"No space left on device: '{store.root}/cache/.*{KEY}'"):
        store.save(STAGE, KEY, result(), {})
    assert list((store.root / "cache").rglob("*.exr")) == []
    assert list((store.root / "cache" / STAGE.name).iterdir()) == []


def test_what_a_killed_writer_left_goes_with_the_next_write(store: Store) -> None:
    left = store.root / "cache" / STAGE.name / f".new-{KEY}-dead"
    left.mkdir(parents=True)
    store.save(STAGE, KEY, result(), {})
    assert not left.exists()


def test_checkpoints_resume_at_the_last_whole_level(store: Store) -> None:
    checkpoints = store.checkpoints(STAGE.name, KEY)
    assert checkpoints.latest(Otsu) is None
    for level in (1, 2, 11):
        checkpoints.save(level, result(level))
    level, state = checkpoints.latest(Otsu) or (0, None)
    assert level == 11
    np.testing.assert_array_equal(state.structure, result(11).structure)
    cut(checkpoints.folder / "11" / "result.exr")
    level, state = checkpoints.latest(Otsu) or (0, None)
    assert level == 2
    np.testing.assert_array_equal(state.structure, result(2).structure)


def test_a_checkpoint_has_no_previews(store: Store) -> None:
    """Nobody looks at the scales of a step that goes on."""
    checkpoints = store.checkpoints(STAGE.name, KEY)
    checkpoints.save(1, result())
    assert sorted(path.name for path in (checkpoints.folder / "01").iterdir()) == ["manifest.json", "result.exr"]
    assert (store.save(STAGE, KEY, result(), {}).folder / "structure.png").exists()


def test_a_store_below_a_file_is_refused(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    for refused in (Store(tmp_path / "file").check_writable, Store(tmp_path / "file" / "store").create):
        with pytest.raises(InputError, match="--store"):
            refused()


def test_record_names_have_no_dot() -> None:
    assert record_name("analysis.otsu", KEY) == f"analysis-otsu-{KEY}"
