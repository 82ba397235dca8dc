"""The page on which a person compares methods over a set of exemplars."""

import dataclasses
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from pydantic import Field

from texloom.stages.arrays import Image, Page
from texloom.stages.declare import InputError, Params, stage
from texloom.stages.evaluation._pages import page as _page
from texloom.stages.evaluation._pages import plots


class ComparisonReportParams(Params):
    """What the page shows."""

    title: str = "Comparison"
    """what stands above"""
    largest: int = Field(512, ge=16, le=16383)
    """longest side of the pictures in the page, px; larger ones are reduced"""
    quality: int = Field(90, ge=1, le=100)
    """of the pictures' compression; it bounds the size of a page with many of them"""


@dataclasses.dataclass(frozen=True)
class ComparisonReport:
    """The page."""

    page: Page
    """all pictures are inside; it needs no network"""


def _standing(part: Mapping[str, Any], methods: Sequence[str]) -> dict[str, Any]:
    """Means and wins of one measure, one axis or all, ready for the page; what is missing is None."""
    means = {method: (part.get("means") or {}).get(method) for method in methods}
    known = [mean for mean in means.values() if mean is not None]
    wins: dict[str, dict[str, Any]] = {method: {} for method in methods}
    for pair in part.get("pairs") or []:
        one, other = pair["one"], pair["other"]
        shared = {"ties": pair.get("ties"), **{name: pair.get(name) for name in ("p", "holm", "reason")}}
        wins.setdefault(one, {})[other] = {"wins": pair.get("wins"), "losses": pair.get("losses"), **shared}
        wins.setdefault(other, {})[one] = {"wins": pair.get("losses"), "losses": pair.get("wins"), **shared}
    return {
        "means": means,
        "best": [method for method, mean in means.items() if mean is not None and mean >= max(known) - 0.005],
        "rates": {method: (part.get("rates") or {}).get(method) for method in methods},
        "exemplars": part.get("exemplars"),
        "wins": wins if part.get("pairs") else {},
    }


def _standings(
    summary: Mapping[str, Any], methods: Sequence[str], tables: Mapping[str, Sequence[dict[str, Any] | None]]
) -> list[dict[str, Any]]:
    """Axes with their measures, in the order of the tables."""
    about: dict[str, Mapping[str, Any]] = {}
    for column in tables.values():
        for table in column:
            about |= {
                name: line for name, line in ((table or {}).get("measures") or {}).items() if name not in about
            }
    groups: dict[str, dict[str, Any]] = {}
    for name, part in (summary.get("measures") or {}).items():
        line = about.get(name, {})
        axis = str(part.get("axis") or line.get("axis") or "")
        whole = (summary.get("axes") or {}).get(axis) or {}
        group = groups.setdefault(axis, {"axis": axis, **_standing(whole, methods), "lines": []})
        group["lines"].append({"name": name, "what": line.get("what") or "", **_standing(part, methods)})
    return list(groups.values())


def _same(one: Image | None, other: Image | None) -> bool:
    if one is None or other is None:
        return one is other
    return one is other or np.array_equal(one.pixels, other.pixels)


def _rows(
    exemplars: Sequence[Image | None],
    images: Mapping[str, Sequence[Image | None]],
    tables: Mapping[str, Sequence[dict[str, Any] | None]],
    items: Sequence[Mapping[str, Any]],
    methods: Sequence[str],
    params: ComparisonReportParams,
) -> list[dict[str, Any]]:
    """One row an item; neighbours with the same exemplar show it once, over ``span`` rows."""

    def picture(image: Image | None) -> _page.Shown | None:
        return None if image is None else _page.shown(image, params.largest, params.quality)

    rows: list[dict[str, Any]] = []
    first = 0
    for index, exemplar in enumerate(exemplars):
        item = items[index] if items else {}
        name = str(item.get("name") or f"item {index + 1}")
        if rows and exemplar is not None and name == rows[first]["name"] and _same(exemplar, exemplars[first]):
            rows[first]["span"] += 1
            shown, span = None, 0
        else:
            first, shown, span = index, picture(exemplar), 1
        cells = [
            {
                "method": method,
                "shown": picture(images[method][index] if method in images else None),
                "scores": ((tables.get(method) or {index: None})[index] or {}).get("summary") or {},
            }
            for method in methods
        ]
        rows.append(
            {
                "name": name,
                "seed": item.get("seed"),
                "sources": item.get("sources") or {},
                "exemplar": shown,
                "span": span,
                "cells": cells,
            }
        )
    return rows


@stage(version=1)
def comparison_report(
    exemplars: list[Image | None],
    images: dict[str, list[Image | None]],
    tables: dict[str, list[dict[str, Any] | None]],
    summary: dict[str, Any],
    params: ComparisonReportParams,
    items: Sequence[Mapping[str, Any]] = (),
    provenance: Sequence[Mapping[str, Any]] = (),
) -> ComparisonReport:
    """Put the results of several methods side by side, with who wins at what.

    Parameters
    ----------
    exemplars : one an item.
    images, tables : method to results and to the tables of `metrics`, one an item, None where the item failed.
    summary : what `compare` says of the tables.
    items : name, seed and sources of each item.
    provenance : the steps upstream, of all items.

    Raises
    ------
    InputError : lists of different lengths.
    """
    count = len(exemplars)
    lists = {f"images.{method}": column for method, column in images.items()}
    lists |= {f"tables.{method}": column for method, column in tables.items()}  # type: ignore[misc]
    lists |= {"items": items} if items else {}  # type: ignore[dict-item]
    for name, column in lists.items():
        if len(column) != count:
            raise InputError(f"{name} has {len(column)} entries, exemplars has {count}")
    methods = list(dict.fromkeys([*(summary.get("methods") or []), *images, *tables]))
    axes = dict.fromkeys(
        axis for column in tables.values() for table in column for axis in (table or {}).get("summary") or {}
    )
    page = _page.render(
        __file__,
        title=params.title,
        methods=methods,
        count=count,
        failed={method: failed for method, failed in (summary.get("failed") or {}).items() if failed},
        overall=_standing(summary.get("overall") or {}, methods),
        groups=_standings(summary, methods, tables),
        plot=plots.paired_scores(
            {
                axis: {
                    method: [((table or {}).get("summary") or {}).get(axis) for table in column]
                    for method, column in tables.items()
                }
                for axis in axes
            }
        ),
        rows=_rows(exemplars, images, tables, items, methods, params),
        steps=_page.steps(provenance),
    )
    return ComparisonReport(page)
