"""The better of two textures."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from tests.synthetic import picture
from texloom.stages.evaluation.choice import Choice, ChoiceParams, choice


def table(**scores: float | None) -> dict[str, Any]:
    return {"summary": scores}


def chosen(first: dict[str, Any], second: dict[str, Any], **params: Any) -> Choice:
    one, other = (picture(np.full((4, 4), value)) for value in (0.0, 1.0))
    return choice(one, other, first, second, ChoiceParams(labels=("bark", "moss"), **params))


def test_higher_scores_win_and_the_reason_is_told() -> None:
    made = chosen(table(fidelity=0.9, structure=0.5), table(fidelity=0.8, structure=0.8))
    assert made.image.pixels.min() == 1
    assert made.table["chosen"] == "moss"
    assert made.table["totals"] == {"bark": pytest.approx(0.7), "moss": pytest.approx(0.8)}
    assert "largest difference is in structure, 0.800 against 0.500" in made.table["because"]
    assert chosen(table(fidelity=0.9), table(fidelity=0.8)).table["chosen"] == "bark"


def test_only_scores_that_both_have_count() -> None:
    made = chosen(table(fidelity=0.9, structure=None), table(fidelity=0.8, structure=1.0))
    assert made.table["chosen"] == "bark"
    assert chosen(table(), table()).table["because"] == "no score was measured for both"


def test_weights_and_margin() -> None:
    scores = table(fidelity=0.9, structure=0.5), table(fidelity=0.8, structure=0.7)
    assert chosen(*scores).table["chosen"] == "moss"
    assert chosen(*scores, margin=0.1).table["chosen"] == "bark"
    assert chosen(*scores, weights={"fidelity": 1.0}).table["chosen"] == "bark"
