"""The scores of many results in one table."""

import dataclasses
from typing import Any

from texloom.stages.evaluation._measures.table import csv_text, rounded
from texloom.stages.evaluation._pages.gathered import (
    Scores,
    joined,
    least_of,
    mean_of,
    measures_of,
    require_length,
)
from texloom.stages.vocabulary.arrays import Spreadsheet
from texloom.stages.vocabulary.declare import stage

_PARTS = ("summary", "scores", "values")


@dataclasses.dataclass(frozen=True)
class Table:
    """One row an item."""

    table: dict[str, Any]
    """see `tabulate`; ready for JSON"""
    csv: Spreadsheet
    """the same for spreadsheets: name, seed, the axes' scores and the measures' values; a row an item, and their
    means; empty where unknown. A name that would be taken for a formula is preceded by a '"""


def _row(item: dict[str, Any], failed: bool, lines: Scores) -> dict[str, Any]:
    axes = dict.fromkeys(line["axis"] for line in lines.values())
    summary = {axis: least_of(line["score"] for line in lines.values() if line["axis"] == axis) for axis in axes}
    return {
        "name": item["name"],
        "seed": item.get("seed"),
        "failed": failed,
        "summary": {axis: rounded(score) for axis, score in summary.items()},
        "scores": {measure: line["score"] for measure, line in lines.items()},
        "values": {measure: line["value"] for measure, line in lines.items()},
    }


def _csv(axes: list[str], measures: list[str], rows: list[dict[str, Any]], means: dict[str, Any]) -> str:
    lines = [["name", "seed", *axes, *measures]]
    for row in [*rows, {"name": "mean", "seed": None, **means}]:
        scores, values = map(row["summary"].get, axes), map(row["values"].get, measures)
        lines.append([row["name"], row["seed"], *scores, *values])
    return csv_text(lines)


@stage(version=2)
def tabulate(
    tables: list[dict[str, Any] | None],
    items: list[dict[str, Any]],
    more: list[dict[str, Any] | None] | None = None,
) -> Table:
    """Collect the tables of `metrics` of all items in one.

    Parameters
    ----------
    tables : one an item, None where the item failed.
    more : further tables of the same form, as those of `regularity`; their measures join the others.

    Returns
    -------
    ``items`` and ``failed``, numbers; ``axes``; ``measures``: name to ``what`` and ``axis``; ``rows``: ``name``,
    ``seed``, ``failed``, ``summary`` (axis to score), ``scores`` and ``values`` (by measure), null where unknown;
    ``means``: the same three, over the items that have them.

    Raises
    ------
    InputError : tables without scores, or not one an item.
    """
    columns = {"tables": tables, "more": [None] * len(tables) if more is None else more}
    require_length(len(items), "items", **columns)
    gathered = [
        [measures_of(table, f"{where}: {item['name']}") for table, item in zip(column, items, strict=True)]
        for where, column in columns.items()
    ]
    lines = [joined(one, other) or {} for one, other in zip(*gathered, strict=True)]
    rows = [_row(item, table is None, own) for item, table, own in zip(items, tables, lines, strict=True)]
    measures = {
        name: {"what": line.get("what", ""), "axis": line["axis"]} for own in lines for name, line in own.items()
    }
    axes = list(dict.fromkeys(line["axis"] for line in measures.values()))
    means = {
        part: {
            name: rounded(mean_of(row[part].get(name) for row in rows))
            for name in (axes if part == "summary" else measures)
        }
        for part in _PARTS
    }
    counts = {"items": len(items), "failed": sum(row["failed"] for row in rows)}
    table = {**counts, "axes": axes, "measures": measures, "rows": rows, "means": means}
    return Table(table, _csv(axes, list(measures), rows, means))
