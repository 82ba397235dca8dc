import csv
import json
from typing import Any

import pytest

from tests.evaluation.helpers import Tables, score_line
from texloom.stages.evaluation.timings import TimingsParams, timings
from texloom.stages.vocabulary.declare import InputError

ITEMS = [{"name": name, "seed": None, "sources": {}} for name in ("wall", "paper", "sky")]


def scored(score: float | None) -> dict[str, Any]:
    return {"summary": {}, "measures": {"colors": score_line("fidelity", score, 1.0)}}


def ran(step: str, item: str, seconds: float | None) -> dict[str, Any]:
    return {"step": step, "item": item, "seed": None, "seconds": seconds}


TABLES: Tables = {
    "fast": [scored(0.5), scored(None), scored(0.7)],
    "slow": [scored(1.0), None, scored(0.8)],
}
RAN = [
    *(ran("fast", item, seconds) for item, seconds in (("wall", 9.0), ("paper", 1.0), ("sky", 2.0))),
    *(ran("slow", item, seconds) for item, seconds in (("wall", 4.0), ("paper", None), ("sky", 6.0))),
    ran("fast_scores", "wall", 100.0),
    ran("fast", "wall", 9.0),  # upstream of two steps
]


def test_seconds_and_scores_by_step() -> None:
    table = timings(TABLES, ITEMS, TimingsParams(), RAN).table
    assert json.loads(json.dumps(table, allow_nan=False)) == table
    fast, slow = table["steps"]["fast"], table["steps"]["slow"]
    assert (fast["runs"], fast["median"], fast["min"], fast["max"], fast["to_first"]) == (3, 2.0, 1.0, 9.0, 1.0)
    assert (slow["runs"], slow["median"], slow["to_first"]) == (2, 5.0, 2.5)
    assert (fast["means"], slow["means"]) == ({"fidelity": 0.6}, {"fidelity": 0.9})


def test_the_spreadsheet_has_the_same_figures() -> None:
    rows = list(csv.DictReader(timings(TABLES, ITEMS, TimingsParams(), RAN).csv.splitlines()))
    assert [(row["step"], row["median"], row["fidelity"]) for row in rows] == [
        ("fast", "2.0", "0.6"),
        ("slow", "5.0", "0.9"),
    ]


def test_nothing_is_known_without_provenance() -> None:
    step = timings(TABLES, ITEMS, TimingsParams()).table["steps"]["slow"]
    assert (step["runs"], step["median"], step["min"], step["to_first"]) == (0, None, None, None)


def test_names_must_be_steps() -> None:
    with pytest.raises(InputError, match="tables: other is no step"):
        timings({"other": [None] * 3}, ITEMS, TimingsParams(), RAN)
    with pytest.raises(InputError, match=r"tables\.fast has 1 entries, items has 3"):
        timings({"fast": [None]}, ITEMS, TimingsParams(), RAN)
