"""Comparisons: several methods over one set as one flow, with a report of their results and scores."""

from __future__ import annotations

import dataclasses
import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from texloom.pipelines.errors import refused
from texloom.pipelines.flow.items import items_of
from texloom.pipelines.flow.loader import check_flow, find_flow, load_flow
from texloom.pipelines.flow.model import Each, Flow, Overrides
from texloom.pipelines.flow.schema import NAME, REQUIRED
from texloom.pipelines.flow.shipped import plugin_flows, shipped_flows
from texloom.pipelines.media.material_set import pictures_in
from texloom.stages.vocabulary.declare import InputError
from texloom.stages.vocabulary.sizes import format_size, size_value

EXPORTS = {
    "comparison.html": "page.page",
    "comparison.csv": "compare.csv",
    "comparison.json": "compare.table",
}
"""file name to what is written to it"""
_SIZE = "size"  # the param that flows declare for the size of their result
_SCORE, _EXEMPLAR, _PICTURE = "score", "exemplar", "picture"  # the flow that scores pictures, and its sources


@dataclasses.dataclass(frozen=True)
class _ComparedFlow:
    """One of the methods that are compared."""

    flow: Flow
    folder: Path | None = None
    """where the results are, if another program made them; ``flow`` then scores them"""


def comparison_flow(methods: Sequence[str], overrides: Overrides, over: str | None = None) -> Flow:
    """A flow that runs several methods over a set of exemplars and compares what they export.

    A flow takes part by the first picture and the first table among its exports, a folder by a picture for each
    exemplar. All results have one size, by default that of the first flow, and are judged by one lattice, that of
    the exemplar.

    Parameters
    ----------
    methods : flows, and folders of finished pictures as ``NAME=FOLDER``. Pictures are named as the exemplars and
        count for all seeds; see `texloom.stages.evaluation.external_result` for their sizes.
    overrides : each param must reach all methods, or name a step of one, as in ``quilting_texture.block``.
    over : a picture, a folder or a pattern of the exemplars; without it, ``overrides`` gives the sources by name.

    Raises
    ------
    InputError : a flow or param is wrong, results would differ in size, a picture is missing, or the flows have no
        source in common.
    """
    opened = [_opened(name) for name in methods]
    if len(opened) < 2:
        raise InputError("compare: at least two methods are needed")
    compared = [method.flow.path.resolve() for method in opened if not method.folder]
    for path in compared:
        if compared.count(path) > 1:
            raise refused(f"compare: {path} is given twice")
    against = {method.flow.name: method.folder for method in opened if method.folder}
    source = _common_source([method.flow for method in opened if not method.folder]) or _EXEMPLAR
    given = {source: over} if over is not None else overrides.sources
    labels = _labels(opened)
    named = dict(zip(labels, opened, strict=True))
    first = next((method.flow for method in opened if not method.folder), opened[0].flow)
    exemplars = load_flow(first.path, Overrides({name: given[name] for name in given if name == source}))
    pictures = {
        f"{label}_{_PICTURE}": _pictures(label, method.folder, exemplars, source)
        for label, method in named.items()
        if method.folder
    }
    document = _document(named, source, isinstance(exemplars.sources[source], Each))
    overrides = dataclasses.replace(overrides, sources={**given, **pictures})
    flow = check_flow(document, Path("compare"), _with_one_size(opened, overrides))
    _check_sizes(flow)
    return dataclasses.replace(flow, compared=tuple(compared), against=against)


def _opened(name: str) -> _ComparedFlow:
    """A flow, or a folder as ``NAME=FOLDER``."""
    label, equals, folder = name.partition("=")
    if Path(name).is_dir() and name not in shipped_flows():
        raise refused(f"compare: {name} is a folder; give finished pictures with --against NAME={name}")
    if not equals or Path(name).exists():
        return _ComparedFlow(load_flow(find_flow(name)))
    if not NAME.fullmatch(label):
        problem = "must begin with a small letter; small letters, digits and _ may follow"
        raise refused(f"--against {name}: the name {problem}, got {label!r}")
    path = Path(folder).expanduser().absolute()
    if not path.is_dir():
        raise refused(f"--against {name}: {folder} is not a folder")
    return _ComparedFlow(dataclasses.replace(load_flow(shipped_flows()[_SCORE]), name=label), path)


def _pictures(label: str, folder: Path, flow: Flow, source: str) -> str | list[str]:
    """The picture for each exemplar."""
    exemplar = flow.sources[source]
    if isinstance(exemplar, str):
        names = [Path(exemplar.rpartition(":")[2]).stem]
    else:
        names = [item.name for item in items_of(dataclasses.replace(flow, sources={source: exemplar}, seeds=(0,)))]
    there = pictures_in(folder)
    found = []
    for name in names:
        own = [str(path) for path in there if path.stem == name]
        if len(own) != 1:
            problem = f"{len(own)} pictures called '{name}'" if own else f"no picture called '{name}'"
            raise refused(f"--against {label}={folder}: {problem}; there must be one for each exemplar")
        found += own
    return found[0] if isinstance(exemplar, str) else found


def _document(methods: Mapping[str, _ComparedFlow], source: str, is_set: bool) -> dict[str, Any]:
    flows = {label: method.flow for label, method in methods.items()}
    images = {label: _exported(flow, ".png") for label, flow in flows.items()}
    tables = {label: _exported(flow, ".json") for label, flow in flows.items()}
    variants = {
        label: {
            **_included(label, method, source, is_set),
            "steps": {"compare_regularity": {"inputs": {"image": images[label]}}},
            "exports": {f"{label}.png": images[label]},
        }
        for label, method in methods.items()
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
            "params": {
                "origins": {label: origin for label, method in methods.items() if (origin := _origin(method))}
            },
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


def _origin(method: _ComparedFlow) -> str:
    """Where a method is from: the plug-ins of its flow and stages, or the folder of its pictures; else nothing."""
    if method.folder:
        return f"pictures in {method.folder.name}"
    origins = {step.stage.origin for step in method.flow.steps.values()}
    origins |= {origin for path, origin in plugin_flows().values() if path.resolve() == method.flow.path.resolve()}
    return ", ".join(sorted(filter(None, origins)))


def _included(label: str, method: _ComparedFlow, source: str, is_set: bool) -> dict[str, Any]:
    """The flow of a method; the pictures of a folder are a source of their own."""
    path = str(method.flow.path.resolve())
    if not method.folder:
        return {"include": path}
    name = f"{label}_{_PICTURE}"
    inputs = {_PICTURE: name} | ({} if source == _EXEMPLAR else {_EXEMPLAR: source})
    files = {"each": "*", "pair": source} if is_set else REQUIRED
    return {"include": {"flow": path, "inputs": inputs}, "sources": {name: files}}


def _with_one_size(methods: Sequence[_ComparedFlow], overrides: Overrides) -> Overrides:
    """The overrides with the first flow's size, where none is given and all methods take one."""
    sizes = [size for method in methods for size in _sizes(method.flow).values()]
    if _SIZE in overrides.params or not sizes or not all(_SIZE in method.flow.params for method in methods):
        return overrides
    height, width = sizes[0]
    return dataclasses.replace(overrides, params={_SIZE: size_value((height, width)), **overrides.params})


def _sizes(flow: Flow) -> dict[str, tuple[int, int]]:
    """``STEP.PARAM`` to the size there, of those that the flow's size stands for."""
    targets = [target.partition(".") for target in flow.params.get(_SIZE, ())]
    sizes = {
        f"{step}.{param}": getattr(flow.steps[step].params, param)
        for step, _, param in targets
        if step in flow.steps
    }
    return {target: size for target, size in sizes.items() if size is not None}


def _check_sizes(flow: Flow) -> None:
    """Results of different sizes cannot be compared."""
    sizes = _sizes(flow)
    if len(set(sizes.values())) > 1:
        each = ", ".join(f"{target} {format_size((height, width))}" for target, (height, width) in sizes.items())
        raise refused(f"compare: all results must have one size, got {each}; give it with --size")


def _listed(names: Sequence[str]) -> str:
    return f"{', '.join(names[:-1])} and {names[-1]}"


def _common_source(flows: Sequence[Flow]) -> str | None:
    """The first source that all flows have; None without flows."""
    if not flows:
        return None
    common = [name for name in flows[0].sources if all(name in flow.sources for flow in flows)]
    if not common:
        raise InputError(f"compare: {flows[0].path} and {flows[-1].path} have no source of the same name")
    return common[0]


def _labels(methods: Sequence[_ComparedFlow]) -> list[str]:
    """A name for each method, from its file's, or as it is given for a folder."""
    labels: list[str] = []
    for method in methods:
        name = method.flow.name if method.folder else method.flow.path.stem
        stem = re.sub(r"[^a-z0-9_]+", "_", name.lower()).strip("_")[:24] or "method"
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
