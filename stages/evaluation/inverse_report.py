"""The page on which a person looks through a set of compactions."""

from collections.abc import Mapping, Sequence
from typing import Any

from pydantic import Field

from texloom.stages.evaluation._pages import page
from texloom.stages.evaluation._pages.curve import energy_curve
from texloom.stages.evaluation._pages.gathered import (
    Scores,
    item_at,
    mean_of,
    measures_of,
    require_length,
    seconds_by_step,
)
from texloom.stages.vocabulary.arrays import Image
from texloom.stages.vocabulary.declare import Params, stage
from texloom.stages.vocabulary.sizes import format_size


class InverseReportParams(Params):
    """What the page shows."""

    title: str = "Compactions"
    """heading of the page"""
    largest: int = Field(384, ge=16, le=16383)
    """longest side of the pictures in the page, px; larger ones are reduced"""
    quality: int = Field(85, ge=1, le=100)
    """of the lossy compression of pictures that are reduced; smaller ones are lossless"""


@stage(version=1)
def inverse_report(
    pictures: dict[str, list[Image | None]],
    energies: list[list[dict[str, Any]] | None],
    tables: list[dict[str, Any] | None],
    params: InverseReportParams,
    items: Sequence[Mapping[str, Any]] = (),
    provenance: Sequence[Mapping[str, Any]] = (),
) -> page.ReportPage:
    """Show a set of textures with their compactions and energies.

    Parameters
    ----------
    pictures : label to one picture an item, in this order; None where the item failed or has none. The table shows
        the sizes of ``texture`` and ``compaction`` if they are among the labels.
    energies : the rounds of each compaction, see `compact`.
    tables : of `summary_scores`, one an item.
    items : name, seed and sources of each item.
    provenance : the steps upstream, of all items, with their seconds.

    Raises
    ------
    InputError : lists of different lengths; tables without scores.
    """
    require_length(len(tables), "tables", pictures=pictures, energies=energies)
    if items:
        require_length(len(tables), "tables", items=items)
    lines = [measures_of(table, f"tables: entry {index + 1}") or {} for index, table in enumerate(tables)]
    known = {name: line for own in lines for name, line in own.items()}
    methods = [name for name, line in known.items() if line["axis"] == "energy"]
    seconds = seconds_by_step(provenance)
    rows = []
    for index, own in enumerate(lines):
        item = item_at(items, index)
        rounds = energies[index] or []
        steps = {step: by_item[item["name"]] for step, by_item in seconds.items() if item["name"] in by_item}
        rows.append(
            {
                **item,
                "sizes": [_size(pictures, label, index) for label in ("texture", "compaction")],
                "lines": own,
                "best": _lowest(own, methods),
                "cells": [
                    {"label": label, "shown": _shown(column[index], params)} for label, column in pictures.items()
                ],
                "curve": energy_curve(rounds),
                "rounds": len(rounds),
                "last": rounds[-1].get("energy") if rounds else None,
                "steps": steps,
                "seconds": sum(steps.values()) if steps else None,
            }
        )
    return page.render(
        page.template_of(__file__),
        params.title,
        provenance,
        rows=rows,
        failed=sum(table is None for table in tables),
        methods=methods,
        others=[name for name in known if name not in methods],
        meanings={name: line.get("what") or "" for name, line in known.items()},
        means={name: mean_of(own[name]["value"] for own in lines if name in own) for name in known},
        wins={name: sum(row["best"] == name for row in rows) for name in methods},
        seconds=mean_of(row["seconds"] for row in rows),
    )


def _size(images: Mapping[str, Sequence[Image | None]], label: str, index: int) -> str:
    image = images[label][index] if label in images else None
    return "–" if image is None else format_size(image)


def _lowest(lines: Scores, methods: Sequence[str]) -> str | None:
    """The method of the lowest energy; None where there are fewer than two to choose from."""
    energies = {method: lines[method]["value"] for method in methods if method in lines}
    return min(energies, key=lambda method: energies[method]) if len(energies) > 1 else None


def _shown(image: Image | None, params: InverseReportParams) -> page.PagePicture | None:
    is_reduced = image is not None and max(image.height, image.width) > params.largest
    return page.shown(image, params.largest, params.quality if is_reduced else None)
