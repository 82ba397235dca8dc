from __future__ import annotations

from texloom.pipelines.engine.events import summary_of


def test_items_that_fail_alike_share_their_reason() -> None:
    problems = {"a": "no lattice", "b": "too small", "c": "no lattice"}
    assert summary_of(problems, 4) == "3 of 4 items failed: a, c (no lattice); b (too small)"
