import csv
import json
from typing import Any

import numpy as np
import pytest

from stages.arrays import Image
from stages.declare import InputError
from stages.evaluation.verdicts import Verdicts, VerdictsParams, verdicts
from tests.synthetic import picture

ITEMS = [{"name": name, "seed": None, "sources": {"exemplar": f"{name}.png"}} for name in ("wall", "paper", "sky")]


def found(recall: float | None, geometry: float | None, floor: float | None) -> dict[str, Any]:
    line = {"what": "", "axis": "regularity", "value": 0.5, "floor": floor, "ceiling": 1.0}
    scores = {"recall": recall, "geometry": geometry, "appearance": 1.0, "period": 1.0}
    return {"summary": {}, "measures": {name: {**line, "score": score} for name, score in scores.items()}}


NONE = found(None, None, None)
TABLES: dict[str, list[dict[str, Any] | None]] = {
    "good": [found(1.0, 0.95, 0.6), found(0.95, 1.0, 0.1), NONE],
    "bent": [found(1.0, 0.5, 0.6), found(1.0, 1.0, 0.1), NONE],
    "absent": [None, found(0.4, 1.0, 0.1), NONE],
}


def made(tables: dict[str, list[dict[str, Any] | None]] = TABLES, **params: Any) -> Verdicts:
    image = picture(np.full((20, 24, 3), 0.5))
    images: dict[str, list[Image | None]] = {
        method: [None if table is None else image for table in column] for method, column in tables.items()
    }
    return verdicts([image] * 3, images, tables, ITEMS, VerdictsParams(**params))


def test_verdicts_are_counted_by_kind() -> None:
    table = made().table
    assert json.loads(json.dumps(table, allow_nan=False)) == table
    assert [row["kind"] for row in table["rows"]] == ["near-regular", "regular", None]
    assert {name: part["exemplars"] for name, part in table["kinds"].items()} == {"regular": 1, "near-regular": 1}
    rates = {kind: {m: r["rate"] for m, r in part["methods"].items()} for kind, part in table["kinds"].items()}
    assert rates == {
        "regular": {"good": 1.0, "bent": 1.0, "absent": 0.0},
        "near-regular": {"good": 1.0, "bent": 0.0, "absent": 0.0},
    }
    first = table["rows"][0]["verdicts"]
    assert (first["bent"]["made"], first["absent"]["made"]) == (True, False)


def test_bounds_decide() -> None:
    def good(**params: float) -> list[bool]:
        return [row["verdicts"]["good"]["preserved"] for row in made(**params).table["rows"]]

    assert good() == [True, True, False]
    assert good(recall=0.96) == [True, False, False]
    assert good(geometry=0.96) == [False, True, False]
    assert {row["kind"] for row in made(alike=0.05).table["rows"]} == {"near-regular", None}


def test_the_spreadsheet_says_the_same() -> None:
    rows = list(csv.DictReader(made().csv.splitlines()))
    assert len(rows) == 9
    assert [row["preserved"] for row in rows] == ["yes", "no", "no", "yes", "yes", "no", "", "", ""]
    assert (rows[1]["name"], rows[1]["method"], rows[1]["geometry"], rows[2]["geometry"]) == (
        "wall",
        "bent",
        "0.5",
        "",
    )


def test_the_page_shows_all() -> None:
    page = made(title="Walls & papers").page
    assert "Walls &amp; papers" in page
    assert page.count('class="thumb"') == 3 + 9 - 1
    assert "Near-regular textures" in page
    assert "Regular textures" in page
    assert "no lattice found" in page
    assert "1 of 1" in page


def test_lists_must_fit() -> None:
    with pytest.raises(InputError, match="images: good: 2 tables for 3 items"):
        made({"good": TABLES["good"][:2]})
    with pytest.raises(InputError, match="name the same methods"):
        verdicts([None] * 3, {}, TABLES, ITEMS, VerdictsParams())
    with pytest.raises(InputError, match="is not a table of scores"):
        made({"good": [{}, None, None]})
