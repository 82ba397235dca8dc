"""Flows: YAML files that join stages, checked whole before anything runs."""

from __future__ import annotations

import dataclasses
import difflib
import graphlib
import os
import re
import stat
import types
import typing
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Annotated, Any

import pydantic
import yaml

from stages.arrays import Channels, Image, Layers
from stages.declare import InputError, InputFile, Params, Stage, find_stage, stage_names

_NAME = re.compile(r"[a-z][a-z0-9_]{0,63}")
_EXPORT = re.compile(r"[A-Za-z0-9][A-Za-z0-9._-]{0,127}\.(exr|png|json)")
_STANDARD = "tag:yaml.org,2002:"
_LARGEST = 1 << 20  # bytes of a flow file
_LONGEST = 80  # characters of a value in an error
_LONGEST_LINE = 2000  # characters of an error
_SEEDS = 2**63


@dataclasses.dataclass(frozen=True)
class Each:
    """A source that stands for every file of a pattern."""

    pattern: str
    pair: str | None = None
    """another such source, whose files are taken in step"""


@dataclasses.dataclass(frozen=True)
class Reference:
    """Where an input comes from: a source, or an output of a step."""

    name: str
    output: str | None = None

    def __str__(self) -> str:
        return self.name if self.output is None else f"{self.name}.{self.output}"


@dataclasses.dataclass(frozen=True)
class Step:
    """One stage with its inputs and parameters."""

    name: str
    stage: Stage
    inputs: Mapping[str, Reference]
    params: Params

    @property
    def needs(self) -> list[str]:
        """The steps whose outputs this one takes."""
        return sorted({reference.name for reference in self.inputs.values() if reference.output is not None})


@dataclasses.dataclass(frozen=True)
class Flow:
    """A flow that has passed every check that needs no source."""

    name: str
    path: Path
    seed: int
    sources: Mapping[str, str]
    """name to reference; relative paths are absolute by now"""
    steps: Mapping[str, Step]
    """in an order in which they can run"""
    exports: Mapping[str, Reference]
    """file name to what is written to it"""

    def where(self, *place: str) -> str:
        """Names a place of the flow file in an error."""
        return f"{self.path}: {'.'.join(place)}"


@dataclasses.dataclass(frozen=True)
class Overrides:
    """What a command line changes in a flow."""

    sources: Mapping[str, str] = dataclasses.field(default_factory=dict)
    params: Mapping[str, str] = dataclasses.field(default_factory=dict)
    """``STEP.PARAM`` to a YAML value"""
    seed: int | None = None


def find_flow(name: str) -> Path:
    """The file called ``name``, or the flow of that bare name that ships with texloom."""
    path = Path(name)
    try:
        if path.is_file():
            return path
    except OSError as error:
        raise _refused(f"{name}: cannot be read: {error.strerror}") from None
    shipped = _shipped()
    if name in shipped:
        return shipped[name]
    hint = closest(name, shipped) or (
        f"; flows that ship with texloom: {', '.join(shipped)}" if "/" not in name else ""
    )
    if path.is_dir():
        raise _refused(f"{name}: is a folder, not a flow file")
    raise _refused(f"{name}: no such flow{hint}")


def _shipped() -> dict[str, Path]:
    installed = Path(__file__).parent / "configs"
    folder = installed if installed.is_dir() else Path(__file__).parents[1] / "configs"
    return {path.stem: path for path in sorted(folder.glob("*.yaml"))}


def load_flow(path: Path, overrides: Overrides = Overrides()) -> Flow:
    """Read a flow and check all of it; `InputError` names the first place that is wrong."""
    return _Checker(path, overrides).flow()


def parse_yaml(text: str, where: str) -> Any:
    """One YAML document of plain values. Tags, aliases and repeated keys are refused."""
    if len(text) > _LARGEST:
        raise _refused(f"{where}: larger than {_LARGEST} bytes")
    try:
        return yaml.load(text, Loader=_PlainLoader)  # noqa: S506 (a SafeLoader)
    except yaml.MarkedYAMLError as error:
        mark = error.problem_mark or error.context_mark
        line = f" (line {mark.line + 1}, column {mark.column + 1})" if mark else ""
        raise _refused(f"{where}: not valid YAML: {error.problem or error.context}{line}") from None
    except (yaml.YAMLError, ValueError, OverflowError) as error:
        raise _refused(f"{where}: not valid YAML: {str(error).partition(chr(10))[0]}") from None
    except RecursionError:
        raise _refused(f"{where}: not valid YAML: nested too deeply") from None


class _PlainLoader(yaml.SafeLoader):
    @staticmethod
    def _not_plain(what: str, mark: Any) -> yaml.MarkedYAMLError:
        return yaml.MarkedYAMLError(None, None, f"{what} are not allowed", mark)

    def compose_node(self, parent: Any, index: int) -> Any:
        event = self.peek_event()  # type: ignore[no-untyped-call]
        if isinstance(event, yaml.AliasEvent):
            raise self._not_plain(f"aliases (*{event.anchor})", event.start_mark)
        if event.tag is not None:
            raise self._not_plain(f"tags ({event.tag.replace(_STANDARD, '!!')})", event.start_mark)
        return super().compose_node(parent, index)

    def construct_mapping(self, node: Any, deep: bool = False) -> dict[Any, Any]:
        seen = set()
        for key_node, _ in node.value:
            if not isinstance(key_node, yaml.ScalarNode):
                raise yaml.constructor.ConstructorError(None, None, "a key must be plain text", key_node.start_mark)
            if key_node.tag == f"{_STANDARD}merge":
                raise self._not_plain("merge keys (<<)", key_node.start_mark)
            if key_node.value in seen:
                raise yaml.constructor.ConstructorError(
                    None, None, f"'{key_node.value}' is given twice", key_node.start_mark
                )
            seen.add(key_node.value)
        return super().construct_mapping(node, deep)


def one_line(text: str) -> str:
    """``text`` with line breaks and whatever else cannot be printed as escapes, cut where it is very long."""
    text = text if len(text) <= _LONGEST_LINE else f"{text[:_LONGEST_LINE]}..."
    return "".join(character if character.isprintable() else ascii(character)[1:-1] for character in text)


def _refused(problem: str) -> InputError:
    return InputError(one_line(problem))


def _shown(value: Any) -> str:
    """A value as it came, cut where it is long."""
    if value is None:
        return "nothing"
    text = repr(value)
    return text if len(text) <= _LONGEST else f"{text[:_LONGEST]}..."


def closest(word: str, known: Iterable[str]) -> str:
    """A hint at the nearest right word, or nothing."""
    found = difflib.get_close_matches(word, list(known), n=1, cutoff=0.6)
    return f"; did you mean '{found[0]}'?" if found else ""


def nearest_stage(name: str) -> str:
    """A hint at the stage that ``name``, with or without its group, may mean; else at all of them."""
    known = stage_names()
    by_word = {stage.rpartition(".")[2]: stage for stage in known}
    found = difflib.get_close_matches(name.rpartition(".")[2], by_word, n=1, cutoff=0.6)
    return f"; did you mean '{by_word[found[0]]}'?" if found else _one_of(known)


def _one_of(known: Iterable[str]) -> str:
    names = list(known)
    return f"; there is {', '.join(names)}" if names else ""


class _Checker:
    def __init__(self, path: Path, overrides: Overrides):
        self.path = path
        self.overrides = overrides

    def fail(self, place: str, problem: str) -> InputError:
        return _refused(f"{self.path}: {place}: {problem}" if place else f"{self.path}: {problem}")

    def flow(self) -> Flow:
        document = self._document()
        name = document.get("flow", self.path.stem)
        if not isinstance(name, str) or not _NAME.fullmatch(name):
            raise self.fail("flow", f"must be a name like 'my_flow' (small letters, digits, _), got {_shown(name)}")
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
        inputs = {key: self._inputs(key, raw_steps[key], stages, sources) for key in raw_steps}
        steps = {key: Step(key, stages[key], inputs[key], params[key]) for key in self._order(inputs)}
        return Flow(name, self.path, self._seed(document), sources, steps, self._exports(document, stages, sources))

    def _document(self) -> dict[str, Any]:
        try:
            size = self.path.stat().st_size
            text = self.path.read_text(encoding="utf-8") if size <= _LARGEST else ""
        except FileNotFoundError:
            raise self.fail("", "no such file") from None
        except UnicodeDecodeError:
            raise self.fail("", "not a text file in UTF-8") from None
        except OSError as error:
            raise self.fail("", f"cannot be read: {error.strerror}") from None
        if size > _LARGEST:
            raise self.fail("", f"larger than {_LARGEST} bytes")
        document = parse_yaml(text, str(self.path))
        if not isinstance(document, dict):
            raise self.fail(
                "", f"must be a mapping with 'flow', 'sources', 'steps' and 'exports', got {_shown(document)}"
            )
        known = ("flow", "seed", "sources", "steps", "exports")
        for key in document:
            if key not in known:
                raise self.fail(str(key), f"unknown{closest(str(key), known) or _one_of(known)}")
        return document

    def _mapping(self, document: Mapping[str, Any], key: str) -> dict[str, Any]:
        value = document.get(key)
        if value is None:
            return {}
        if not isinstance(value, dict):
            raise self.fail(key, f"must be a mapping, got {_shown(value)}")
        return value

    def _check_name(self, place: str, name: Any) -> None:
        if not isinstance(name, str) or not _NAME.fullmatch(name):
            raise self.fail(place, f"{_shown(name)} is not a name; use small letters, digits and _")

    def _seed(self, document: Mapping[str, Any]) -> int:
        seed = document.get("seed", 0) if self.overrides.seed is None else self.overrides.seed
        if isinstance(seed, bool) or not isinstance(seed, int) or not 0 <= seed < _SEEDS:
            problem = f"must be a whole number from 0 to 2**63 - 1, got {_shown(seed)}"
            raise self.fail("seed", problem) if self.overrides.seed is None else _refused(f"--seed: {problem}")
        return seed

    def _sources(self, document: Mapping[str, Any]) -> dict[str, str]:
        sources: dict[str, str] = {}
        raw = self._mapping(document, "sources")
        for name in self.overrides.sources:
            if name not in raw:
                hint = closest(name, map(str, raw)) or _one_of(map(str, raw))
                raise _refused(f"--source {name}: the flow has no such source{hint}")
        for name, value in raw.items():
            self._check_name("sources", name)
            if name in self.overrides.sources:
                sources[name] = absolute(self.overrides.sources[name], Path.cwd())
                continue
            if isinstance(value, dict):
                self._each(name, value)
                raise self.fail(f"sources.{name}", "runs over a set of files ('each') are not supported yet")
            if not isinstance(value, str) or not value:
                raise self.fail(f"sources.{name}", f"must be a file or 'skimage:NAME', got {_shown(value)}")
            sources[name] = absolute(value, self.path.parent)
        return sources

    def _each(self, name: str, value: dict[str, Any]) -> Each:
        for key in value:
            if key not in ("each", "pair"):
                raise self.fail(f"sources.{name}.{key}", f"unknown{closest(str(key), ('each', 'pair'))}")
        if not isinstance(value.get("each"), str) or not isinstance(value.get("pair", ""), str):
            raise self.fail(f"sources.{name}", f"'each' must be a pattern and 'pair' a source, got {_shown(value)}")
        return Each(value["each"], value.get("pair"))

    def _fields(self, place: str, value: Any) -> dict[str, Any]:
        if not isinstance(value, dict):
            raise self.fail(place, f"must be a mapping with 'stage', 'inputs' and 'params', got {_shown(value)}")
        for key in value:
            if key in ("each", "gather"):
                raise self.fail(f"{place}.{key}", "runs over a set of files are not supported yet")
            if key not in ("stage", "inputs", "params"):
                raise self.fail(f"{place}.{key}", f"unknown{closest(str(key), ('stage', 'inputs', 'params'))}")
        return {
            "stage": value.get("stage"),
            "inputs": self._part(place, value, "inputs"),
            "params": self._part(place, value, "params"),
        }

    def _part(self, place: str, value: dict[str, Any], key: str) -> dict[str, Any]:
        part = value.get(key)
        if part is None:
            return {}
        if not isinstance(part, dict):
            raise self.fail(f"{place}.{key}", f"must be a mapping, got {_shown(part)}")
        return part

    def _stage(self, step: str, fields: Mapping[str, Any]) -> Stage:
        name = fields["stage"]
        if not isinstance(name, str):
            raise self.fail(f"steps.{step}.stage", f"must name a stage, got {_shown(name)}")
        try:
            return find_stage(name)
        except KeyError:
            raise self.fail(f"steps.{step}.stage", f"no stage '{name}'{nearest_stage(name)}") from None

    def _params(self, raw: Mapping[str, Mapping[str, Any]], stages: Mapping[str, Stage]) -> dict[str, Params]:
        given = {step: dict(fields["params"]) for step, fields in raw.items()}
        places = {step: f"{self.path}: steps.{step}.params" for step in raw}
        for step, values in given.items():
            _resolve_files(values, stages[step].params, self.path.parent)
        chosen: set[str] = set()
        for target, text in self.overrides.params.items():
            step, dot, param = target.partition(".")
            if not dot:
                raise _refused(f"--set {target}: must be STEP.PARAM=VALUE")
            if step not in given:
                hint = closest(step, given) or _one_of(given)
                raise _refused(f"--set {target}: no step '{step}'{hint}")
            value = {param: parse_yaml(text, f"--set {target}")}
            _resolve_files(value, stages[step].params, Path.cwd())
            given[step].update(value)
            chosen.add(target)
        checked = {}
        for step, values in given.items():
            model = stages[step].params

            def fail(param: Sequence[Any], problem: str, step: str = step) -> InputError:
                override = f"{step}.{param[0]}" if param else ""
                place = f"--set {override}" if override in chosen else ".".join([places[step], *map(str, param)])
                return _refused(f"{place}: {problem}")

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
        self, place: str, text: Any, stages: Mapping[str, Stage], sources: Mapping[str, str]
    ) -> Reference:
        if not isinstance(text, str):
            raise self.fail(place, f"must be a source or STEP.OUTPUT, got {_shown(text)}")
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
            raise self.fail(place, f"no source '{name}'{closest(name, known) or _one_of(sources)}")
        if name not in stages:
            raise self.fail(place, f"no step '{name}'{closest(name, stages) or _one_of(stages)}")
        if output not in stages[name].outputs:
            hint = closest(output, stages[name].outputs) or _one_of(stages[name].outputs)
            raise self.fail(place, f"step '{name}' has no output '{output}'{hint}")
        return Reference(name, output)

    def _inputs(
        self, step: str, fields: Mapping[str, Any], stages: Mapping[str, Stage], sources: Mapping[str, str]
    ) -> dict[str, Reference]:
        stage = stages[step]
        place = f"steps.{step}.inputs"
        references = {}
        for name, text in fields["inputs"].items():
            if name not in stage.inputs:
                hint = closest(str(name), stage.inputs) or _one_of(stage.inputs)
                raise self.fail(f"{place}.{name}", f"stage {stage.name} has no such input{hint}")
            reference = self._reference(f"{place}.{name}", text, stages, sources)
            given = Image if reference.output is None else stages[reference.name].outputs[reference.output]
            if not _fits(given, stage.inputs[name]):
                raise self.fail(
                    f"{place}.{name}",
                    f"must be {described(stage.inputs[name])}, but {reference} is {described(given)}",
                )
            references[name] = reference
        missing = [name for name in stage.inputs if name not in references and name not in stage.optional]
        if missing:
            raise self.fail(
                place, f"stage {stage.name} needs '{missing[0]}' ({described(stage.inputs[missing[0]])})"
            )
        return references

    def _order(self, inputs: Mapping[str, Mapping[str, Reference]]) -> list[str]:
        graph = {
            step: {reference.name for reference in references.values() if reference.output is not None}
            for step, references in inputs.items()
        }
        sorter = graphlib.TopologicalSorter(graph)
        try:
            sorter.prepare()
        except graphlib.CycleError as error:
            raise self.fail("steps", f"a cycle: {' <- '.join(error.args[1])}") from None
        # As in the file, as far as inputs allow.
        order: list[str] = []
        waiting: list[str] = []
        position = {step: index for index, step in enumerate(inputs)}
        while sorter.is_active():
            waiting = sorted([*waiting, *sorter.get_ready()], key=position.__getitem__)
            step = waiting.pop(0)
            order.append(step)
            sorter.done(step)
        return order

    def _exports(
        self, document: Mapping[str, Any], stages: Mapping[str, Stage], sources: Mapping[str, str]
    ) -> dict[str, Reference]:
        exports = {}
        for file, text in self._mapping(document, "exports").items():
            place = f"exports.{file}"
            if not isinstance(file, str) or not _EXPORT.fullmatch(file):
                raise self.fail("exports", f"{_shown(file)} is not a file name ending in .exr, .png or .json")
            reference = self._reference(place, text, stages, sources)
            given = Image if reference.output is None else stages[reference.name].outputs[reference.output]
            if file.endswith(".json") == is_array(given):
                wanted = "a table or number" if file.endswith(".json") else "a picture or field"
                raise self.fail(place, f"must be {wanted}, but {reference} is {described(given)}")
            if file.endswith(".png") and not _is_picture(given):
                raise self.fail(
                    place, f"must be a picture, but {reference} is {described(given)}; export it as .exr"
                )
            exports[file] = reference
        return exports


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


def file_params(model: type[Params]) -> list[str]:
    """The params of ``model`` that name files."""
    hints = typing.get_type_hints(model, include_extras=True)
    return [name for name, hint in hints.items() if hint == InputFile or InputFile in typing.get_args(hint)]


def _resolve_files(values: dict[str, Any], model: type[Params], base: Path) -> None:
    for name in file_params(model):
        if isinstance(values.get(name), str):
            values[name] = _resolved(values[name], base)


def _explained(error: Any, model: type[Params]) -> str:
    if error["type"] == "extra_forbidden":
        name = str(error["loc"][0])
        return f"no such param{closest(name, model.model_fields) or _one_of(model.model_fields)}"
    message: str = error["msg"].removeprefix("Value error, ").removeprefix("Assertion failed, ")
    message = message.replace("tuple", "list").replace("dictionary", "mapping")  # as YAML has it
    given = "" if error["type"] in ("value_error", "missing") else f", got {_shown(error['input'])}"
    return message[0].lower() + message[1:] + given


def _plain(hint: Any) -> Any:
    if typing.get_origin(hint) is Annotated:
        return _plain(typing.get_args(hint)[0])
    if typing.get_origin(hint) in (types.UnionType, typing.Union):
        kept = [part for part in typing.get_args(hint) if part is not types.NoneType]
        return _plain(kept[0]) if len(kept) == 1 else hint
    return hint


def is_array(hint: Any) -> bool:
    """Whether values of this type are pictures, fields or other arrays."""
    plain = _plain(hint)
    return plain is Image or hasattr(plain, "dtypes")


def _is_picture(hint: Any) -> bool:
    """Whether an array has two sides besides its planes."""
    plain = _plain(hint)
    if plain is Image:
        return True
    planes = any(isinstance(part, Channels | Layers) for part in getattr(hint, "__metadata__", ()))
    return len(plain.dims) - (planes or len(plain.dims) == 3) == 2


def _fixed(array: Any) -> list[str]:
    """The sizes of an array's axes where they are fixed."""
    return [axis if axis.isdigit() else "" for axis in array.dim_str.split()]


def _fits(given: Any, wanted: Any) -> bool:
    one, other = _plain(given), _plain(wanted)
    if hasattr(one, "dtypes") and hasattr(other, "dtypes"):
        return set(one.dtypes) == set(other.dtypes) and _fixed(one) == _fixed(other)
    if other is float:
        return one in (float, int)
    return bool(one == other)


def described(hint: Any) -> str:
    """A type in a user's words."""
    plain = _plain(hint)
    if plain is Image:
        return "an image"
    if hasattr(plain, "dtypes"):
        return f"{plain.dtypes[0]} array ({plain.dim_str})"
    return getattr(plain, "__name__", str(plain))
