"""Comparisons: several flows over one set as one flow, with a report of their results and scores."""

from __future__ import annotations

import dataclasses
import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from texloom.pipelines.errors import one_line, refused
from texloom.pipelines.flow.loader import check_flow, find_flow, load_flow
from texloom.pipelines.flow.model import Flow, Overrides
from texloom.stages.declare import InputError

EXPORTS = {
    "comparison.html": "page.page",
    "comparison.csv": "compare.csv",
    "comparison.json": "compare.table",
}
"""file name to what is written to it"""
_SIZE = "size"  # the param that flows declare for the size of their result


def comparison_flow(flows: Sequence[str], overrides: Overrides, over: str | None = None) -> Flow:
    """A flow that runs each of ``flows`` over a set of exemplars and compares what they export.

    A flow takes part by the first picture and the first table among its exports. All results have one size, by
    default that of the first flow, and are judged by one lattice, that of the exemplar.

    Parameters
    ----------
    overrides : each param must reach all flows, or name a step of one, as in ``quilting_texture.block``.
    over : the pattern of the exemplars; without it, ``overrides`` gives the sources by name.

    Raises
    ------
    InputError : a flow or param is wrong, results would differ in size, or the flows have no source in common.
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
    flow = check_flow(document, Path("compare"), _with_one_size(opened, overrides))
    _check_sizes(flow)
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
            "params": {"title": f"Comparison of {_listed(list(flows))}"},
        },
    }
    for flow in flows.values():
        for name, step in flow.steps.items():
            if step.gather:
                raise InputError(f"compare: step '{name}' gathers; only flows that make one result can be compared")
            if name in steps:
                raise InputError(f"{flow.where('steps', name)}: a comparison has a step of this name")
    return {"flow": f"compare_{'_'.join(flows)}"[:64], "for": variants, "steps": steps, "exports": EXPORTS}


def _with_one_size(flows: Sequence[Flow], overrides: Overrides) -> Overrides:
    """The overrides with the first flow's size, where no other is given and flows declare different ones."""
    sizes = [_sizes(flow) for flow in flows]
    if _SIZE in overrides.params or not all(sizes) or len({size for own in sizes for size in own.values()}) < 2:
        return overrides
    height, width = next(iter(sizes[0].values()))
    return dataclasses.replace(overrides, params={_SIZE: f"{height}x{width}", **overrides.params})


def _sizes(flow: Flow) -> dict[str, tuple[int, int]]:
    """``STEP.PARAM`` to the size there, of those that the flow's size stands for."""
    targets = [target.partition(".") for target in flow.params.get(_SIZE, ())]
    sizes = {f"{step}.{param}": getattr(flow.steps[step].params, param) for step, _, param in targets}
    return {target: size for target, size in sizes.items() if size is not None}


def _check_sizes(flow: Flow) -> None:
    """Results of different sizes cannot be compared."""
    sizes = _sizes(flow)
    if len(set(sizes.values())) > 1:
        each = ", ".join(f"{target} {height}x{width}" for target, (height, width) in sizes.items())
        raise refused(f"compare: all results must have one size, got {each}; give it with --size")


def _listed(names: Sequence[str]) -> str:
    return f"{', '.join(names[:-1])} and {names[-1]}"


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
