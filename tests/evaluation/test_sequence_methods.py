import json
from typing import Any

import numpy as np
import pytest

from texloom.stages.evaluation.sequence_methods import SequenceMethodsParams, sequence_methods
from texloom.stages.vocabulary.arrays import Image
from texloom.stages.vocabulary.declare import InputError

ITEMS = [{"name": "moss", "seed": 3}, {"name": "bark", "seed": 3}]


def strip(value: float) -> Image:
    return Image(np.full((8, 20, 3), value, np.float32), ("R", "G", "B"))


def table(first: float, last: float) -> dict[str, Any]:
    return {"generations": 2, "summary": {"detail": [first, last]}, "means": {"detail": (first + last) / 2}}


def test_a_row_for_each_method() -> None:
    strips: dict[str, list[Image | None]] = {"one": [strip(0.2), None], "other": [strip(0.4), strip(0.5)]}
    tables = {"one": [table(0.9, 0.4), None], "other": [table(1.0, 0.8), table(0.75, 0.5)]}
    made = sequence_methods(strips, tables, ITEMS, SequenceMethodsParams())
    json.dumps(made.table, allow_nan=False)
    assert made.table["methods"] == ["one", "other"]
    first, second = made.table["rows"]
    assert first["results"]["one"] == {"first": {"detail": 0.9}, "last": {"detail": 0.4}, "mean": {"detail": 0.65}}
    assert second["results"]["one"] is None
    assert made.page.count('class="thumb"') == 3
    assert "failed" in made.page
    assert all(item["name"] in made.page for item in ITEMS)


def test_what_does_not_go_together_is_refused() -> None:
    strips: dict[str, list[Image | None]] = {"one": [strip(0.2)]}
    with pytest.raises(InputError, match="name the same methods"):
        sequence_methods(strips, {"other": [table(1, 1)]}, ITEMS[:1], SequenceMethodsParams())
    with pytest.raises(InputError, match="has 1 entries, items has 2"):
        sequence_methods(strips, {"one": [table(1, 1)]}, ITEMS, SequenceMethodsParams())
    with pytest.raises(InputError, match="has no curves"):
        sequence_methods(strips, {"one": [{}]}, ITEMS[:1], SequenceMethodsParams())
