"""Texture sequences of several methods, side by side."""

import dataclasses
from collections.abc import Mapping, Sequence
from functools import partial
from typing import Any

from pydantic import Field

from texloom.stages.evaluation._pages import page
from texloom.stages.evaluation._pages.gathered import require_length
from texloom.stages.vocabulary.arrays import Image, Page
from texloom.stages.vocabulary.declare import InputError, Params, stage


class SequenceMethodsParams(Params):
    """What the page shows."""

    title: str = "Texture sequences"
    """heading of the page"""
    largest: int = Field(2048, ge=16, le=16383)
    """longest side of a strip in the page, px; larger ones are reduced"""
    quality: int = Field(90, ge=1, le=100)
    """of the pictures' lossy compression"""


@dataclasses.dataclass(frozen=True)
class SequenceMethods:
    """The comparison."""

    table: dict[str, Any]
    """see `sequence_methods`; ready for JSON"""
    page: Page
    """a row a method: its scores, and the exemplar with all generations"""


@stage(version=1)
def sequence_methods(
    strips: dict[str, list[Image | None]],
    tables: dict[str, list[dict[str, Any] | None]],
    items: list[dict[str, Any]],
    params: SequenceMethodsParams,
    provenance: Sequence[Mapping[str, Any]] = (),
) -> SequenceMethods:
    """Show what each method loses when its results become its exemplars.

    Parameters
    ----------
    strips, tables : method to strips and tables of the last generation of `sequence`, one an item, None where the
        item failed.

    Returns
    -------
    ``methods``; ``rows``, one an item: ``name``, ``seed``, and ``results`` by method: null where it failed, else
    ``first``, ``last`` and ``mean``, by axis the score of the first and the last generation, and the mean of all.

    Raises
    ------
    InputError : lists of different lengths, different methods in strips and tables, or tables without curves.

    References
    ----------
    [Kaspar2015]_ section 4, Figure 8, where methods are compared in this way by eye.
    """
    methods = list(tables)
    if set(strips) != set(tables):
        raise InputError(f"strips has {', '.join(strips)}, tables has {', '.join(tables)}: name the same methods")
    require_length(len(items), "items", strips=strips, tables=tables)
    rows = [
        {
            "name": item["name"],
            "seed": item.get("seed"),
            "results": {method: _result(tables[method][index], f"tables.{method}") for method in methods},
        }
        for index, item in enumerate(items)
    ]
    shown = partial(page.shown, largest=params.largest, quality=params.quality)
    axes = list(
        dict.fromkeys(
            axis for row in rows for result in row["results"].values() if result for axis in result["mean"]
        )
    )
    html = page.render(
        page.template_of(__file__),
        params.title,
        provenance,
        methods=methods,
        axes=axes,
        rows=[
            {**row, "strips": {method: shown(strips[method][index]) for method in methods}}
            for index, row in enumerate(rows)
        ],
    )
    return SequenceMethods({"methods": methods, "rows": rows}, html.page)


def _result(table: dict[str, Any] | None, where: str) -> dict[str, Any] | None:
    """Scores of the first and the last generation, and their means."""
    if table is None:
        return None
    if not isinstance(table.get("summary"), dict) or not isinstance(table.get("means"), dict):
        raise InputError(f"{where}: has no curves; give the table of a sequence")
    curves = table["summary"]
    return {
        "first": {axis: curve[0] for axis, curve in curves.items()},
        "last": {axis: curve[-1] for axis, curve in curves.items()},
        "mean": table["means"],
    }
