"""Flows: YAML files that join stages, checked whole before anything runs."""

from __future__ import annotations

import dataclasses
import difflib
import graphlib
import os
import re
import stat
import typing
from collections.abc import Iterable, Mapping, Sequence
from functools import cache
from pathlib import Path
from typing import Any

import pydantic

from texloom.pipelines.errors import closest, one_of, refused, shown
from texloom.pipelines.flow.model import Each, Flow, Overrides, Reference, Scope, Step, flat
from texloom.pipelines.flow.runner import choose_runner
from texloom.pipelines.flow.types import described, fits, is_array, is_picture, plain_type, text_of
from texloom.pipelines.yaml import parse_yaml, read_document
from texloom.stages.arrays import Image
from texloom.stages.declare import Document, InputError, InputFile, Params, Stage, find_stage, stage_names

_NAME = re.compile(r"[a-z][a-z0-9_]{0,63}")
_EXPORT = re.compile(r"[A-Za-z0-9][A-Za-z0-9._-]{0,127}(\.(exr|png|json|html|csv)|/)")
_EXPORTABLE = {
    "exr": ("array", "a picture or field"),
    "png": ("array", "a picture or field"),
    "json": ("value", "a table or number"),
    "html": ("html", "a page"),
    "csv": ("csv", "a spreadsheet"),
}
_SEEDS = 2**63
_NOTHING_CHANGED = Overrides()


def find_flow(name: str) -> Path:
    """The file called ``name``, or the flow of that bare name that ships with texloom."""
    path = Path(name)
    try:
        if path.is_file():
            return path
    except OSError as error:
        raise refused(f"{name}: cannot be read: {error.strerror}") from None
    shipped = shipped_flows()
    if name in shipped:
        return shipped[name]
    hint = closest(name, shipped) or (
        f"; `texloom flows` lists those that ship: {', '.join(shipped)}" if "/" not in name else ""
    )
    if path.is_dir():
        raise refused(f"{name}: is a folder, not a flow file")
    raise refused(f"{name}: no such flow{hint}")


def shipped_flows() -> dict[str, Path]:
    """Name to file of the flows that ship with texloom."""
    folder = Path(__file__).parents[2] / "configs"
    return {path.stem: path for path in sorted(folder.glob("*.yaml"))}


def load_flow(path: Path, overrides: Overrides = _NOTHING_CHANGED) -> Flow:
    """Read a flow and check all of it; `InputError` names the first place that is wrong."""
    return check_flow(read_document(path), path, overrides)


def check_flow(document: Any, path: Path, overrides: Overrides = _NOTHING_CHANGED) -> Flow:
    """Check a flow that has been read or made; relative paths in it start at the folder of ``path``."""
    return _Checker(document, path, overrides).flow()


def nearest_stage(name: str) -> str:
    """A hint at the stage that ``name``, with or without its group, may mean; else at all of them."""
    known = stage_names()
    by_word = {stage.rpartition(".")[2]: stage for stage in known}
    found = difflib.get_close_matches(name.rpartition(".")[2], by_word, n=1, cutoff=0.6)
    return f"; did you mean '{by_word[found[0]]}'?" if found else one_of(known)


class _Checker:
    def __init__(self, document: Any, path: Path, overrides: Overrides):
        self.document = document
        self.path = path
        self.overrides = overrides

    def fail(self, place: str, problem: str) -> InputError:
        return refused(f"{self.path}: {place}: {problem}" if place else f"{self.path}: {problem}")

    def flow(self) -> Flow:
        document = self._checked_document()
        name = document.get("flow", self.path.stem)
        if not isinstance(name, str) or not _NAME.fullmatch(name):
            raise self.fail("flow", f"must be a name like 'my_flow' (small letters, digits, _), got {shown(name)}")
        sources = self._sources(document)
        raw_steps = self._mapping(document, "steps")
        if not raw_steps:
            raise self.fail("steps", "there must be at least one step")
        for step_name in raw_steps:
            self._check_name("steps", step_name)
            if step_name in sources:
                raise self.fail(f"steps.{step_name}", "there is a source of the same name")
        raw_steps = {key: self._fields(f"steps.{key}", value) for key, value in raw_steps.items()}
        stages = {key: self._stage(key, value) for key, value in raw_steps.items()}
        params = self._params(raw_steps, stages)
        gather = {key: self._gather(key, raw_steps[key], stages, sources) for key in raw_steps}
        inputs = {key: self._inputs(key, raw_steps[key], stages, sources, gather[key]) for key in raw_steps}
        steps = {key: Step(key, stages[key], inputs[key], params[key], gather[key]) for key in raw_steps}
        steps = {key: steps[key] for key in self._order(steps)}
        seeds = self._seeds(document)
        steps = self._scoped(steps, sources, seeds)
        exports, likes = self._exports(document, stages, sources)
        for file, like in likes.items():
            reference = exports[file]
            scope = "shared" if reference.output is None else steps[reference.name].scope
            if isinstance(sources[like], Each) and scope != "item" and reference.name != like:
                raise self.fail(f"exports.{file}.like", f"'{like}' stands for a set, but {reference} is there once")
        runner = choose_runner(document.get("runner"), self.overrides.runner, self.fail)
        given = self.overrides.sources
        own = tuple(source for source in sources if given and source not in given)
        return Flow(name, self.path, seeds, sources, steps, exports, runner, likes, own)

    def _checked_document(self) -> dict[str, Any]:
        document = self.document
        if not isinstance(document, dict):
            raise self.fail(
                "", f"must be a mapping with 'flow', 'sources', 'steps' and 'exports', got {shown(document)}"
            )
        known = ("flow", "seed", "runner", "sources", "steps", "exports")
        for key in document:
            if key not in known:
                raise self.fail(str(key), f"unknown{closest(str(key), known) or one_of(known)}")
        return document

    def _mapping(self, document: Mapping[str, Any], key: str) -> dict[str, Any]:
        value = document.get(key)
        if value is None:
            return {}
        if not isinstance(value, dict):
            raise self.fail(key, f"must be a mapping, got {shown(value)}")
        return value

    def _check_name(self, place: str, name: Any) -> None:
        if not isinstance(name, str) or not _NAME.fullmatch(name):
            raise self.fail(place, f"{shown(name)} is not a name; use small letters, digits and _")

    def _seeds(self, document: Mapping[str, Any]) -> tuple[int, ...]:
        if isinstance(self.overrides.seeds, range):
            return tuple(self.overrides.seeds)
        given = document.get("seed", 0) if self.overrides.seed is None else self.overrides.seed
        seeds: list[Any] = given if isinstance(given, list) and given else [given]
        for seed in seeds:
            if isinstance(seed, bool) or not isinstance(seed, int) or not 0 <= seed < _SEEDS:
                problem = f"must be a whole number from 0 to 2**63 - 1, got {shown(seed)}"
                raise self.fail("seed", problem) if self.overrides.seed is None else refused(f"--seed: {problem}")
        if len(set(seeds)) < len(seeds):
            raise self.fail("seed", f"the same one twice in {shown(seeds)}")
        if self.overrides.seeds is not None:
            seeds = [seeds[0] + index for index in range(self.overrides.seeds)]
        return tuple(seeds)

    def _sources(self, document: Mapping[str, Any]) -> dict[str, str | Each]:
        sources: dict[str, str | Each] = {}
        raw = self._mapping(document, "sources")
        for name in self.overrides.sources:
            if name not in raw:
                hint = closest(name, map(str, raw)) or one_of(map(str, raw))
                raise refused(f"--source {name}: the flow has no such source{hint}")
        for name, value in raw.items():
            self._check_name("sources", name)
            if name in self.overrides.sources:
                given = absolute(self.overrides.sources[name], Path.cwd())
                pair = value.get("pair") if isinstance(value, dict) else None
                sources[name] = Each(given, pair) if is_pattern(given) else given
            elif isinstance(value, dict):
                sources[name] = self._each(name, value)
            elif isinstance(value, str) and value:
                sources[name] = absolute(value, self.path.parent)
            else:
                raise self.fail(f"sources.{name}", f"must be a file or 'skimage:NAME', got {shown(value)}")
        for name, source in sources.items():
            if isinstance(source, Each) and source.pair is not None:
                self._check_pair(name, source.pair, sources)
        return sources

    def _each(self, name: str, value: dict[str, Any]) -> Each:
        for key in value:
            if key not in ("each", "pair"):
                hint = closest(str(key), ("each", "pair")) or one_of(("each", "pair"))
                raise self.fail(f"sources.{name}.{key}", f"unknown{hint}")
        pattern, pair = value.get("each"), value.get("pair")
        if not isinstance(pattern, str) or not is_pattern(pattern):
            raise self.fail(f"sources.{name}.each", f"must be a pattern like 'folder/*.png', got {shown(pattern)}")
        if pair is not None and not isinstance(pair, str):
            raise self.fail(f"sources.{name}.pair", f"must be another source, got {shown(pair)}")
        return Each(absolute(pattern, self.path.parent), pair)

    def _check_pair(self, name: str, pair: str, sources: Mapping[str, str | Each]) -> None:
        other = sources.get(pair)
        if other is None:
            raise self.fail(
                f"sources.{name}.pair", f"no source '{pair}'{closest(pair, sources) or one_of(sources)}"
            )
        if pair == name or not isinstance(other, Each) or other.pair is not None:
            raise self.fail(
                f"sources.{name}.pair", f"'{pair}' must be another source with 'each' and without 'pair'"
            )

    def _fields(self, place: str, value: Any) -> dict[str, Any]:
        if not isinstance(value, dict):
            raise self.fail(place, f"must be a mapping with 'stage', 'inputs' and 'params', got {shown(value)}")
        known = ("stage", "inputs", "gather", "params")
        for key in value:
            if key not in known:
                raise self.fail(f"{place}.{key}", f"unknown{closest(str(key), known) or one_of(known)}")
        return {
            "stage": value.get("stage"),
            "inputs": self._part(place, value, "inputs"),
            "gather": self._part(place, value, "gather"),
            "params": self._part(place, value, "params"),
        }

    def _part(self, place: str, value: dict[str, Any], key: str) -> dict[str, Any]:
        part = value.get(key)
        if part is None:
            return {}
        if not isinstance(part, dict):
            raise self.fail(f"{place}.{key}", f"must be a mapping, got {shown(part)}")
        return part

    def _stage(self, step: str, fields: Mapping[str, Any]) -> Stage:
        name = fields["stage"]
        if not isinstance(name, str):
            raise self.fail(f"steps.{step}.stage", f"must name a stage, got {shown(name)}")
        try:
            return find_stage(name)
        except KeyError:
            raise self.fail(f"steps.{step}.stage", f"no stage '{name}'{nearest_stage(name)}") from None

    def _params(self, raw: Mapping[str, Mapping[str, Any]], stages: Mapping[str, Stage]) -> dict[str, Params]:
        given = {step: dict(fields["params"]) for step, fields in raw.items()}
        places = {step: f"{self.path}: steps.{step}.params" for step in raw}
        for step, values in given.items():
            _resolve_files(values, stages[step].params, self.path.parent, places[step])
        chosen: set[str] = set()
        for target, text in self.overrides.params.items():
            step, dot, param = target.partition(".")
            if not dot:
                raise refused(f"--set {target}: must be STEP.PARAM=VALUE")
            if step not in given:
                hint = closest(step, given) or one_of(given)
                raise refused(f"--set {target}: no step '{step}'{hint}")
            value = {param: parse_yaml(text, f"--set {target}")}
            _resolve_files(value, stages[step].params, Path.cwd(), f"--set {step}")
            given[step].update(value)
            chosen.add(target)
        checked = {}
        for step, values in given.items():
            model = stages[step].params

            def fail(param: Sequence[Any], problem: str, step: str = step) -> InputError:
                override = f"{step}.{param[0]}" if param else ""
                place = f"--set {override}" if override in chosen else ".".join([places[step], *map(str, param)])
                return refused(f"{place}: {problem}")

            try:
                checked[step] = model.model_validate(values)
            except pydantic.ValidationError as error:
                first = error.errors()[0]
                raise fail(first["loc"], _explained(first, model)) from None
            for name in file_params(model):
                path = getattr(checked[step], name)
                if path is not None and (problem := _no_file(path)):
                    raise fail([name], f"{path}: {problem}")
        return checked

    def _reference(
        self, place: str, text: Any, stages: Mapping[str, Stage], sources: Mapping[str, str | Each]
    ) -> Reference:
        if not isinstance(text, str):
            raise self.fail(place, f"must be a source or STEP.OUTPUT, got {shown(text)}")
        name, dot, output = text.partition(".")
        if not dot:
            if name in sources:
                return Reference(name)
            if name in stages:
                outputs = stages[name].outputs
                raise self.fail(
                    place, f"which output of step '{name}'? {', '.join(f'{name}.{o}' for o in outputs)}"
                )
            known = [*sources, *(f"{step}.{o}" for step, stage in stages.items() for o in stage.outputs)]
            raise self.fail(place, f"no source '{name}'{closest(name, known) or one_of(sources)}")
        if name not in stages:
            raise self.fail(place, f"no step '{name}'{closest(name, stages) or one_of(stages)}")
        if output not in stages[name].outputs:
            hint = closest(output, stages[name].outputs) or one_of(stages[name].outputs)
            raise self.fail(place, f"step '{name}' has no output '{output}'{hint}")
        return Reference(name, output)

    def _input(
        self,
        place: str,
        text: Any,
        wanted: Any,
        stages: Mapping[str, Stage],
        sources: Mapping[str, str | Each],
    ) -> Reference:
        """The reference ``text`` to a value of the type ``wanted``."""
        reference = self._reference(place, text, stages, sources)
        given = Image if reference.output is None else stages[reference.name].outputs[reference.output]
        if not fits(given, wanted):
            raise self.fail(place, f"must be {described(wanted)}, but {reference} is {described(given)}")
        return reference

    def _check_input(self, place: str, name: Any, stage: Stage) -> None:
        if name not in stage.inputs:
            hint = closest(str(name), stage.inputs) or one_of(stage.inputs)
            raise self.fail(f"{place}.{name}", f"stage {stage.name} has no such input{hint}")

    def _gather(
        self, step: str, fields: Mapping[str, Any], stages: Mapping[str, Stage], sources: Mapping[str, str | Each]
    ) -> dict[str, Reference | Mapping[str, Reference]]:
        """Inputs that receive a list of all items' values, or such a list by label."""
        stage, place = stages[step], f"steps.{step}.gather"
        found: dict[str, Reference | Mapping[str, Reference]] = {}
        for name, given in fields["gather"].items():
            self._check_input(place, name, stage)
            wanted = plain_type(stage.inputs[name])
            labelled = typing.get_origin(wanted) is dict and typing.get_origin(typing.get_args(wanted)[1]) is list
            listed = typing.get_args(wanted)[1] if labelled else wanted
            if typing.get_origin(listed) is not list or name in fields["inputs"]:
                raise self.fail(
                    f"{place}.{name}", f"stage {stage.name} takes {described(wanted)}: give it as an input"
                )
            element = typing.get_args(listed)[0]
            if not labelled:
                found[name] = self._input(f"{place}.{name}", given, element, stages, sources)
            elif isinstance(given, dict) and given:
                found[name] = {
                    str(label): self._input(f"{place}.{name}.{label}", text, element, stages, sources)
                    for label, text in given.items()
                }
            else:
                raise self.fail(f"{place}.{name}", f"must map labels to STEP.OUTPUT, got {shown(given)}")
        return found

    def _inputs(
        self,
        step: str,
        fields: Mapping[str, Any],
        stages: Mapping[str, Stage],
        sources: Mapping[str, str | Each],
        gathered: Iterable[str],
    ) -> dict[str, Reference]:
        stage, place = stages[step], f"steps.{step}.inputs"
        references = {}
        for name, text in fields["inputs"].items():
            self._check_input(place, name, stage)
            references[name] = self._input(f"{place}.{name}", text, stage.inputs[name], stages, sources)
        given = {*references, *gathered}
        missing = [name for name in stage.inputs if name not in given and name not in stage.optional]
        if missing:
            raise self.fail(
                place, f"stage {stage.name} needs '{missing[0]}' ({described(stage.inputs[missing[0]])})"
            )
        return references

    def _order(self, steps: Mapping[str, Step]) -> list[str]:
        sorter = graphlib.TopologicalSorter({name: step.needs for name, step in steps.items()})
        try:
            sorter.prepare()
        except graphlib.CycleError as error:
            raise self.fail("steps", f"a cycle: {' <- '.join(error.args[1])}") from None
        # As in the file, as far as inputs allow.
        order: list[str] = []
        waiting: list[str] = []
        position = {step: index for index, step in enumerate(steps)}
        while sorter.is_active():
            waiting = sorted([*waiting, *sorter.get_ready()], key=position.__getitem__)
            step = waiting.pop(0)
            order.append(step)
            sorter.done(step)
        return order

    def _scoped(
        self, steps: Mapping[str, Step], sources: Mapping[str, str | Each], seeds: Sequence[int]
    ) -> dict[str, Step]:
        """The steps, in order, each with its scope."""
        found: dict[str, Step] = {}
        for name, step in steps.items():
            taken = [reference for reference in step.inputs.values() if reference.output is not None]
            scopes = {found[reference.name].scope for reference in taken}
            if any(isinstance(sources.get(reference.name), Each) for reference in step.inputs.values()):
                scopes.add("item")
            if len(seeds) > 1 and step.stage.uses_rng and not step.gather:
                scopes.add("item")
            if step.gather:
                scopes.add("final")
            if {"item", "final"} <= scopes:
                one = next(
                    str(r) for r in step.inputs.values() if r.output is None or found[r.name].scope == "item"
                )
                raise self.fail(
                    f"steps.{name}", f"runs once for all items, but {one} is there for each; take it by 'gather'"
                )
            scope: Scope = "item" if "item" in scopes else "final" if "final" in scopes else "shared"
            found[name] = dataclasses.replace(step, scope=scope)
        for name, step in found.items():
            for reference in flat(step.gather):
                if reference.output is not None and found[reference.name].scope == "final":
                    raise self.fail(f"steps.{name}.gather", f"{reference} is there once; take it as an input")
        return found

    def _exports(
        self, document: Mapping[str, Any], stages: Mapping[str, Stage], sources: Mapping[str, str | Each]
    ) -> tuple[dict[str, Reference], dict[str, str]]:
        """What is written to which file, and which sources folders of maps are like."""
        exports, likes = {}, {}
        for file, given in self._mapping(document, "exports").items():
            place = f"exports.{file}"
            if not isinstance(file, str) or not _EXPORT.fullmatch(file):
                raise self.fail(
                    "exports",
                    f"{shown(file)} is not a file name ending in .exr, .png, .json, .html or .csv, "
                    "nor a folder's ending in /",
                )
            text = given
            if file.endswith("/") and isinstance(given, dict):
                text, like = self._folder(place, given, sources)
                if like is not None:
                    likes[file] = like
            reference = self._reference(place, text, stages, sources)
            self._check_export(place, file, reference, stages)
            exports[file] = reference
        return exports, likes

    def _folder(
        self, place: str, given: Mapping[str, Any], sources: Mapping[str, str | Each]
    ) -> tuple[Any, str | None]:
        """What a folder of maps is made of, and the source that it is like."""
        known = ("image", "like")
        for key in given:
            if key not in known:
                raise self.fail(f"{place}.{key}", f"unknown{closest(str(key), known) or one_of(known)}")
        like = given.get("like")
        if like is not None and like not in sources:
            raise self.fail(
                f"{place}.like", f"no source {shown(like)}{closest(str(like), sources) or one_of(sources)}"
            )
        return given.get("image"), like

    def _check_export(self, place: str, file: str, reference: Reference, stages: Mapping[str, Stage]) -> None:
        given = Image if reference.output is None else stages[reference.name].outputs[reference.output]
        if file.endswith("/"):
            if plain_type(given) is not Image:
                raise self.fail(
                    place, f"must be an image, whose maps it will hold, but {reference} is {described(given)}"
                )
            return
        kind = text_of(given) or ("array" if is_array(given) else "value")
        wanted, what = _EXPORTABLE[file.rpartition(".")[2]]
        if kind != wanted:
            raise self.fail(place, f"must be {what}, but {reference} is {described(given)}")
        if file.endswith(".png") and not is_picture(given):
            raise self.fail(place, f"must be a picture, but {reference} is {described(given)}; export it as .exr")


def is_pattern(reference: str) -> bool:
    """Whether it stands for a set of files; a file or folder of just that name is one."""
    return bool(set("*?[") & set(reference)) and not Path(reference).exists()


def absolute(reference: str, base: Path) -> str:
    """A source's reference, with a relative path resolved against ``base``."""
    if re.match(r"[a-z][a-z0-9]+:", reference):
        return reference
    return _resolved(reference, base)


def _resolved(path: str, base: Path) -> str:
    try:
        return str(base.resolve() / Path(path).expanduser())
    except RuntimeError:  # ~ somebody who is not known here
        return str(base.resolve() / path)


def _no_file(path: Path) -> str:
    """What keeps ``path`` from being a file that can be read, or nothing."""
    try:
        mode = path.stat().st_mode
    except OSError as error:
        return str(error.strerror or type(error).__name__).lower()
    except ValueError:
        return "a file name cannot hold a zero byte"
    if not stat.S_ISREG(mode):
        return "is not a file"
    return "" if os.access(path, os.R_OK) else "permission denied"


def file_params(model: type[Params]) -> tuple[str, ...]:
    """The params of ``model`` that name files."""
    return _params_of(model, InputFile)


def document_params(model: type[Params]) -> tuple[str, ...]:
    """The params of ``model`` that name documents."""
    return _params_of(model, Document)


@cache
def _params_of(model: type[Params], kind: Any) -> tuple[str, ...]:
    hints = typing.get_type_hints(model, include_extras=True)
    return tuple(name for name, hint in hints.items() if hint == kind or kind in typing.get_args(hint))


def _resolve_files(values: dict[str, Any], model: type[Params], base: Path, where: str) -> None:
    for name in file_params(model):
        if isinstance(values.get(name), str):
            values[name] = _resolved(values[name], base)
    for name in document_params(model):
        if isinstance(values.get(name), str):
            path = Path(_resolved(values[name], base))
            if problem := _no_file(path):
                raise refused(f"{where}.{name}: {path}: {problem}")
            try:
                values[name] = Document.of(path, read_document(path))
            except InputError as error:
                raise refused(f"{where}.{name}: {error}") from None
            for picture in values[name].pictures.values():
                if problem := _no_file(picture):
                    raise refused(f"{where}.{name}: {path}: {picture}: {problem}")


def _explained(error: Any, model: type[Params]) -> str:
    if error["type"] == "extra_forbidden":
        name = str(error["loc"][0])
        return f"no such param{closest(name, model.model_fields) or one_of(model.model_fields)}"
    message: str = error["msg"].removeprefix("Value error, ").removeprefix("Assertion failed, ")
    message = message[0].lower() + message[1:]
    message = message.replace("tuple", "list").replace("dictionary", "mapping")  # as YAML has it
    message = message.replace(" after validation", "")
    if error["type"] == "missing" and len(error["loc"]) > 1:
        message = "a value is missing"
    given = "" if error["type"] in ("value_error", "missing") else f", got {shown(error['input'])}"
    return message + given + _form(error, model)


def _form(error: Any, model: type[Params]) -> str:
    """A hint at how a list is written, where something else came."""
    field = model.model_fields.get(str(error["loc"][0])) if error["loc"] else None
    if error["type"] not in ("tuple_type", "list_type", "missing", "too_long", "too_short") or field is None:
        return ""
    return f"; as in {list(field.default)}" if isinstance(field.default, tuple | list) and field.default else ""
