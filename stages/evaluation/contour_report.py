"""The page on which a person judges contours, features and guidance over a set of exemplars."""

import dataclasses
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from pydantic import Field

from texloom.stages.arrays import Image, Mask, Page, ScalarMap
from texloom.stages.color import linear_from_srgb
from texloom.stages.declare import InputError, Params, stage
from texloom.stages.evaluation._pages import page as _page


class ContourReportParams(Params):
    """What the page shows."""

    title: str = "Contours"
    """what stands above"""
    largest: int = Field(512, ge=16, le=16383)
    """longest side of the pictures in the page, px; larger ones are reduced"""
    quality: int = Field(85, ge=1, le=100)
    """of the compression of exemplars and contours; masks and guidance are kept without loss"""


@dataclasses.dataclass(frozen=True)
class ContourReport:
    """The page."""

    page: Page
    """all pictures are inside; it needs no network"""


def _grey(strength: ScalarMap) -> Image:
    """The strength as brightness on the screen: 0 is black, 1 white."""
    return Image(np.asarray(linear_from_srgb(strength), np.float32)[..., None], ("Y",))


def _cell(
    strength: ScalarMap | None,
    mask: Mask | None,
    field: ScalarMap | None,
    weight: float | None,
    params: ContourReportParams,
) -> dict[str, Any]:
    """What one detector made of one exemplar; pictures of what is missing are None."""
    reach = 0.0 if field is None else float(np.abs(field).max())
    return {
        "contours": None if strength is None else _page.shown(_grey(strength), params.largest, params.quality),
        "features": None if mask is None else _page.shown_mask(mask, params.largest),
        "guidance": None if field is None else _page.shown_field(field, 0.0, reach or 1.0, params.largest),
        "share": None if mask is None else float(mask.mean()),
        "reach": reach,
        "weight": weight,
    }


@stage(version=1)
def contour_report(
    exemplars: list[Image | None],
    strengths: dict[str, list[ScalarMap | None]],
    masks: dict[str, list[Mask | None]],
    fields: dict[str, list[ScalarMap | None]],
    weights: dict[str, list[float | None]],
    params: ContourReportParams,
    items: Sequence[Mapping[str, Any]] = (),
    provenance: Sequence[Mapping[str, Any]] = (),
) -> ContourReport:
    """Put exemplars beside what detectors find in them, and what becomes of it in guidance.

    Parameters
    ----------
    exemplars : one an item, None where the item failed.
    strengths : detector to contour strength, 0..1, one an item; see `edges`.
    masks : detector to features; see `otsu`.
    fields : detector to signed distance to features, px; see `signed_distance`.
    weights : detector to the factor on guidance; see `guidance_weight`.
    items : name, seed and sources of each item.
    provenance : the steps upstream, of all items.

    Raises
    ------
    InputError : lists of different lengths, or not the same detectors in all.
    """
    detectors = list(strengths)
    given: dict[str, Mapping[str, Sequence[Any]]] = {
        "strengths": strengths, "masks": masks, "fields": fields, "weights": weights,
    }  # fmt: skip
    for name, columns in given.items():
        if list(columns) != detectors:
            raise InputError(f"{name} is of {', '.join(columns)}, strengths of {', '.join(detectors)}")
        for detector, column in columns.items():
            if len(column) != len(exemplars):
                raise InputError(f"{name}.{detector} has {len(column)} entries, exemplars has {len(exemplars)}")
    rows = []
    for index, exemplar in enumerate(exemplars):
        item = items[index] if items else {}
        cells = {
            detector: _cell(
                strengths[detector][index],
                masks[detector][index],
                fields[detector][index],
                weights[detector][index],
                params,
            )
            for detector in detectors
        }
        rows.append(
            {
                "name": str(item.get("name") or f"item {index + 1}"),
                "sources": item.get("sources") or {},
                "exemplar": None if exemplar is None else _page.shown(exemplar, params.largest, params.quality),
                "cells": cells,
            }
        )
    page = _page.render(
        __file__,
        title=params.title,
        detectors=detectors,
        rows=rows,
        legend=_page.legend_colors(),
        steps=_page.steps(provenance),
    )
    return ContourReport(page)
