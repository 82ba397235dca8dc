"""The log of runs."""

from __future__ import annotations

from pathlib import Path

from texloom.pipelines.store import run_log
from texloom.pipelines.store.run_log import LoggedRun


def test_what_the_same_run_left_when_it_was_killed_goes(tmp_path: Path) -> None:
    run = LoggedRun("self_tuning", {"exemplar": "a.png"}, (7,), {"edges": "0" * 64})
    run_log.write(tmp_path, run)
    (entry,) = (tmp_path / "log").iterdir()
    entry.rename(entry.with_name(f".new-01234567-{entry.name}"))
    run_log.write(tmp_path, run)
    assert list((tmp_path / "log").iterdir()) == [entry]
