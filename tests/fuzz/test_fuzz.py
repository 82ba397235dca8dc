"""The first cases of every kind of fuzzed input; ``python -m tests.fuzz --cases 20000`` runs more."""

from __future__ import annotations

import pytest

from tests.fuzz.kinds import KINDS, MEMORY, run_case

CASES = {
    "flows": 40,
    "params": 60,
    "geometry": 20,
    "masks": 40,
    "stores": 20,
    "meshes": 30,
    "messages": 60,
    "shared": 10,
}


@pytest.mark.parametrize("kind", KINDS)
def test_fuzzed_input_is_accepted_or_refused_by_a_line(kind: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("TEXLOOM_MEMORY", MEMORY)
    outcomes = [run_case(kind, number) for number in range(CASES.get(kind, 80))]
    assert [(number, problem) for number, (_, problem) in enumerate(outcomes) if problem is not None] == []
    accepted = sum(accepted for accepted, _ in outcomes)
    assert accepted > 0, "cases must reach further than the first check"
    assert accepted < len(outcomes) or kind in ("stores", "shared")
