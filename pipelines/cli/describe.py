"""What stages and flows there are, in words: read from declarations, docstrings and the comments of flow files."""

from __future__ import annotations

import functools
import inspect
import json
import re
import textwrap
import types
import typing
from pathlib import Path
from typing import Annotated, Any, Literal

import pydantic_core

from texloom.pipelines.flow.loader import find_flow, load_flow, nearest_stage
from texloom.pipelines.flow.model import Each, Flow
from texloom.pipelines.flow.schema import MOST_ROUNDS, OPTIONAL
from texloom.pipelines.flow.shipped import flow_head
from texloom.pipelines.store.types import Hint
from texloom.pipelines.yaml import read_document
from texloom.stages.lookup.registry import find_stage, stage_names
from texloom.stages.vocabulary.declare import Document, InputError, Stage, field_help
from texloom.stages.vocabulary.facts import Wraps
from texloom.stages.vocabulary.sizes import SIDES
from texloom.stages.vocabulary.tileable import NAMES

_WORDS = {
    bool: "true | false", types.NoneType: "null", str: "text", Path: "file", Document: "file",
    Wraps: " | ".join(NAMES),
}  # fmt: skip


def catalogue() -> dict[str, str]:
    """Stage name to summary; of plug-ins with their origin, or why they cannot be imported."""
    return {name: _summary(name) for name in stage_names()}


def _summary(name: str) -> str:
    try:
        stage = find_stage(name)
    except InputError as error:
        return str(error).partition(": ")[2]
    return f"{stage.summary} [{stage.origin}]" if stage.origin else stage.summary


def description(name: str) -> dict[str, Any]:
    """All that is declared of one stage, ready for JSON; `InputError` if there is none."""
    names = stage_names()
    full = next((known for known in names if known == name or known.rpartition(".")[2] == name), name)
    try:
        stage = find_stage(full)
    except KeyError:
        raise InputError(f"no stage '{name}'{nearest_stage(name)}") from None
    sections = _sections(inspect.getdoc(stage.function) or "")
    what = _entries(sections.pop("Parameters", ""))
    references = sections.pop("References", "")
    more = [f"{head}\n{'-' * len(head)}\n{text}" for head, text in sections.items() if head]
    return {
        "name": stage.name,
        "version": stage.version,
        "summary": stage.summary,
        **({"origin": stage.origin} if stage.origin else {}),
        "description": "\n\n".join(filter(None, [sections[""].partition("\n")[2].strip(), *more])),
        "inputs": {
            key: {"type": str(Hint.of(hint)), "optional": key in stage.optional, "what": what.get(key, "")}
            for key, hint in stage.inputs.items()
        },
        "params": _params(stage),
        "outputs": {
            key: {"type": str(Hint.of(hint)), "what": _help_of(stage.result).get(key, "")}  # type: ignore[arg-type]
            for key, hint in stage.outputs.items()
        },
        "uses_seed": stage.uses_rng,
        "references": references,
    }


def flow_description(name: str) -> dict[str, Any]:
    """What there is to give and to change in a flow, ready for JSON; `InputError` if it is not there or wrong."""
    flow = load_flow(find_flow(name))
    return {
        "name": flow.name,
        "file": str(flow.path),
        "description": flow_head(flow.path),
        "sources": {
            key: "required" if key in flow.missing else source.patterns[0] if isinstance(source, Each) else source
            for key, source in flow.sources.items()
        }
        | dict.fromkeys(flow.left_out, OPTIONAL),
        "optional": dict(flow.optional),
        "params": {name: _flow_param(flow, targets) for name, targets in flow.params.items()},
        "steps": {
            key: {"stage": step.stage.name, "summary": step.stage.summary} for key, step in flow.steps.items()
        },
        "exports": {file: str(reference) for file, reference in flow.exports.items()},
        # what is left out unless these sources are given, or unless there is a set
        "steps_with": {
            key: {"stage": step.stage.name, "summary": step.stage.summary, "only_with": list(step.lacks)}
            for key, step in flow.skipped.items()
        },
        "exports_with": {file: list(lacks) for file, lacks in flow.unwritten.items()},
    }


def _flow_param(flow: Flow, targets: tuple[str, ...]) -> dict[str, Any]:
    """What a flow's param changes, and what is declared of it there."""
    step, _, param = targets[0].partition(".")
    if step == "for":
        default = read_document(flow.path)["for"][param]
        what = f"the values of {param} that are compared"
        return {"targets": list(targets), "type": "list", "default": default, "range": "", "what": what}
    if not param:
        given = read_document(flow.path).get(step)
        default = given.get("flow") if isinstance(given, dict) else given
        what = {"include": "the flow whose steps are taken", "repeat": "how often the steps are repeated"}[step]
        kind = {"include": "a flow's name or file", "repeat": f"int >= 1 <= {MOST_ROUNDS}"}[step]
        return {"targets": list(targets), "type": kind, "default": default, "range": "", "what": what}
    known = flow.steps.get(step) or flow.skipped[step]
    declared = _params(known.stage)[param]
    default = known.params.model_dump(mode="json")[param]
    return {"targets": list(targets), **declared, "default": default}


def _sections(text: str) -> dict[str, str]:
    """The parts of a docstring by their underlined heads; what stands before them under an empty one."""
    parts = re.split(r"^(\w+)\n-{3,}\n", text, flags=re.MULTILINE)
    pairs = zip(["", *parts[1::2]], parts[::2], strict=True)
    return {head: part.strip() for head, part in pairs}


def _entries(text: str) -> dict[str, str]:
    """Names to their texts, of lines like ``height, width : of the result, px``."""
    parts = re.split(r"^(\w+(?:, \w+)*) : ", text, flags=re.MULTILINE)
    entries = zip(parts[1::2], parts[2::2], strict=True)
    return {name: " ".join(what.split()) for names, what in entries for name in names.split(", ")}


def _params(stage: Stage) -> dict[str, Any]:
    found, texts = {}, _help_of(stage.params)
    required = [name for name, field in stage.params.model_fields.items() if field.is_required()]
    # A model may fill in what is not given, so what its fields declare is not all.
    defaults = {} if required else stage.params().model_dump(mode="json")
    for name, field in stage.params.model_fields.items():
        constraints = [_constraint(part) for part in field.metadata if _constraint(part)]
        found[name] = {
            "type": _worded(field.annotation, SIDES in field.metadata),
            "default": "required"
            if name in required
            else defaults.get(name, pydantic_core.to_jsonable_python(field.get_default())),
            "range": ", ".join(constraints),
            "what": texts.get(name, ""),
        }
    return found


@functools.cache
def _help_of(kind: Any) -> dict[str, str]:
    """`field_help`, which reads source; flows have many steps of one stage."""
    return field_help(kind)


def _worded(kind: Any, is_size: bool = False) -> str:
    """A param's type as a user writes its value in YAML, with the limits of parts."""
    origin, parts = typing.get_origin(kind), typing.get_args(kind)
    if origin is Annotated:
        limits = [_constraint(part) for known in parts[1:] for part in getattr(known, "metadata", [known])]
        return " ".join([_worded(parts[0], SIDES in parts), *filter(None, limits)])
    if origin is Literal:
        return " | ".join(map(str, parts))
    if origin in (types.UnionType, typing.Union):
        return " | ".join(_worded(part, is_size) for part in parts)
    if origin is tuple and is_size:
        return f"N | WIDTHxHEIGHT {_worded(parts[0]).removeprefix('int').lstrip()}".rstrip()
    if origin in (tuple, list):
        return f"[{', '.join('...' if part is Ellipsis else _worded(part) for part in parts)}]"
    return _WORDS.get(kind, getattr(kind, "__name__", str(kind)))


def _constraint(part: Any) -> str:
    signs = {"gt": ">", "ge": ">=", "lt": "<", "le": "<=", "multiple_of": "multiple of"}
    for name, sign in signs.items():
        if (limit := getattr(part, name, None)) is not None:
            return f"{sign} {limit}"
    return ""


def explained(found: dict[str, Any]) -> str:
    """A description as text."""
    origin = f", of {found['origin']}" if "origin" in found else ""
    lines = [f"{found['name']} (version {found['version']}{origin})", f"  {found['summary']}"]
    if found["description"]:
        lines += ["", textwrap.indent(found["description"], "  ")]
    params = "params" if found["params"] else "no params"
    for head, entries in {"inputs": found["inputs"], params: found["params"], "outputs": found["outputs"]}.items():
        lines += ["", head, *(line for entry in entries.items() for line in _entry_lines(*entry))]
    lines += ["", f"random: {'yes, by the seed' if found['uses_seed'] else 'no'}"]
    if found["references"]:
        lines += ["", "source", textwrap.indent(found["references"], "  ")]
    return "\n".join(lines)


def flow_explained(found: dict[str, Any]) -> str:
    """A flow's description as text."""
    lines = [found["name"], f"  {found['file']}"]
    for line in found["description"].splitlines():
        # A command stays as it is.
        lines.append(f"  {line}" if line.startswith(" ") else textwrap.indent(textwrap.fill(line, 100), "  "))
    lines += ["", "params (--set NAME=VALUE)" if found["params"] else "no params of the flow's own"]
    lines += [line for entry in found["params"].items() for line in _entry_lines(*entry)]
    what = {name: f"optional: {text}" for name, text in found["optional"].items() if text}
    steps = {name: f"{step['stage']}: {step['summary']}" for name, step in found["steps"].items()}
    tables = {
        "sources (--source NAME=PATH)": found["sources"] | what,
        "steps (--set STEP.PARAM=VALUE)": steps
        | {
            name: f"{step['stage']}: {step['summary']}{_only_with(step['only_with'])}"
            for name, step in found["steps_with"].items()
        },
        "exports": found["exports"]
        | {file: _only_with(lacks).lstrip() for file, lacks in found["exports_with"].items()},
    }
    for head, table in tables.items():
        width = max(map(len, table), default=0)
        lines += ["", head, *(f"  {name:{width}}  {what}" for name, what in table.items())]
    return "\n".join(line.rstrip() for line in lines)


def _only_with(lacks: list[str]) -> str:
    """What a step or an export is left out without."""
    names = ["a set" if one == "set" else one for one in lacks]
    return f" (only with {' and '.join(names)})" if names else ""


def _entry_lines(name: str, entry: dict[str, Any]) -> list[str]:
    """What is said of an input, param or output."""
    words = [entry["type"]]
    if "default" in entry:
        default = entry["default"]
        words.append(f"= {default if isinstance(default, str) else json.dumps(default)}")
    if entry.get("range"):
        words.append(f"({entry['range']})")
    if entry.get("optional"):
        words.append("(optional)")
    if "targets" in entry:
        words.append(f" [{', '.join(entry['targets'])}]")
    what = [textwrap.indent(textwrap.fill(entry["what"], 100), "      ")] if entry["what"] else []
    return [f"  {name}: {' '.join(words)}", *what]
