"""The page on which a person compares methods over a set of exemplars."""

from collections.abc import Mapping, Sequence
from functools import partial
from typing import Any

import numpy as np
from pydantic import Field

from texloom.stages.evaluation._pages import page, plots
from texloom.stages.evaluation._pages.gathered import item_at, require_length
from texloom.stages.vocabulary.arrays import Image
from texloom.stages.vocabulary.declare import Params, stage

_VARYING = ("created", "seconds")  # of provenance, from run to run


class ComparisonReportParams(Params):
    """What the page shows."""

    title: str = "Comparison"
    """heading of the page"""
    largest: int = Field(512, ge=16, le=16383)
    """longest side of the largest result in the page, px; all pictures are reduced by the same factor"""
    quality: int = Field(90, ge=1, le=100)
    """of the pictures' lossy compression, which limits the size of the page"""


@stage(version=3)
def comparison_report(
    exemplars: list[Image | None],
    images: dict[str, list[Image | None]],
    summary: dict[str, Any],
    params: ComparisonReportParams,
    items: Sequence[Mapping[str, Any]] = (),
    provenance: Sequence[Mapping[str, Any]] = (),
) -> page.ReportPage:
    """Show the results of several methods side by side, with their scores, ranks, wins and losses.

    All pictures of the page have one scale. Of an exemplar that is larger than the largest result, the central part
    is shown. The page holds neither times nor dates: the same inputs make the same bytes.

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
    scores = summary.get("scores") or {}
    require_length(len(exemplars), "exemplars", images=images, **{"summary.scores": scores})
    if items:
        require_length(len(exemplars), "exemplars", items=items)
    methods = list(dict.fromkeys([*(summary.get("methods") or []), *images]))
    rows = _rows(exemplars, images, scores, items, methods, params)
    return page.render(
        page.template_of(__file__),
        params.title,
        [{name: entry[name] for name in entry if name not in _VARYING} for entry in provenance],
        methods=methods,
        exemplars=len(summary.get("exemplars") or exemplars),
        failed={method: failed for method, failed in (summary.get("failed") or {}).items() if failed},
        partial=summary.get("partial") or [],
        estimated=summary.get("estimated") or {},
        uneven=sum(row["uneven"] for row in rows),
        leaderboard=summary.get("leaderboard") or [],
        overall=_standing(summary.get("overall") or {}, methods),
        groups=_standings(summary, methods),
        plot=plots.paired_scores(_by_axis(scores)),
        rows=rows,
    )


def _by_axis(scores: Mapping[str, Sequence[Mapping[str, Any] | None]]) -> dict[str, dict[str, list[Any]]]:
    """Axis to method to scores, one an item."""
    known = {method: [own["axes"] if own else {} for own in column] for method, column in scores.items()}
    axes = dict.fromkeys(axis for column in known.values() for own in column for axis in own)
    return {axis: {method: [own.get(axis) for own in column] for method, column in known.items()} for axis in axes}


def _standings(summary: Mapping[str, Any], methods: Sequence[str]) -> list[dict[str, Any]]:
    """Axes with their measures, in the order of the summary; without what no method has."""
    groups: dict[str, dict[str, Any]] = {}
    for name, part in (summary.get("measures") or {}).items():
        line = {"name": name, "what": part.get("what") or "", "values": part.get("values") or {}}
        line |= _standing(part, methods)
        if line["best"]:
            axis = part.get("axis") or ""
            whole = (summary.get("axes") or {}).get(axis) or {}
            groups.setdefault(axis, {"axis": axis, **_standing(whole, methods), "lines": []})["lines"].append(line)
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
        # those that are shown with the same figure as the best
        "best": [
            method for method, mean in means.items() if mean is not None and f"{mean:.2f}" == f"{max(known):.2f}"
        ],
        "rates": {method: (part.get("rates") or {}).get(method) for method in methods},
        "exemplars": part.get("exemplars"),
        "wins": wins if part.get("pairs") else {},
    }


def _rows(
    exemplars: Sequence[Image | None],
    images: Mapping[str, Sequence[Image | None]],
    scores: Mapping[str, Sequence[Mapping[str, Any] | None]],
    items: Sequence[Mapping[str, Any]],
    methods: Sequence[str],
    params: ComparisonReportParams,
) -> list[dict[str, Any]]:
    """One row an item; neighbours with the same exemplar show it once, over ``span`` rows."""
    results = [image for column in images.values() for image in column if image is not None]
    longest = max(
        (max(image.height, image.width) for image in results or exemplars if image is not None), default=1
    )
    shown = partial(_shown, longest=longest, params=params)
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
                "picture": shown(images[method][index]) if method in images else None,
                "scores": (scores[method][index] if method in scores else None) or {},
            }
            for method in methods
        ]
        made = [column[index] for column in images.values()]
        row["uneven"] = len({(image.height, image.width) for image in made if image is not None}) > 1
        rows.append(row)
    return rows


def _shown(image: Image | None, longest: int, params: ComparisonReportParams) -> dict[str, Any] | None:
    """A picture at the scale of the page, where ``longest`` is the longest side of all results, px.

    Returns
    -------
    ``shown``; ``share``, its width relative to ``longest``; ``whole``, whether that is all of the picture.
    """
    if image is None:
        return None
    height, width = (min(side, longest) for side in (image.height, image.width))
    top, left = (image.height - height) // 2, (image.width - width) // 2
    part = image.elsewhere(image.pixels[top : top + height, left : left + width])
    largest = max(1, round(max(height, width) * min(1.0, params.largest / longest)))
    shown = page.shown(part, largest, params.quality)
    whole = (height, width) == (image.height, image.width)
    return {"shown": shown, "share": width / longest, "whole": whole, "size": (image.height, image.width)}


def _same(one: Image | None, other: Image | None) -> bool:
    if one is None or other is None:
        return False
    return one is other or np.array_equal(one.pixels, other.pixels)
