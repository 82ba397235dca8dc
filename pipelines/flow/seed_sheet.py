"""Several seeds of a flow: one picture of all results."""

from __future__ import annotations

import dataclasses
from pathlib import Path

from texloom.pipelines.flow.loader import load_flow
from texloom.pipelines.flow.model import Flow, Overrides, Reference, Step
from texloom.pipelines.store.types import Hint
from texloom.stages.lookup.registry import find_stage
from texloom.stages.vocabulary.arrays import Image

SHEET = "contact_sheet.png"


def open_flow(path: Path, overrides: Overrides) -> Flow:
    """Load a flow; with several seeds, it also exports `SHEET`: the first image that each item exports, all in one.

    A flow that exports no image of an item, or uses these names for something else, has none.
    """
    flow = load_flow(path, overrides)
    reference = next((export for export in flow.exports.values() if _is_image_of_item(flow, export)), None)
    names = {*flow.sources, *flow.steps, *flow.exports}
    if len(flow.seeds) < 2 or reference is None or names & {"thumbnail", "contact_sheet", SHEET}:
        return flow
    thumbnail, sheet = find_stage("evaluation.thumbnail"), find_stage("evaluation.contact_sheet")
    images = {"images": Reference("thumbnail", "image")}
    steps = {
        "thumbnail": Step("thumbnail", thumbnail, {"image": reference}, thumbnail.params(), scope="item"),
        "contact_sheet": Step("contact_sheet", sheet, {}, sheet.params(), images, scope="final"),
    }
    exports = {SHEET: Reference("contact_sheet", "image")}
    return dataclasses.replace(flow, steps={**flow.steps, **steps}, exports={**flow.exports, **exports})


def _is_image_of_item(flow: Flow, reference: Reference) -> bool:
    if reference.output is None:
        return False
    step = flow.steps[reference.name]
    return step.scope == "item" and Hint.of(step.stage.outputs[reference.output]).plain is Image
