"""The better of two textures."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from tests.synthetic import picture
from texloom.stages.evaluation.choice import Choice, ChoiceParams, choice
from texloom.stages.vocabulary.declare import InputError


def table(**scores: float | None) -> dict[str, Any]:
    return {"summary": scores}


def chosen(first: dict[str, Any], second: dict[str, Any], **params: Any) -> Choice:
    one, other = (picture(np.full((4, 4), value)) for value in (0.0, 1.0))
    return choice(ChoiceParams(labels=("bark", "moss"), **params), one, first, other, second)


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


def test_the_best_of_several_and_what_is_missing() -> None:
    one = picture(np.zeros((4, 4)))
    labels = ("bark", "moss", "sand", "snow")
    scores = {name: table(fidelity=value) for name, value in zip(labels, (0.5, 0.7, 0.9, 0.6), strict=True)}
    given = {"first": one, "first_scores": scores["bark"], "third": one, "third_scores": scores["sand"]}
    made = choice(ChoiceParams(labels=labels), fourth=one, fourth_scores=scores["snow"], **given)
    assert made.table["totals"] == {"bark": 0.5, "sand": 0.9, "snow": 0.6}
    assert (made.table["chosen"], made.scores) == ("sand", scores["sand"])
    because = "sand scores 0.900, bark 0.500, snow 0.600; the largest difference to snow is in fidelity"
    assert made.table["because"].startswith(because)
    assert choice(ChoiceParams(labels=labels, margin=0.5), **given).table["chosen"] == "bark"
    alone = choice(ChoiceParams(labels=labels), second=one, second_scores=scores["moss"]).table
    assert (alone["chosen"], alone["because"]) == ("moss", "moss alone is there")


@pytest.mark.parametrize(
    ("given", "problem"),
    [
        ({}, "first: there is no texture to choose"),
        ({"second": 1}, "second: has no scores; give second_scores"),
        ({"third": 1, "third_scores": {}}, "labels: names 2 textures, but there is a third"),
    ],
)
def test_what_cannot_be_chosen(given: dict[str, Any], problem: str) -> None:
    images = {name: picture(np.zeros((4, 4))) if value == 1 else table() for name, value in given.items()}
    with pytest.raises(InputError, match=problem):
        choice(ChoiceParams(), **images)
