"""Comparisons: several flows over one set as one flow, with a report of their results and scores."""

from __future__ import annotations

import dataclasses
import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from texloom.pipelines.errors import one_line
from texloom.pipelines.flow.loader import check_flow, find_flow, load_flow
from texloom.pipelines.flow.model import Flow, Overrides
from texloom.stages.declare import InputError

PAGE, TABLE = "comparison.html", "comparison.json"


def comparison_flow(flows: Sequence[str], overrides: Overrides, over: str | None = None) -> Flow:
    """A flow that runs each of ``flows`` over a set of exemplars and compares what they export.

    A flow takes part by the first picture and the first table among its exports. All results are judged by one
    lattice, that of the exemplar.

    Parameters
    ----------
    overrides : each param must reach all flows, or name a step of one, as in ``quilting_texture.block``.
    over : the pattern of the exemplars; without it, ``overrides`` gives the sources by name.

    Raises
    ------
    InputError : a flow or param is wrong, or the flows have no source in common.
    """
    paths = [find_flow(name) for name in flows]
    if len(paths) < 2:
        raise InputError("compare: at least two flows are needed")
    for name, path in zip(flows, paths, strict=True):
        if [other.resolve() for other in paths].count(path.resolve()) > 1:
            raise InputError(one_line(f"compare: {name} is given twice"))
    opened = [load_flow(path) for path in paths]
    source = _common_source(opened)
    labels = _labels(paths)
    document = _document(dict(zip(labels, opened, strict=True)), source)
    if over is not None:
        overrides = dataclasses.replace(overrides, sources={source: over})
    flow = check_flow(document, Path("compare"), overrides)
    return dataclasses.replace(flow, compared=tuple(path.resolve() for path in paths))


def _document(flows: Mapping[str, Flow], source: str) -> dict[str, Any]:
    images = {label: _exported(flow, ".png") for label, flow in flows.items()}
    tables = {label: _exported(flow, ".json") for label, flow in flows.items()}
    variants = {
        label: {
            "include": str(flow.path.resolve()),
            "steps": {"compare_regularity": {"inputs": {"image": images[label]}}},
            "exports": {f"{label}.png": images[label]},
        }
        for label, flow in flows.items()
    }
    lattice = {"exemplar": source, "generators": "compare_lattice.generators"}
    steps = {
        "compare_offsets": {"stage": "analysis.offset_statistics", "inputs": {"image": source}},
        "compare_lattice": {
            "stage": "analysis.lattice_selection",
            "inputs": {"image": source, "density": "compare_offsets.density"},
        },
        "compare_regularity": {"stage": "evaluation.regularity", "inputs": lattice},
        "compare": {
            "stage": "evaluation.compare",
            "gather": {"tables": {"*": tables}, "more": {"*": "compare_regularity.table"}},
        },
        "page": {
            "stage": "evaluation.comparison_report",
            "inputs": {"summary": "compare.table"},
            "gather": {"exemplars": source, "images": {"*": images}},
        },
    }
    for flow in flows.values():
        for name, step in flow.steps.items():
            if step.gather:
                raise InputError(f"compare: step '{name}' gathers; only flows that make one result can be compared")
            if name in steps:
                raise InputError(f"{flow.where('steps', name)}: a comparison has a step of this name")
    exports = {PAGE: "page.page", TABLE: "compare.table"}
    return {"flow": f"compare_{'_'.join(flows)}"[:64], "for": variants, "steps": steps, "exports": exports}


def _common_source(flows: Sequence[Flow]) -> str:
    common = [name for name in flows[0].sources if all(name in flow.sources for flow in flows)]
    if not common:
        raise InputError(f"compare: {flows[0].path} and {flows[-1].path} have no source of the same name")
    return common[0]


def _labels(paths: Sequence[Path]) -> list[str]:
    """A name for each method, from its file's."""
    labels: list[str] = []
    for path in paths:
        stem = re.sub(r"[^a-z0-9_]+", "_", path.stem.lower()).strip("_")[:24] or "method"
        stem = stem if stem[0].isalpha() else f"m{stem}"
        same = sum(other == stem or other.rpartition("_")[0] == stem for other in labels)
        labels.append(f"{stem}_{same + 1}" if stem in labels else stem)
    return labels


def _exported(flow: Flow, suffix: str) -> str:
    """The first export of a step's output of this kind."""
    for file, reference in flow.exports.items():
        if file.endswith(suffix) and reference.output is not None:
            return str(reference)
    raise InputError(f"{flow.where('exports')}: there must be a {suffix} file of a step's output, to compare by")
