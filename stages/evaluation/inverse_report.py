"""The page on which a person looks through a set of compactions."""

import dataclasses
from collections.abc import Mapping, Sequence
from typing import Any

from pydantic import Field

from texloom.stages.arrays import Image, Page
from texloom.stages.declare import InputError, Params, stage
from texloom.stages.evaluation._pages import page as _page
from texloom.stages.evaluation._pages.curve import energy_curve
from texloom.stages.evaluation._pages.gathered import Scores, mean_of, measures_of


class InverseReportParams(Params):
    """What the page shows."""

    title: str = "Compactions"
    """what stands above"""
    largest: int = Field(384, ge=16, le=16383)
    """longest side of the pictures in the page, px; larger ones are reduced"""
    quality: int = Field(85, ge=1, le=100)
    """of the compression of pictures that are reduced; smaller ones are kept without loss"""


@dataclasses.dataclass(frozen=True)
class InverseReport:
    """The page."""

    page: Page
    """all pictures are inside; it needs no network"""


def _shown(image: Image | None, params: InverseReportParams) -> _page.Shown | None:
    if image is None:
        return None
    reduced = max(image.height, image.width) > params.largest
    return _page.shown(image, params.largest, params.quality if reduced else None)


def _seconds(provenance: Sequence[Mapping[str, Any]]) -> dict[str, dict[str, float]]:
    """Item to step to the seconds that it took."""
    took: dict[str, dict[str, float]] = {}
    for entry in provenance:
        seconds = entry.get("seconds")
        if entry.get("item") is not None and isinstance(seconds, int | float):
            took.setdefault(str(entry["item"]), {})[str(entry.get("step"))] = float(seconds)
    return took


def _size(images: Mapping[str, Sequence[Image | None]], label: str, index: int) -> str:
    image = images[label][index] if label in images else None
    return "–" if image is None else f"{image.height}×{image.width}"


@stage(version=1)
def inverse_report(
    pictures: dict[str, list[Image | None]],
    energies: list[list[dict[str, Any]] | None],
    tables: list[dict[str, Any] | None],
    params: InverseReportParams,
    items: Sequence[Mapping[str, Any]] = (),
    provenance: Sequence[Mapping[str, Any]] = (),
) -> InverseReport:
    """Put a set of textures with their compactions on one page.

    Parameters
    ----------
    pictures : label to one picture an item, None where the item failed or has none; shown in this order. The sizes
        of ``texture`` and ``compaction``, where there are such, stand in the table.
    energies : the rounds of each compaction, see `compact`.
    tables : of `summary_scores`, one an item.
    items : name, seed and sources of each item.
    provenance : the steps upstream, of all items; their seconds are shown.

    Raises
    ------
    InputError : lists of different lengths; tables that have no scores.
    """
    count = len(tables)
    lists: dict[str, Sequence[Any]] = {f"pictures.{label}": column for label, column in pictures.items()}
    lists |= {"energies": energies, **({"items": items} if items else {})}
    for name, column in lists.items():
        if len(column) != count:
            raise InputError(f"{name} has {len(column)} entries, tables has {count}")
    lines = [measures_of(table, f"tables: entry {index + 1}") or {} for index, table in enumerate(tables)]
    axes = {name: line["axis"] for own in lines for name, line in own.items()}
    methods = [name for name, axis in axes.items() if axis == "energy"]
    others = [name for name in axes if name not in methods]
    took = _seconds(provenance)
    rows = [
        _row(index, items[index] if items else {}, pictures, energies[index] or [], own, methods, took, params)
        for index, own in enumerate(lines)
    ]
    page = _page.render(
        __file__,
        title=params.title,
        rows=rows,
        failed=sum(table is None for table in tables),
        methods=methods,
        others=others,
        meanings={name: line.get("what") or "" for own in lines for name, line in own.items()},
        means={name: mean_of(own[name]["value"] if name in own else None for own in lines) for name in axes},
        wins={name: sum(row["best"] == name for row in rows) for name in methods},
        seconds=mean_of(row["seconds"] for row in rows),
        steps=_page.steps(provenance),
    )
    return InverseReport(page)


def _row(
    index: int,
    item: Mapping[str, Any],
    pictures: Mapping[str, Sequence[Image | None]],
    rounds: Sequence[Mapping[str, Any]],
    lines: Scores,
    methods: Sequence[str],
    took: Mapping[str, Mapping[str, float]],
    params: InverseReportParams,
) -> dict[str, Any]:
    """What the page says of one item."""
    name = str(item.get("name") or f"item {index + 1}")
    known = {method: lines[method]["value"] for method in methods if method in lines}
    steps = took.get(name, {})
    cells = [{"label": label, "shown": _shown(column[index], params)} for label, column in pictures.items()]
    return {
        "name": name,
        "seed": item.get("seed"),
        "sources": item.get("sources") or {},
        "sizes": [_size(pictures, label, index) for label in ("texture", "compaction")],
        "lines": lines,
        "best": min(known, key=lambda method: known[method]) if len(known) > 1 else None,
        "cells": cells,
        "curve": energy_curve(rounds),
        "rounds": len(rounds),
        "last": rounds[-1].get("energy") if rounds else None,
        "steps": steps,
        "seconds": sum(steps.values()) if steps else None,
    }
