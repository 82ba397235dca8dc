"""Files that are complete or absent, also after a kill."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from texloom.pipelines.store import codec, folders
from texloom.pipelines.store.atomic import atomic_path, probe_folder, remove_abandoned, write_atomically
from texloom.stages.vocabulary.arrays import Image

KILLED = """
import os, signal, sys
from pathlib import Path
from texloom.pipelines.store.atomic import atomic_path
with atomic_path(Path(sys.argv[1])) as temporary:
    temporary.write_bytes(b"half")
    os.kill(os.getpid(), signal.SIGKILL)
"""


def test_what_a_killed_process_left_is_removed(tmp_path: Path) -> None:
    killed = subprocess.run([sys.executable, "-c", KILLED, str(tmp_path / "a.exr")], check=False)
    assert killed.returncode == -signal.SIGKILL
    (left,) = tmp_path.iterdir()
    assert left.name.endswith("-a.exr")
    assert remove_abandoned(tmp_path) == []
    assert list(tmp_path.iterdir()) == []


def test_what_is_being_written_stays(tmp_path: Path) -> None:
    with atomic_path(tmp_path / "a.bin") as temporary:
        temporary.write_bytes(b"half")
        temporary.write_bytes(b"whole")
        assert remove_abandoned(tmp_path) == [temporary]
    assert (tmp_path / "a.bin").read_bytes() == b"whole"
    assert [path.name for path in tmp_path.iterdir()] == ["a.bin"]


def test_where_files_cannot_be_locked_old_ones_are_removed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """As on Windows."""
    monkeypatch.setattr(folders, "CAN_LOCK", False)
    (tmp_path / ".new-01234567-old").touch()
    os.utime(tmp_path / ".new-01234567-old", (0, 0))
    with atomic_path(tmp_path / "a.bin") as temporary:
        temporary.write_bytes(b"whole")
        assert remove_abandoned(tmp_path) == [temporary]
    assert [path.name for path in tmp_path.iterdir()] == ["a.bin"]


def test_runs_need_no_locks_of_posix() -> None:
    """Where Python has no ``fcntl``, which is on Windows."""
    code = (
        "import sys; sys.modules['fcntl'] = None\n"
        "import texloom.pipelines.api, texloom.pipelines.engine.scheduler, texloom.pipelines.store.housekeeping"
    )
    subprocess.run([sys.executable, "-c", code], check=True)


def test_an_exr_that_is_being_written_stays(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Its writer opens the file anew."""
    held: list[list[Path]] = []
    digest = codec.file_digest
    monkeypatch.setattr(codec, "file_digest", lambda path: held.append(remove_abandoned(tmp_path)) or digest(path))
    codec.export(Image(np.zeros((4, 4, 3), np.float32), ("R", "G", "B")), Image, tmp_path / "a.exr", {})
    assert len(held[0]) == 1
    assert [path.name for path in tmp_path.iterdir()] == ["a.exr"]


def test_files_of_a_user_stay(tmp_path: Path) -> None:
    names = [".new-thing", ".new-0123456-short", "new-01234567-a", ".new-01234567-"]
    for name in names:
        (tmp_path / name).touch()
    (tmp_path / ".new-01234567-folder").mkdir()
    (tmp_path / ".new-01234567-link").symlink_to(tmp_path / names[0])
    remove_abandoned(tmp_path)
    assert {path.name for path in tmp_path.iterdir()} >= {*names, ".new-01234567-folder", ".new-01234567-link"}


def test_a_file_has_the_mode_that_the_user_chose(tmp_path: Path) -> None:
    before = os.umask(0o027)
    try:
        write_atomically(tmp_path / "a", b"")
    finally:
        os.umask(before)
    assert (tmp_path / "a").stat().st_mode & 0o777 == 0o640


def test_a_probe_leaves_nothing(tmp_path: Path) -> None:
    probe_folder(tmp_path)
    assert list(tmp_path.iterdir()) == []
    with pytest.raises(OSError, match="No such file"):
        probe_folder(tmp_path / "gone")
