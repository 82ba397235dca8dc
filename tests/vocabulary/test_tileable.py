"""What is asked for of the borders of a result."""

from typing import Any

import pydantic
import pytest

from texloom.stages.vocabulary.declare import Params
from texloom.stages.vocabulary.facts import NOWHERE, TORUS, Wraps
from texloom.stages.vocabulary.tileable import Tileable, TileableBoth


class _Asked(Params):
    tileable: Tileable = NOWHERE
    kept: Tileable | None = None
    torus: TileableBoth = False


@pytest.mark.parametrize(
    ("value", "wraps", "record"),
    [
        (True, TORUS, True),
        (False, NOWHERE, False),
        ("both", TORUS, True),
        ("off", NOWHERE, False),
        ("x", Wraps(across=True), "x"),
        ("y", Wraps(down=True), "y"),
        (Wraps(down=True), Wraps(down=True), "y"),
    ],
)
def test_names_and_truth_values_become_axes_and_one_record_each(value: Any, wraps: Wraps, record: Any) -> None:
    asked = _Asked(tileable=value, kept=value)
    assert (asked.tileable, asked.kept) == (wraps, wraps)
    assert asked.model_dump(mode="json") == {"tileable": record, "kept": record, "torus": False}
    assert _Asked(**asked.model_dump(mode="json")) == asked


@pytest.mark.parametrize("value", ["z", "X", 1, 2.0, ["x"], None])
def test_other_values_are_refused(value: Any) -> None:
    with pytest.raises(pydantic.ValidationError, match=r"off, x \(left and right borders\), y"):
        _Asked(tileable=value)


def test_compactions_refuse_one_axis() -> None:
    assert _Asked(torus="both").torus is True  # type: ignore[arg-type]
    with pytest.raises(pydantic.ValidationError, match="'x': a compaction is tileable along both axes"):
        _Asked(torus="x")  # type: ignore[arg-type]
