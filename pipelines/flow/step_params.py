"""The params of a flow's steps, from its file and from ``--set``: which step takes each, whether it is valid."""

from __future__ import annotations

import json
import os
import stat
import types
import typing
from collections.abc import Collection, Mapping, Sequence
from functools import cache
from pathlib import Path
from typing import Any

import pydantic

from texloom.pipelines.errors import closest, hint, one_of, refused, shown
from texloom.pipelines.flow.compose import is_structural
from texloom.pipelines.flow.conditions import Condition
from texloom.pipelines.flow.draft import Draft
from texloom.pipelines.yaml import parse_yaml, read_document
from texloom.stages.vocabulary.declare import Document, InputError, InputFile, Params, Stage
from texloom.stages.vocabulary.sizes import SIDES, size_value, takes_sides


class StepParams:
    """Checks the params of a composed flow."""

    def __init__(self, draft: Draft, stages: Mapping[str, Stage], skipped: Mapping[str, str]):
        """``skipped``: steps that are left out, with why, whose params may not be given."""
        self.draft = draft
        self.stages = stages
        self.skipped = skipped

    def of_flow(self) -> dict[str, tuple[str, ...]]:
        """Name to the ``STEP.PARAM`` that take its value."""
        for entry in self.draft.params.values():
            for target in entry.value:
                step, _, param = target.partition(".")
                if is_structural(target):
                    continue
                if step not in self.stages:
                    raise entry.fail(f"no step '{step}'{hint(step, self.stages)}")
                known = self.stages[step].params.model_fields
                if param not in known:
                    problem = f"stage {self.stages[step].name} has no param '{param}'"
                    raise entry.fail(problem + hint(param, known))
        return {name: tuple(entry.value) for name, entry in self.draft.params.items()}

    def checked(self, given: Mapping[str, Any], names: Collection[str] | None = None) -> dict[str, Params]:
        """The params of every step, or of ``names``.

        ``given`` are those of the command line, by STEP.PARAM or a param of the flow.
        """
        values: dict[str, dict[str, Any]] = {}
        places: dict[tuple[str, str], str] = {}
        for name, step in self.draft.steps.items():
            if names is not None and name not in names:
                continue
            values[name] = {param: entry.value for param, entry in step.params.items()}
            for param, entry in step.params.items():
                where = entry.where()
                places[name, param] = where
                _resolve_files(values[name], param, self.stages[name].params, entry.path.parent, where)
        for target, value in given.items():
            for name, rest in self._targets(target):
                if name not in values:
                    continue
                model = self.stages[name].params
                param, dot, key = rest.partition(".")
                where = f"--set {target}" if name in target or "." not in target else f"--set {target}: {name}"
                if dot and param in model.model_fields and _is_mapping(model, param):
                    before = values[name].get(param)
                    values[name][param] = {**(before if isinstance(before, dict) else {}), key: value}
                else:
                    param = rest
                    values[name][param] = _listed(value, model, param, where)
                places[name, param] = where
                _resolve_files(values[name], param, model, Path.cwd(), where)
        return {name: self._checked(name, params, places) for name, params in values.items()}

    def unmet(self, conditions: Mapping[str, Condition], given: Mapping[str, Any]) -> set[str]:
        """The texts of those conditions that do not hold."""
        params = self.checked(given, {condition.step for condition in conditions.values()})
        return {text for text, condition in conditions.items() if not condition.holds(params)}

    def given(self, values: Mapping[str, Any]) -> set[tuple[str, str]]:
        """The steps and params that the command line sets."""
        return {(name, rest.partition(".")[0]) for target in values for name, rest in self._targets(target)}

    def texts(self, given: Mapping[str, str | tuple[Any, ...]]) -> dict[str, str]:
        """Params that have passed `checked`, as the command line would have them."""

        def text(target: str, value: str | tuple[Any, ...]) -> str:
            if isinstance(value, str):
                return value
            fields = [(self.stages[step].params.model_fields.get(param)) for step, param in self._targets(target)]
            is_size = any(field is not None and is_size_field(field) for field in fields)
            return size_value(value) if is_size else json.dumps(value)

        return {target: text(target, value) for target, value in given.items()}

    def _targets(self, name: str) -> list[tuple[str, str]]:
        """The steps and params, with a key of a mapping if one is named, that ``--set NAME`` changes."""
        targets = self._all_targets(name)
        kept = [(step, param) for step, param in targets if step not in self.skipped]
        if targets and not kept:
            step = targets[0][0]
            raise refused(f"--set {name}: step '{step}' is skipped: {self.skipped[step]}")
        return kept

    def _all_targets(self, name: str) -> list[tuple[str, str]]:
        """The same, with steps that are skipped."""
        draft, problem = self.draft, f"--set {name}: "
        step, dot, param = name.partition(".")
        if not dot and name in draft.params:
            targets = [target for target in draft.params[name].value if not is_structural(target)]
            return [(one, rest) for one, _, rest in (target.partition(".") for target in targets)]
        if not dot:
            raise refused(problem + self._why_unknown(name))
        if step in draft.steps:
            return [(step, param)]
        names = [one for one in draft.spread.get(step, {}).values() if one in draft.steps]
        if names:
            if step in draft.lacking:
                lacking = ", ".join(draft.lacking[step])
                raise refused(f"{problem}{lacking} has no step '{step}'; name that of one, as {names[0]}.{param}")
            return [(one, param) for one in names]
        near = closest(step, [*draft.steps, *draft.spread])
        raise refused(f"{problem}no step '{step}'{near or one_of(draft.steps)}")

    def _why_unknown(self, name: str) -> str:
        """Why a name without a step is no param of the flow, and what may be meant."""
        draft = self.draft
        if name in draft.partial:
            labels, one = draft.lacking[name], draft.partial[name].value[0]
            have = f"{', '.join(labels)} {'have' if len(labels) > 1 else 'has'}"
            return f"{have} no such param; name that of one step, as {one}"
        if name in draft.steps:
            first = next(iter(self.stages[name].params.model_fields), "PARAM")
            return f"is a step; name one of its params, as {name}.{first}"
        own = " and ".join(
            words for words in (", ".join(draft.params), "those of its steps, as STEP.PARAM") if words
        )
        always = [one for one, step in draft.steps.items() if step.only is None and one in self.stages]
        of_steps = [f"{one}.{name}" for one in always if name in self.stages[one].params.model_fields]
        near = closest(name, draft.params) or f"; it has {own}"
        near = f"; did you mean '{of_steps[0]}'?" if of_steps else near
        return f"{draft.name} has no such param{near}"

    def _checked(self, step: str, values: Mapping[str, Any], places: Mapping[tuple[str, str], str]) -> Params:
        model = self.stages[step].params
        at = self.draft.steps[step].at

        def fail(param: Sequence[Any], problem: str) -> InputError:
            if param and (step, str(param[0])) in places:
                where = places[step, str(param[0])]
                inside = [] if where.startswith("--set ") else param[1:]
                return refused(f"{'.'.join([where, *map(str, inside)])}: {problem}")
            return at.fail(problem, "params", *param)

        try:
            checked = model.model_validate(values)
        except pydantic.ValidationError as error:
            told = _most_telling(error.errors())
            raise fail(told[0]["loc"], _explained(told, model)) from None
        for name in file_params(model):
            path = getattr(checked, name)
            if path is not None and (problem := _no_file(path)):
                raise fail([name], f"{path}: {problem}")
        return checked


def file_params(model: type[Params]) -> tuple[str, ...]:
    """The params of ``model`` that name files."""
    return _params_of(model, InputFile)


def document_params(model: type[Params]) -> tuple[str, ...]:
    """The params of ``model`` that name documents."""
    return _params_of(model, Document)


@cache
def _params_of(model: type[Params], kind: Any) -> tuple[str, ...]:
    hints = typing.get_type_hints(model, include_extras=True)
    return tuple(name for name, one in hints.items() if one == kind or kind in typing.get_args(one))


def is_size_field(field: Any) -> bool:
    """Whether a param of a stage is a size, or may be one."""
    return SIDES in field.metadata or takes_sides(field.annotation)


def _is_mapping(model: type[Params], param: str) -> bool:
    """Whether a param's values are mappings."""
    return any((typing.get_origin(kind) or kind) is dict for kind in _kinds(typing.get_type_hints(model)[param]))


def _kinds(kind: Any) -> list[Any]:
    """The alternatives of a type."""
    if typing.get_origin(kind) in (typing.Union, types.UnionType):
        return [one for part in typing.get_args(kind) for one in _kinds(part)]
    return [kind]


def _listed(value: Any, model: type[Params], param: str, where: str) -> Any:
    """A value of the command line; ``a,b,c`` as a list where the param is one, and ``none`` as an empty list."""
    if param not in model.model_fields or isinstance(value, list | tuple | dict | None):
        return value
    lists = [
        kind for kind in _kinds(typing.get_type_hints(model)[param]) if typing.get_origin(kind) in (tuple, list)
    ]
    if isinstance(value, str) and "," in value and lists:
        return [parse_yaml(one, where) for one in value.split(",")]
    if any(Ellipsis in typing.get_args(kind) for kind in lists):
        return [] if value == "none" else [value]
    return value


def _resolve_files(values: dict[str, Any], name: str, model: type[Params], base: Path, where: str) -> None:
    """Make a param that names a file absolute, and read it if it names a document."""
    value = values[name]
    if not isinstance(value, str):
        return
    if name in file_params(model):
        values[name] = resolved(value, base)
    elif name in document_params(model):
        path = Path(resolved(value, base))
        if problem := _no_file(path):
            raise refused(f"{where}: {path}: {problem}")
        try:
            values[name] = document = Document.of(path, read_document(path))
        except InputError as error:
            raise refused(f"{where}: {error}") from None
        for picture in document.pictures.values():
            if problem := _no_file(picture):
                raise refused(f"{where}: {path}: {picture}: {problem}")


def _most_telling(errors: Sequence[Any]) -> list[Any]:
    """Of the errors of the first wrong param: that of the type which its value has, else those of all its types."""
    alike = [error for error in errors if error["loc"][:1] == errors[0]["loc"][:1]]
    for error in alike:
        if not error["type"].endswith(("_type", "_parsing", "literal_error")):
            return [error]
    deepest = max(len(error["loc"]) for error in alike)
    return [error for error in alike if len(error["loc"]) == deepest]


def _explained(errors: Sequence[Any], model: type[Params]) -> str:
    error = errors[0]
    if error["type"] == "extra_forbidden":
        name = str(error["loc"][0])
        return f"no such param{hint(name, model.model_fields)}"
    message: str = error["msg"].removeprefix("Value error, ").removeprefix("Assertion failed, ")
    message = message[0].lower() + message[1:]
    if len(errors) > 1:
        kinds = {one["msg"].removeprefix("Input should be ").partition(",")[0]: None for one in errors}
        *others, last = kinds
        message = f"input should be {', '.join([*others, f'or {last}' if others else last])}"
    field = model.model_fields.get(str(error["loc"][0])) if error["loc"] else None
    if field is not None and is_size_field(field):
        message = message.replace("a valid tuple", "N or WIDTHxHEIGHT")
    for term, plain in (("tuple", "list"), ("dictionary", "mapping"), (" after validation", "")):
        message = message.replace(term, plain)
    if error["type"] == "missing" and len(error["loc"]) > 1:
        message = "a value is missing"
    actual = "" if error["type"] in ("value_error", "missing") else f", got {shown(error['input'])}"
    return message + actual + _form(error, field)


def _form(error: Any, field: Any) -> str:
    """An example of a list, where the value is none."""
    if error["type"] not in ("tuple_type", "list_type", "missing", "too_long", "too_short") or field is None:
        return ""
    if is_size_field(field):
        return ""
    return f"; as in {list(field.default)}" if isinstance(field.default, tuple | list) and field.default else ""


def resolved(path: str, base: Path) -> str:
    """The absolute path of a file that is named relative to ``base``."""
    try:
        return str(base.resolve() / Path(path).expanduser())
    except RuntimeError:  # ~ of an unknown user
        return str(base.resolve() / path)


def _no_file(path: Path) -> str:
    """Why ``path`` is not a file that can be read; empty if it is."""
    try:
        mode = path.stat().st_mode
    except OSError as error:
        return str(error.strerror or type(error).__name__).lower()
    except ValueError:
        return "a file name cannot hold a zero byte"
    if not stat.S_ISREG(mode):
        return "is not a file"
    return "" if os.access(path, os.R_OK) else "permission denied"
