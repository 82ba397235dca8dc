"""The page on which a person judges contours, features and guidance over a set of exemplars."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from pydantic import Field

from texloom.stages.evaluation._pages import page
from texloom.stages.evaluation._pages.gathered import item_at, require_length
from texloom.stages.vocabulary.arrays import Image, Mask, ScalarMap
from texloom.stages.vocabulary.color import linear_from_srgb
from texloom.stages.vocabulary.declare import InputError, Params, stage


class ContourReportParams(Params):
    """What the page shows."""

    title: str = "Contours"
    """heading of the page"""
    largest: int = Field(512, ge=16, le=16383)
    """longest side of the pictures in the page, px; larger ones are reduced"""
    quality: int = Field(85, ge=1, le=100)
    """of the lossy compression of exemplars and contours; features and guidance are lossless"""


@stage(version=1)
def contour_report(
    exemplars: list[Image | None],
    strengths: dict[str, list[ScalarMap | None]],
    structures: dict[str, list[Mask | None]],
    distances: dict[str, list[ScalarMap | None]],
    weights: dict[str, list[float | None]],
    params: ContourReportParams,
    items: Sequence[Mapping[str, Any]] = (),
    provenance: Sequence[Mapping[str, Any]] = (),
) -> page.ReportPage:
    """Show exemplars beside the contours that detectors find, and the features and guidance made of them.

    Parameters
    ----------
    exemplars : one an item, None where the item failed.
    strengths : detector to contour strength, 0..1, one an item; see `edges`.
    structures : detector to features, true there; see `otsu`.
    distances : detector to signed distance to features, px; see `signed_distance`.
    weights : detector to the factor on guidance; see `guidance_weight`.
    items : name, seed and sources of each item.
    provenance : the steps upstream, of all items.

    Raises
    ------
    InputError : lists of different lengths, or not the same detectors in all.
    """
    detectors = list(strengths)
    inputs: dict[str, Mapping[str, Sequence[Any]]] = {
        "strengths": strengths, "structures": structures, "distances": distances, "weights": weights,
    }  # fmt: skip
    for name, columns in inputs.items():
        if list(columns) != detectors:
            raise InputError(f"{name} is of {', '.join(columns)}, strengths of {', '.join(detectors)}")
    require_length(len(exemplars), "exemplars", **inputs)
    rows = [
        {
            **item_at(items, index),
            "exemplar": page.shown(exemplar, params.largest, params.quality),
            "cells": {
                detector: _cell(params, *(columns[detector][index] for columns in inputs.values()))
                for detector in detectors
            },
        }
        for index, exemplar in enumerate(exemplars)
    ]
    return page.render(
        page.template_of(__file__),
        params.title,
        provenance,
        detectors=detectors,
        rows=rows,
    )


def _cell(
    params: ContourReportParams,
    strength: ScalarMap | None,
    structure: Mask | None,
    distance: ScalarMap | None,
    weight: float | None,
) -> dict[str, Any]:
    """What one detector finds in one exemplar; None for missing pictures."""
    reach = 0.0 if distance is None else float(np.abs(distance).max())
    contours = None
    if strength is not None:  # 0 is black on the screen, 1 white
        contours = Image(np.asarray(linear_from_srgb(strength), np.float32)[..., None], ("Y",))
    return {
        "contours": page.shown(contours, params.largest, params.quality),
        "features": None if structure is None else page.shown_structure(structure, params.largest),
        "guidance": None if distance is None else page.shown_field(distance, 0.0, reach or 1.0, params.largest),
        "share": None if structure is None else float(structure.mean()),
        "reach": reach,
        "weight": weight,
    }
