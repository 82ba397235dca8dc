"""Several seeds of a flow: one picture of all results."""

from __future__ import annotations

import dataclasses

from texloom.pipelines.flow.model import Flow, Reference, Step
from texloom.pipelines.store.types import Hint
from texloom.stages.arrays import Image
from texloom.stages.declare import find_stage

SHEET = "contact_sheet.png"
_SMALL, _ALL = "thumbnail", "contact_sheet"


def with_contact_sheet(flow: Flow) -> Flow:
    """The flow with one more export, `SHEET`: the first image that each item exports, all in one.

    It stays as it is if it has one seed, exports no image of an item, or uses these names for something else.
    """
    reference = next((given for given in flow.exports.values() if _is_image_of_item(flow, given)), None)
    taken = {*flow.sources, *flow.steps, *flow.exports} & {_SMALL, _ALL, SHEET}
    if len(flow.seeds) < 2 or reference is None or taken:
        return flow
    small, everything = find_stage(f"evaluation.{_SMALL}"), find_stage(f"evaluation.{_ALL}")
    steps = {
        _SMALL: Step(_SMALL, small, {"image": reference}, small.params(), scope="item"),
        _ALL: Step(
            _ALL, everything, {}, everything.params(), {"images": Reference(_SMALL, "image")}, scope="final"
        ),
    }
    exports = {**flow.exports, SHEET: Reference(_ALL, "image")}
    return dataclasses.replace(flow, steps={**flow.steps, **steps}, exports=exports)


def _is_image_of_item(flow: Flow, reference: Reference) -> bool:
    if reference.output is None:
        return False
    step = flow.steps[reference.name]
    return step.scope == "item" and Hint.of(step.stage.outputs[reference.output]).plain is Image
