"""A small data set; ``python -m tests.datasets`` runs a large one."""

from __future__ import annotations

import random
from pathlib import Path

from tests.datasets import Library


def test_a_set_ends_with_one_named_failure_although_a_worker_is_killed(tmp_path: Path) -> None:
    library = Library.made(tmp_path / "library", items=4, side=40, size=16)
    ended = library.run("processes", kills=1, rng=random.Random(1), expected=1.0)
    assert not library.problems(ended, "processes")
    assert library.broken in ended.errors
    assert not library.run_again("processes")[1]
