import csv
import json
from typing import Any

import numpy as np
import pytest

from tests.evaluation.helpers import Tables, score_line
from tests.synthetic import picture
from texloom.stages.evaluation.regularity_preservation import (
    RegularityPreservation,
    RegularityPreservationParams,
    regularity_preservation,
)
from texloom.stages.vocabulary.arrays import Image
from texloom.stages.vocabulary.declare import InputError

ITEMS = [{"name": name, "seed": None, "sources": {"exemplar": f"{name}.png"}} for name in ("wall", "paper", "sky")]


def scores(recall: float | None, geometry: float | None, floor: float | None) -> dict[str, Any]:
    """``geometry`` is unevenness, of which the exemplar has 0.1; ``floor`` is how much its cells differ."""
    names = {"recall": recall, "geometry": 0.6, "appearance": 1.0, "period": 1.0}
    measures = {name: score_line("regularity", score, 0.5, floor) for name, score in names.items()}
    measures["geometry"] |= {"value": geometry, "floor": None if geometry is None else 0.1}
    return {"summary": {}, "measures": measures}


NONE = scores(None, None, None)
TABLES: Tables = {
    "good": [scores(1.0, 0.13, 0.6), scores(0.95, 0.1, 0.1), NONE],
    "bent": [scores(1.0, 0.15, 0.6), scores(1.0, 0.05, 0.1), NONE],
    "absent": [None, scores(0.4, 0.1, 0.1), NONE],
}


def made(tables: Tables = TABLES, **params: Any) -> RegularityPreservation:
    image = picture(np.full((20, 24, 3), 0.5))
    images: dict[str, list[Image | None]] = {
        method: [None if table is None else image for table in column] for method, column in tables.items()
    }
    return regularity_preservation([image] * 3, images, tables, ITEMS, RegularityPreservationParams(**params))


def test_an_exemplar_without_a_lattice_is_a_failure_of_all() -> None:
    table = made().table
    assert [row["kind"] for row in table["rows"]] == ["near-regular", "regular", "near-regular"]
    assert table["kinds"]["near-regular"]["methods"]["good"] == {"preserved": 1, "rate": 0.5}


def test_results_are_counted_by_kind() -> None:
    table = made(undetected=False).table
    assert json.loads(json.dumps(table, allow_nan=False)) == table
    assert [row["kind"] for row in table["rows"]] == ["near-regular", "regular", None]
    assert {name: part["exemplars"] for name, part in table["kinds"].items()} == {"regular": 1, "near-regular": 1}
    rates = {kind: {m: r["rate"] for m, r in part["methods"].items()} for kind, part in table["kinds"].items()}
    assert rates == {
        "regular": {"good": 1.0, "bent": 1.0, "absent": 0.0},
        "near-regular": {"good": 1.0, "bent": 0.0, "absent": 0.0},
    }
    first = table["rows"][0]["results"]
    assert (first["bent"]["made"], first["absent"]["made"]) == (True, False)
    assert (first["bent"]["uneven"], first["absent"]["uneven"]) == (pytest.approx(1.5), None)
    assert table["rows"][2]["results"]["good"]["uneven"] is None


def test_an_even_exemplar_leaves_what_is_not_seen() -> None:
    """Twice as uneven as an exemplar of 1 % is still even, and nothing measured is not."""
    fine = scores(1.0, 0.02, 0.6)
    fine["measures"]["geometry"]["floor"] = 0.01
    unknown = scores(1.0, None, 0.6)
    rows = made({"fine": [fine, unknown, NONE]}).table["rows"]
    assert [row["results"]["fine"]["preserved"] for row in rows] == [True, False, False]
    assert not made({"fine": [fine, NONE, NONE]}, even=0.015).table["rows"][0]["results"]["fine"]["preserved"]


def test_bounds_decide() -> None:
    def good(**params: Any) -> list[bool]:
        return [row["results"]["good"]["preserved"] for row in made(**params).table["rows"]]

    assert good() == [True, True, False]
    assert good(recall=0.96) == [True, False, False]
    assert good(uneven=1.25) == [False, True, False]
    assert good(uneven=1.0, even=0.13) == [True, True, False]
    assert {row["kind"] for row in made(alike=0.05, undetected=False).table["rows"]} == {"near-regular", None}


def test_the_spreadsheet_has_the_same_figures() -> None:
    rows = list(csv.DictReader(made(undetected=False).csv.splitlines()))
    assert len(rows) == 9
    assert [row["preserved"] for row in rows] == ["yes", "no", "no", "yes", "yes", "no", "", "", ""]
    assert [rows[1][key] for key in ("name", "method", "geometry", "uneven")] == ["wall", "bent", "0.6", "1.5"]
    assert rows[2]["geometry"] == rows[2]["uneven"] == ""


def test_the_page_shows_all() -> None:
    page = made(title="Walls & papers", undetected=False).page
    for words in ("Walls &amp; papers", "Near-regular textures", "Regular textures", "no lattice found", "1 of 1"):
        assert words in page
    assert page.count('class="thumb"') == 3 + 9 - 1
    assert page.count('class="kept" title') == 2 * 3  # in the tables and below pictures
    assert page.count('class="is-lost"') == 2
    assert 'href="#item-1"' in page
    assert '<tr id="item-1">' in page


def test_lists_must_fit() -> None:
    with pytest.raises(InputError, match=r"images\.good has 2 entries, items has 3"):
        made({"good": TABLES["good"][:2]})
    with pytest.raises(InputError, match="name the same methods"):
        regularity_preservation([None] * 3, {}, TABLES, ITEMS, RegularityPreservationParams())
    with pytest.raises(InputError, match="is not a table of scores"):
        made({"good": [{}, None, None]})
