"""Regularity preservation: which results keep the exemplar's lattice, and what share of each method's do."""

import dataclasses
from collections.abc import Mapping, Sequence
from functools import partial
from typing import Any

from pydantic import Field

from texloom.stages.evaluation._measures.table import csv_text, rounded
from texloom.stages.evaluation._pages import page
from texloom.stages.evaluation._pages.gathered import Scores, measures_of, require_length
from texloom.stages.vocabulary.arrays import Image, Page, Spreadsheet
from texloom.stages.vocabulary.declare import InputError, Params, stage

_KINDS = ("regular", "near-regular")
_MEASURES = ("recall", "geometry", "appearance", "period")


class RegularityPreservationParams(Params):
    """When regularity is preserved, and what the page shows."""

    recall: float = Field(0.875, ge=0, le=1)
    """lowest score of `recall`: whether the result's lattice is complete"""
    uneven: float = Field(1.4, ge=1, le=10)
    """largest unevenness of a lattice that counts as even, relative to the exemplar's"""
    even: float = Field(0.04, ge=0, le=0.2)
    """unevenness that is always invisible, as a share of a cell's length"""
    alike: float = Field(0.3, ge=0, le=1)
    """exemplars whose cells differ by less are regular, not near-regular; as a share of the picture's variation"""
    undetected: bool = True
    """count exemplars in which no lattice is detected as near-regular ones whose regularity no method preserves, as
    the paper does; false leaves them out"""
    title: str = "Regularity preservation"
    """heading of the page"""
    largest: int = Field(512, ge=16, le=16383)
    """longest side of the pictures in the page, px; larger ones are reduced"""
    quality: int = Field(90, ge=1, le=100)
    """of the pictures' lossy compression"""


@dataclasses.dataclass(frozen=True)
class RegularityPreservation:
    """The tables."""

    table: dict[str, Any]
    """see `regularity_preservation`; ready for JSON"""
    csv: Spreadsheet
    """a row a result: name, seed, kind, method, preserved, scores, and unevenness relative to the exemplar's"""
    page: Page
    """both tables, and all pictures side by side"""


@stage(version=2)
def regularity_preservation(
    exemplars: list[Image | None],
    images: dict[str, list[Image | None]],
    tables: dict[str, list[dict[str, Any] | None]],
    items: list[dict[str, Any]],
    params: RegularityPreservationParams,
    provenance: Sequence[Mapping[str, Any]] = (),
) -> RegularityPreservation:
    """Decide for every result whether the exemplar's regularity is preserved; count how often each method does.

    It is preserved where the lattice is detected nearly as complete and as even as in the exemplar, in which bricks
    of a wall or canes of a basket are displaced too. A method that fails on an exemplar has not preserved its
    regularity, nor has any where the exemplar's lattice is not detected.

    Parameters
    ----------
    exemplars : one an item.
    images, tables : method to results and to the tables of `regularity`, one an item, None where the item failed.

    Returns
    -------
    ``methods``; ``rows``, one an item: ``name``, ``seed``, ``kind`` (``regular``, ``near-regular`` or null), and
    ``results`` by method: ``preserved``, ``made``, the ``scores`` and ``uneven``, the unevenness relative to the
    exemplar's; ``kinds``: for each kind the number of ``exemplars``, and ``methods``: by method the number
    ``preserved`` and its ``rate``.

    Raises
    ------
    InputError : lists of different lengths, different methods in images and tables, or tables without scores.

    References
    ----------
    [Lin2004]_ Tables 2 and 3, where people judge. The bounds are ours, set by looking at results so that rows of
    unequal height or a shifted column do not pass.
    """
    methods = list(tables)
    if set(images) != set(tables):
        raise InputError(f"images has {', '.join(images)}, tables has {', '.join(tables)}: name the same methods")
    require_length(len(items), "items", exemplars=exemplars, images=images, tables=tables)
    rows: list[dict[str, Any]] = []
    for index, item in enumerate(items):
        lines = {method: measures_of(tables[method][index], f"tables.{method}") for method in methods}
        rows.append(
            {
                "name": item["name"],
                "seed": item.get("seed"),
                "kind": _kind(list(lines.values()), params),
                "results": {method: _result(lines[method], params) for method in methods},
            }
        )
    kinds = {kind: _rates([row for row in rows if row["kind"] == kind], methods) for kind in _KINDS}
    shown = partial(page.shown, largest=params.largest, quality=params.quality)
    html = page.render(
        page.template_of(__file__),
        params.title,
        provenance,
        bounds={"recall": params.recall, "uneven": params.uneven, "even": params.even},
        methods=methods,
        kinds=kinds,
        rows=[
            {
                **row,
                "number": index + 1,
                "exemplar": shown(exemplars[index]),
                "images": {method: shown(images[method][index]) for method in methods},
            }
            for index, row in enumerate(rows)
        ],
    )
    return RegularityPreservation({"methods": methods, "rows": rows, "kinds": kinds}, _csv(rows), html.page)


def _kind(lines: Sequence[Scores | None], params: RegularityPreservationParams) -> str | None:
    """The kind of an exemplar by how much its cells differ; None where it has no lattice and does not count."""
    differences = [one["appearance"]["floor"] for one in lines if one is not None and "appearance" in one]
    known = [difference for difference in differences if difference is not None]
    if not known:
        return _KINDS[1] if params.undetected else None
    return _KINDS[known[0] >= params.alike]


def _result(lines: Scores | None, params: RegularityPreservationParams) -> dict[str, Any]:
    """Whether a result preserves regularity, and its scores; one that was not made does not."""
    if lines is None:
        return {"preserved": False, "made": False, "scores": {}, "uneven": None}
    scores = {name: lines[name]["score"] for name in _MEASURES if name in lines}
    value, floor = (lines.get("geometry", {}).get(key) for key in ("value", "floor"))
    is_even = value is not None and floor is not None and value <= max(params.uneven * floor, params.even)
    return {
        "preserved": is_even and (scores.get("recall") or 0) >= params.recall,
        "made": True,
        "scores": scores,
        "uneven": None if value is None or not floor else rounded(value / floor),
    }


def _rates(rows: Sequence[Mapping[str, Any]], methods: Sequence[str]) -> dict[str, Any]:
    preserved = {method: sum(row["results"][method]["preserved"] for row in rows) for method in methods}
    return {
        "exemplars": len(rows),
        "methods": {
            method: {"preserved": count, "rate": rounded(count / len(rows)) if rows else None}
            for method, count in preserved.items()
        },
    }


def _csv(rows: Sequence[Mapping[str, Any]]) -> str:
    lines = [["name", "seed", "kind", "method", "preserved", *_MEASURES, "uneven"]]
    for row in rows:
        for method, result in row["results"].items():
            preserved = "" if row["kind"] is None else ("yes" if result["preserved"] else "no")
            scores = map(result["scores"].get, _MEASURES)
            lines.append([row["name"], row["seed"], row["kind"], method, preserved, *scores, result["uneven"]])
    return csv_text(lines)
