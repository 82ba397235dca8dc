"""Several seeds of a flow: one picture of all results."""

from __future__ import annotations

import dataclasses
from pathlib import Path
from typing import Any

from texloom.pipelines.flow.loader import check_flow, load_flow
from texloom.pipelines.flow.model import Flow, Overrides, Reference
from texloom.pipelines.store.types import Hint
from texloom.stages.arrays import Image

SHEET = "contact_sheet.png"


def open_flow(path: Path, overrides: Overrides) -> Flow:
    """Load a flow; with several seeds, it also exports `SHEET`: the first image that each item exports, all in one.

    A flow that exports no image of an item, or uses these names for something else, has none.
    """
    flow = load_flow(path, overrides)
    reference = next((given for given in flow.exports.values() if _is_image_of_item(flow, given)), None)
    sheet = None if len(flow.seeds) < 2 or reference is None else _with_sheet(flow, reference)
    if sheet is None:
        return flow
    whole = check_flow(sheet, path.with_name("contact_sheet"), overrides)
    return dataclasses.replace(whole, path=flow.path, more_paths=flow.more_paths)


def _with_sheet(flow: Flow, reference: Reference) -> dict[str, Any] | None:
    """The document of a flow that includes ``flow`` and has a sheet."""
    steps = {
        "thumbnail": {"stage": "evaluation.thumbnail", "inputs": {"image": str(reference)}},
        "contact_sheet": {"stage": "evaluation.contact_sheet", "gather": {"images": "thumbnail.image"}},
    }
    if {*flow.sources, *flow.steps, *flow.exports} & {*steps, SHEET}:
        return None
    exports = {SHEET: "contact_sheet.image"}
    return {"flow": flow.name, "include": str(flow.path.resolve()), "steps": steps, "exports": exports}


def _is_image_of_item(flow: Flow, reference: Reference) -> bool:
    if reference.output is None:
        return False
    step = flow.steps[reference.name]
    return step.scope == "item" and Hint.of(step.stage.outputs[reference.output]).plain is Image
