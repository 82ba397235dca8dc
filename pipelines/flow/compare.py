"""Several flows over one set, as one flow: their results side by side, their scores compared."""

from __future__ import annotations

import dataclasses
import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from texloom.pipelines.errors import closest, one_line
from texloom.pipelines.flow.loader import find_flow, load_flow
from texloom.pipelines.flow.model import Flow, Overrides, Reference, Step
from texloom.stages.declare import InputError, find_stage

Gathered = Mapping[str, Reference | Mapping[str, Reference]]
PAGE, TABLE = "comparison.html", "comparison.json"


def comparison_flow(
    flows: Sequence[str],
    over: str,
    params: Mapping[str, str],
    seed: int | None,
    seeds: int,
    runner: Mapping[str, Any] | None = None,
) -> Flow:
    """A flow that runs each of ``flows`` over the files of the pattern ``over`` and compares what they export.

    A flow takes part by the first picture and the first table among its exports.

    Parameters
    ----------
    params : ``STEP.PARAM`` to a YAML value, for all flows that have the step.
    runner : see `texloom.pipelines.flow.model.Overrides`.

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
    plain = [load_flow(path) for path in paths]
    source = _common_source(plain)
    for target in params:
        if not any(target.partition(".")[0] in flow.steps for flow in plain):
            hint = closest(target.partition(".")[0], {step for flow in plain for step in flow.steps})
            raise InputError(f"--set {target}: no flow has a step '{target.partition('.')[0]}'{hint}")
    opened = [
        load_flow(path, Overrides({source: over}, _of(flow, params), seed, seeds, runner or {}))
        for path, flow in zip(paths, plain, strict=True)
    ]
    labels = _labels(opened)
    steps: dict[str, Step] = {}
    for label, flow in zip(labels, opened, strict=True):
        steps |= {step.name: step for step in (_renamed(step, label) for step in flow.steps.values())}
    images = {label: _exported(flow, ".png", label) for label, flow in zip(labels, opened, strict=True)}
    tables = {label: _exported(flow, ".json", label) for label, flow in zip(labels, opened, strict=True)}
    regularity = _regularity(source, images)
    steps |= regularity
    more = {label: Reference(f"{label}_regularity", "table") for label in labels}
    steps["compare"] = _step("compare", "evaluation.compare", {}, {"tables": tables, "more": more})
    pictures: Gathered = {"exemplars": Reference(source), "images": images}
    steps["page"] = _step(
        "page", "evaluation.comparison_report", {"summary": Reference("compare", "table")}, pictures
    )
    exports = {f"{label}.png": reference for label, reference in images.items()}
    exports |= {PAGE: Reference("page", "page"), TABLE: Reference("compare", "table")}
    sources = {name: given for flow in reversed(opened) for name, given in flow.sources.items()}
    return Flow(
        f"compare_{'_'.join(labels)}",
        opened[0].path,
        opened[0].seeds,
        sources,
        steps,
        exports,
        opened[0].runner,
        more_paths=tuple(paths[1:]),
    )


def _step(name: str, stage: str, inputs: Mapping[str, Reference], gather: Gathered | None = None) -> Step:
    found = find_stage(stage)
    return Step(name, found, inputs, found.params(), gather or {}, "final" if gather else "item")


def _regularity(source: str, images: Mapping[str, Reference]) -> dict[str, Step]:
    """How well each method keeps the exemplar's lattice, which all are judged by."""
    exemplar = Reference(source)
    steps = [
        _step("compare_offsets", "analysis.offset_statistics", {"image": exemplar}),
        _step(
            "compare_lattice",
            "analysis.lattice",
            {"image": exemplar, "density": Reference("compare_offsets", "density")},
        ),
    ]
    generators = Reference("compare_lattice", "generators")
    for label, image in images.items():
        inputs = {"exemplar": exemplar, "image": image, "generators": generators}
        steps.append(_step(f"{label}_regularity", "evaluation.regularity", inputs))
    return {step.name: step for step in steps}


def _common_source(flows: Sequence[Flow]) -> str:
    common = [name for name in flows[0].sources if all(name in flow.sources for flow in flows)]
    if not common:
        raise InputError(f"compare: {flows[0].path} and {flows[-1].path} have no source of the same name")
    return common[0]


def _of(flow: Flow, params: Mapping[str, str]) -> dict[str, str]:
    return {target: value for target, value in params.items() if target.partition(".")[0] in flow.steps}


def _labels(flows: Sequence[Flow]) -> list[str]:
    """A name for each method, from its file's."""
    found: list[str] = []
    for flow in flows:
        stem = re.sub(r"[^a-z0-9_]+", "_", Path(flow.path).stem.lower()).strip("_")[:24] or "method"
        stem = stem if stem[0].isalpha() else f"m{stem}"
        same = sum(other == stem or other.rpartition("_")[0] == stem for other in found)
        found.append(f"{stem}_{same + 1}" if stem in found else stem)
    return found


def _renamed(step: Step, label: str) -> Step:
    def renamed(reference: Reference) -> Reference:
        return reference if reference.output is None else Reference(f"{label}_{reference.name}", reference.output)

    if step.gather:
        raise InputError(f"compare: step '{step.name}' gathers; only flows that make one result can be compared")
    inputs = {name: renamed(reference) for name, reference in step.inputs.items()}
    return dataclasses.replace(step, name=f"{label}_{step.name}", inputs=inputs, draws_as=step.draws_as)


def _exported(flow: Flow, suffix: str, label: str) -> Reference:
    for file, reference in flow.exports.items():
        if file.endswith(suffix) and reference.output is not None:
            return Reference(f"{label}_{reference.name}", reference.output)
    raise InputError(f"{flow.where('exports')}: there must be a {suffix} file of a step's output, to compare by")
