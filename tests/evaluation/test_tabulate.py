import csv
import io
import json
from typing import Any

import pytest

from tests.evaluation.helpers import score_line
from texloom.stages.evaluation.tabulate import tabulate
from texloom.stages.vocabulary.declare import InputError

ITEMS = [{"name": "wall, old", "seed": seed, "sources": {"exemplar": "wall.png"}} for seed in (1, 2, 3)]


def scored(colors: float, sharpness: float | None) -> dict[str, Any]:
    return {
        "summary": {"fidelity": colors, "detail": sharpness},
        "measures": {
            "colors": score_line("fidelity", colors, 10 * colors),
            "sharpness": score_line("detail", sharpness, sharpness),
        },
    }


def test_one_row_an_item_and_their_means() -> None:
    table = tabulate([scored(0.5, 1.0), None, scored(0.7, None)], ITEMS).table
    json.dumps(table, allow_nan=False)
    assert (table["items"], table["failed"]) == (3, 1)
    assert table["axes"] == ["fidelity", "detail"]
    assert table["measures"]["sharpness"] == {"what": "Detail", "axis": "detail"}
    assert [row["seed"] for row in table["rows"]] == [1, 2, 3]
    assert [row["failed"] for row in table["rows"]] == [False, True, False]
    assert table["rows"][0]["values"] == {"colors": 5.0, "sharpness": 1.0}
    assert table["rows"][1]["scores"] == {}
    assert table["rows"][2]["summary"] == {"fidelity": 0.7, "detail": None}
    assert table["means"] == {
        "summary": {"fidelity": 0.6, "detail": 1.0},
        "scores": {"colors": 0.6, "sharpness": 1.0},
        "values": {"colors": 6.0, "sharpness": 1.0},
    }


def test_the_spreadsheet_has_the_same_figures() -> None:
    text = tabulate([scored(0.5, 1.0), None, scored(0.7, None)], ITEMS).csv
    assert list(csv.reader(text.splitlines())) == [
        ["name", "seed", "fidelity", "detail", "colors", "sharpness"],
        ["wall, old", "1", "0.5", "1.0", "5.0", "1.0"],
        ["wall, old", "2", "", "", "", ""],
        ["wall, old", "3", "0.7", "", "7.0", ""],
        ["mean", "", "0.6", "1.0", "6.0", "1.0"],
    ]


@pytest.mark.parametrize("name", ["=HYPERLINK(1)", "+1", "-1", "@sum", " =1", "\t=1"])
def test_no_name_is_a_formula(name: str) -> None:
    result = tabulate([scored(-0.5, None)], [{"name": name, "seed": 1, "sources": {}}])
    (_, row, _) = csv.reader(io.StringIO(result.csv, newline=""))
    assert row == [f"'{name}", "1", "-0.5", "", "-5.0", ""]
    assert result.table["rows"][0]["name"] == name


def test_further_measures_join() -> None:
    more = {"summary": {"regularity": 0.25}, "measures": {"recall": score_line("regularity", 0.25, 0.8)}}
    table = tabulate([scored(0.5, 1.0), None, scored(0.7, None)], ITEMS, [more, None, None]).table
    assert table["axes"] == ["fidelity", "detail", "regularity"]
    assert table["rows"][0]["summary"] == {"fidelity": 0.5, "detail": 1.0, "regularity": 0.25}
    assert table["means"]["values"]["recall"] == 0.8
    assert table["failed"] == 1
    with pytest.raises(InputError, match="more has 1 entries, items has 3"):
        tabulate([None, None, None], ITEMS, [more])


def test_nothing_but_failures() -> None:
    result = tabulate([None, None, None], ITEMS)
    assert result.table["failed"] == 3
    assert result.table["means"] == {"summary": {}, "scores": {}, "values": {}}


def test_refused() -> None:
    with pytest.raises(InputError, match="tables has 1 entries, items has 3"):
        tabulate([None], ITEMS)
    with pytest.raises(InputError, match="wall, old is not a table of scores"):
        tabulate([{"measures": []}, None, None], ITEMS)
