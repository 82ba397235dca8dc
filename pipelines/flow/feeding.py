"""Which sources of a flow give a picture its values, and which only say what is to be made of those."""

from __future__ import annotations

import typing
from collections.abc import Set
from typing import Any

from texloom.pipelines.flow.model import Flow, Reference, Step, flat
from texloom.stages.vocabulary.arrays import Image

_STEERING: Set[str] = {"control", "controls", "features", "layout", "mask", "region", "strokes", "target"}
"""pictures among the inputs of stages that say what goes where"""


def feeding(flow: Flow, reference: Reference) -> set[str]:
    """The sources whose values a picture has, copied, averaged or changed; none of what is no picture."""
    sources: set[str] = set()
    seen: set[Reference] = set()
    left = [reference]
    while left:
        one = left.pop()
        if one in seen:
            continue
        seen.add(one)
        if one.output is None:
            sources.add(one.name)
        else:
            left += _taken(flow.steps[one.name], one.output)
    return sources - flow.kinds.keys()


def _taken(step: Step, output: str) -> list[Reference]:
    """The pictures that those of an output are made of."""
    if not _is_picture(step.stage.outputs.get(output)):
        return []
    steering = {output, f"{output}s"} & _STEERING if output in _STEERING else set()
    names = steering or {name for name in step.stage.inputs if name not in _STEERING}
    gathered = flat({name: given for name, given in step.gather.items() if name in names})
    return gathered + [
        given for name, given in step.inputs.items() if name in names and _is_picture(step.stage.inputs[name])
    ]


def _is_picture(kind: Any) -> bool:
    return kind is Image or Image in typing.get_args(kind)
