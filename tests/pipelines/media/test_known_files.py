"""Files that need not be opened again, and those that must."""

from __future__ import annotations

import os
import time
from pathlib import Path

import numpy as np
import pytest

from tests.pipelines.pictures import png
from texloom.pipelines.media import known_files, locate
from texloom.pipelines.media.known_files import Inspected, KnownFiles


def picture(path: Path, side: int = 3, age: float = 60) -> Path:
    path.write_bytes(png(np.zeros((side, side, 3)), 8))
    os.utime(path, (time.time() - age,) * 2)
    return path


def inspected(path: Path, known: KnownFiles, data: bool = False) -> Inspected:
    with known_files.using(known):
        return locate.inspect(str(path), data)


@pytest.fixture
def path(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A picture that is old enough to be kept: the time of its inode's change cannot be set."""
    monkeypatch.setattr(known_files, "_RESOLUTION", 0)
    return picture(tmp_path / "a.png")


def test_a_file_is_opened_once(path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    first = inspected(path, known := KnownFiles({}, "code"))
    assert (first, known.is_new) == (locate.inspect(str(path)), True)
    again = KnownFiles(known.entries, "code")
    monkeypatch.setattr(locate, "opened", None)
    assert (inspected(path, again), again.is_new) == (first, False)


def test_what_is_read_in_another_way_is_read(path: Path) -> None:
    inspected(path, known := KnownFiles({}, "code"))
    for other, data in (
        (KnownFiles(known.entries, "other code"), False),
        (KnownFiles(known.entries, "code"), True),
    ):
        inspected(path, other, data)
        assert other.is_new


def test_a_changed_file_is_read_though_size_and_time_are_as_before(path: Path) -> None:
    before, known = path.stat(), KnownFiles({}, "code")
    first = inspected(path, known)
    time.sleep(0.02)  # a tick of the clock that files get their times from
    content = bytearray(path.read_bytes())
    content[-1] ^= 1  # the end of the last chunk, which a header does not need
    path.write_bytes(content)
    os.utime(path, ns=(before.st_atime_ns, before.st_mtime_ns))
    assert (path.stat().st_size, path.stat().st_mtime_ns) == (before.st_size, before.st_mtime_ns)
    assert inspected(path, known).digest != first.digest


def test_a_file_that_changed_just_now_is_not_kept(tmp_path: Path) -> None:
    known = KnownFiles({}, "code")
    inspected(picture(tmp_path / "a.png"), known)
    assert known.entries == {}
