"""The page on which a person compares methods over a set of exemplars."""

from collections.abc import Mapping, Sequence
from functools import partial
from typing import Any

import numpy as np
from pydantic import Field

from texloom.stages.arrays import Image
from texloom.stages.declare import Params, stage
from texloom.stages.evaluation._pages import page, plots
from texloom.stages.evaluation._pages.gathered import item_at, require_length

_SHOWN_DIFFERENCE = 0.005  # of means, which are shown with two decimals


class ComparisonReportParams(Params):
    """What the page shows."""

    title: str = "Comparison"
    """heading of the page"""
    largest: int = Field(512, ge=16, le=16383)
    """longest side of the pictures in the page, px; larger ones are reduced"""
    quality: int = Field(90, ge=1, le=100)
    """of the pictures' lossy compression, which limits the size of the page"""


@stage(version=1)
def comparison_report(
    exemplars: list[Image | None],
    images: dict[str, list[Image | None]],
    summary: dict[str, Any],
    params: ComparisonReportParams,
    items: Sequence[Mapping[str, Any]] = (),
    provenance: Sequence[Mapping[str, Any]] = (),
) -> page.ReportPage:
    """Show the results of several methods side by side, with their grades, wins and losses.

    Parameters
    ----------
    exemplars : one an item.
    images : method to results, one an item, None where the item failed.
    summary : the table of `compare`.
    items : name, seed and sources of each item.
    provenance : the steps upstream, of all items.

    Raises
    ------
    InputError : lists of different lengths.
    """
    grades = summary.get("grades") or {}
    require_length(len(exemplars), "exemplars", images=images, **{"summary.grades": grades})
    if items:
        require_length(len(exemplars), "exemplars", items=items)
    methods = list(dict.fromkeys([*(summary.get("methods") or []), *images]))
    return page.render(
        __file__,
        params.title,
        provenance,
        methods=methods,
        count=len(exemplars),
        uncapped_fidelity=summary.get("uncapped_fidelity", False),
        failed={method: failed for method, failed in (summary.get("failed") or {}).items() if failed},
        overall=_standing(summary.get("overall") or {}, methods),
        groups=_standings(summary, methods),
        plot=plots.paired_scores(_by_axis(grades)),
        rows=_rows(exemplars, images, grades, items, methods, params),
    )


def _by_axis(grades: Mapping[str, Sequence[Mapping[str, Any] | None]]) -> dict[str, dict[str, list[Any]]]:
    """Axis to method to grades, one an item."""
    known = {method: [own or {} for own in column] for method, column in grades.items()}
    axes = dict.fromkeys(axis for column in known.values() for own in column for axis in own)
    return {axis: {method: [own.get(axis) for own in column] for method, column in known.items()} for axis in axes}


def _standings(summary: Mapping[str, Any], methods: Sequence[str]) -> list[dict[str, Any]]:
    """Axes with their measures, in the order of the summary."""
    groups: dict[str, dict[str, Any]] = {}
    for name, part in (summary.get("measures") or {}).items():
        axis = part.get("axis") or ""
        whole = (summary.get("axes") or {}).get(axis) or {}
        group = groups.setdefault(axis, {"axis": axis, **_standing(whole, methods), "lines": []})
        group["lines"].append({"name": name, "what": part.get("what") or "", **_standing(part, methods)})
    return list(groups.values())


def _standing(part: Mapping[str, Any], methods: Sequence[str]) -> dict[str, Any]:
    """Means and wins of one measure, one axis or all; what is missing is None."""
    means = {method: (part.get("means") or {}).get(method) for method in methods}
    known = [mean for mean in means.values() if mean is not None]
    wins: dict[str, dict[str, Any]] = {method: {} for method in methods}
    for pair in part.get("pairs") or []:
        one, other = pair["one"], pair["other"]
        shared = {name: pair.get(name) for name in ("ties", "p", "holm", "reason")}
        wins.setdefault(one, {})[other] = {"wins": pair.get("wins"), "losses": pair.get("losses"), **shared}
        wins.setdefault(other, {})[one] = {"wins": pair.get("losses"), "losses": pair.get("wins"), **shared}
    return {
        "means": means,
        "best": [
            method for method, mean in means.items() if mean is not None and mean >= max(known) - _SHOWN_DIFFERENCE
        ],
        "rates": {method: (part.get("rates") or {}).get(method) for method in methods},
        "exemplars": part.get("exemplars"),
        "wins": wins if part.get("pairs") else {},
    }


def _rows(
    exemplars: Sequence[Image | None],
    images: Mapping[str, Sequence[Image | None]],
    grades: Mapping[str, Sequence[Mapping[str, Any] | None]],
    items: Sequence[Mapping[str, Any]],
    methods: Sequence[str],
    params: ComparisonReportParams,
) -> list[dict[str, Any]]:
    """One row an item; neighbours with the same exemplar show it once, over ``span`` rows."""
    shown = partial(page.shown, largest=params.largest, quality=params.quality)
    rows: list[dict[str, Any]] = []
    first = 0
    for index, exemplar in enumerate(exemplars):
        row = item_at(items, index)
        if rows and row["name"] == rows[first]["name"] and _same(exemplar, exemplars[first]):
            rows[first]["span"] += 1
            row |= {"exemplar": None, "span": 0}
        else:
            first = index
            row |= {"exemplar": shown(exemplar), "span": 1}
        row["cells"] = [
            {
                "method": method,
                "shown": shown(images[method][index]) if method in images else None,
                "scores": (grades[method][index] if method in grades else None) or {},
            }
            for method in methods
        ]
        rows.append(row)
    return rows


def _same(one: Image | None, other: Image | None) -> bool:
    if one is None or other is None:
        return False
    return one is other or np.array_equal(one.pixels, other.pixels)
