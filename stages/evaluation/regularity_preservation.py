"""Who keeps regularity: a verdict on every result, and what share of them each method wins."""

import csv
import dataclasses
import io
from collections.abc import Mapping, Sequence
from typing import Any

from pydantic import Field

from texloom.stages.arrays import Image, Page, Spreadsheet
from texloom.stages.declare import InputError, Params, stage
from texloom.stages.evaluation._pages import page as _page
from texloom.stages.evaluation._pages.gathered import measures_of, require_items, rounded

_KINDS = ("regular", "near-regular")
_FIGURES = ("recall", "geometry", "appearance", "period")


class RegularityPreservationParams(Params):
    """What counts as regular, and what the page shows."""

    recall: float = Field(0.875, ge=0, le=1)
    """least score of `recall`: whether the result's lattice is whole"""
    uneven: float = Field(1.4, ge=1, le=10)
    """most unevenness of a lattice that counts as even, by the exemplar's own"""
    even: float = Field(0.04, ge=0, le=0.2)
    """unevenness that is not seen whatever the exemplar's is, by the length of a cell"""
    alike: float = Field(0.3, ge=0, le=1)
    """exemplars whose cells differ by less are regular, not near-regular; as a share of the picture's variation"""
    title: str = "Who keeps regularity"
    """what stands above the page"""
    largest: int = Field(512, ge=16, le=16383)
    """longest side of the pictures in the page, px; larger ones are reduced"""
    quality: int = Field(90, ge=1, le=100)
    """of the pictures' compression"""


@dataclasses.dataclass(frozen=True)
class RegularityPreservation:
    """The tables."""

    table: dict[str, Any]
    """see `regularity_preservation`; ready for JSON"""
    csv: Spreadsheet
    """a line a result: name, seed, kind, method, preserved, the scores, and the unevenness by the exemplar's"""
    page: Page
    """both tables, and all pictures side by side"""


def _verdict(lines: Mapping[str, Any] | None, params: RegularityPreservationParams) -> dict[str, Any]:
    """Whether a result's regularity is preserved, and its scores; a result that was not made is not regular."""
    if lines is None:
        return {"preserved": False, "made": False, "scores": {}, "uneven": None}
    scores = {name: lines[name]["score"] for name in _FIGURES if name in lines}
    value, floor = (lines.get("geometry", {}).get(key) for key in ("value", "floor"))
    even = value is not None and floor is not None and value <= max(params.uneven * floor, params.even)
    return {
        "preserved": even and (scores.get("recall") or 0) >= params.recall,
        "made": True,
        "scores": scores,
        "uneven": None if value is None or not floor else rounded(value / floor),
    }


def _kind(lines: Sequence[Mapping[str, Any] | None], params: RegularityPreservationParams) -> str | None:
    """What kind of exemplar it is by how much its cells differ; None where no lattice is found in it."""
    differences = [one["appearance"]["floor"] for one in lines if one is not None and "appearance" in one]
    known = [difference for difference in differences if difference is not None]
    return None if not known else _KINDS[known[0] >= params.alike]


def _rates(rows: Sequence[Mapping[str, Any]], methods: Sequence[str]) -> dict[str, dict[str, Any]]:
    found = {}
    for method in methods:
        kept = sum(row["verdicts"][method]["preserved"] for row in rows)
        found[method] = {"preserved": kept, "rate": rounded(kept / len(rows)) if rows else None}
    return found


def _csv(rows: Sequence[Mapping[str, Any]]) -> str:
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(["name", "seed", "kind", "method", "preserved", *_FIGURES, "uneven"])
    for row in rows:
        for method, verdict in row["verdicts"].items():
            preserved = "" if row["kind"] is None else ("yes" if verdict["preserved"] else "no")
            scores = [verdict["scores"].get(name) for name in _FIGURES]
            writer.writerow([row["name"], row["seed"], row["kind"], method, preserved, *scores, verdict["uneven"]])
    return text.getvalue()


@stage(version=2)
def regularity_preservation(
    exemplars: list[Image | None],
    images: dict[str, list[Image | None]],
    tables: dict[str, list[dict[str, Any] | None]],
    items: list[dict[str, Any]],
    params: RegularityPreservationParams,
    provenance: Sequence[Mapping[str, Any]] = (),
) -> RegularityPreservation:
    """Say of every result whether the exemplar's regularity is preserved, and how often each method preserves it.

    It is where the lattice is found nearly as whole as in the exemplar, and nearly as even: bricks of a wall or
    canes of a basket lie beside their places in the exemplar too. Exemplars without a lattice are shown but do not
    count; a method that fails on one that has a lattice has not preserved it.

    Parameters
    ----------
    exemplars : one an item.
    images, tables : method to results and to the tables of `regularity`, one an item, None where the item failed.

    Returns
    -------
    ``methods``; ``rows``, one an item: ``name``, ``seed``, ``kind`` (``regular``, ``near-regular`` or null), and
    ``regularity_preservation`` by method: ``preserved``, ``made``, the ``scores`` and ``uneven``, the unevenness
    by the exemplar's; ``kinds``: for each kind the number of ``exemplars``, and by method ``preserved``, their
    number, and ``rate``.

    Raises
    ------
    InputError : lists of different lengths, other methods in one than in the other, or tables without scores.

    References
    ----------
    [Lin2004]_ Tables 2 and 3, where people judge. The bounds are ours, set by looking at results so that rows of
    unequal height or a shifted column do not pass.
    """
    methods = list(tables)
    if set(images) != set(tables):
        raise InputError(f"images has {', '.join(images)}, tables has {', '.join(tables)}: name the same methods")
    require_items(len(exemplars), items, "exemplars")
    for where, gathered in (("images", images), ("tables", tables)):
        for method, column in gathered.items():
            require_items(len(column), items, f"{where}: {method}")
    rows = []
    for index, item in enumerate(items):
        lines = {method: measures_of(tables[method][index], f"tables: {method}") for method in methods}
        rows.append(
            {
                "name": item["name"],
                "seed": item.get("seed"),
                "kind": _kind(list(lines.values()), params),
                "verdicts": {method: _verdict(lines[method], params) for method in methods},
            }
        )
    kinds = {}
    for kind in _KINDS:
        members = [row for row in rows if row["kind"] == kind]
        kinds[kind] = {"exemplars": len(members), "methods": _rates(members, methods)}
    table = {"methods": methods, "rows": rows, "kinds": kinds}

    def shown(image: Image | None) -> _page.Shown | None:
        return None if image is None else _page.shown(image, params.largest, params.quality)

    page = _page.render(
        __file__,
        title=params.title,
        bounds={"recall": params.recall, "uneven": params.uneven, "even": params.even},
        methods=methods,
        kinds=kinds,
        rows=[
            {
                **row,
                "number": index + 1,
                "exemplar": shown(exemplar),
                "images": {name: shown(images[name][index]) for name in methods},
            }
            for index, (row, exemplar) in enumerate(zip(rows, exemplars, strict=True))
        ],
        steps=_page.steps(provenance),
    )
    return RegularityPreservation(table, _csv(rows), page)
