"""Loading of flows: YAML files that connect stages, checked completely before anything runs."""

from __future__ import annotations

import dataclasses
import difflib
import graphlib
import heapq
import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from texloom.pipelines.errors import closest, hint, one_of, refused, shown
from texloom.pipelines.flow.compose import compose, find_flow
from texloom.pipelines.flow.draft import Change, Draft, DraftStep, Entry, keep, texts_of
from texloom.pipelines.flow.gone import INPUTS, OUTPUTS
from texloom.pipelines.flow.model import Each, Flow, Overrides, Reference, Scope, Skipped, Step, flat
from texloom.pipelines.flow.presence import Alternatives, Presence, Taker
from texloom.pipelines.flow.runner import choose_runner
from texloom.pipelines.flow.schema import (
    EXPORT,
    FILE_NAME,
    REQUIRED,
    SETS,
    WRITTEN,
    FolderPart,
    SetPart,
    is_optional,
    parse_flow,
)
from texloom.pipelines.flow.source_files import is_pattern, source_of, stack_of
from texloom.pipelines.flow.step_params import StepParams, document_params, resolved
from texloom.pipelines.media.delivery import Delivery, Fail, of_option, parse_delivery
from texloom.pipelines.media.material_set import is_map_set
from texloom.pipelines.media.part import WHOLE, Part, parse_part
from texloom.pipelines.media.stack import SCHEME
from texloom.pipelines.media.writers.registry import MODELS, writer_of
from texloom.pipelines.store.types import TEXT_NAMES, Hint
from texloom.pipelines.yaml import parse_yaml, read_document
from texloom.stages.lookup.registry import find_stage, stage_names
from texloom.stages.vocabulary.arrays import Image, Mesh
from texloom.stages.vocabulary.declare import InputError, Stage
from texloom.stages.vocabulary.voted_patches import VotedPatches

__all__ = ["check_flow", "find_flow", "load_flow", "nearest_stage"]

_EXPORTABLE = {
    "array": "a picture or field",
    "picture": "a picture or field",
    "image": "an image",
    "value": "a table or number",
    **TEXT_NAMES,
}
"""what writers take, in words"""
_MAPS = "maps/"
_IMAGE = Hint.of(Image)
_MESH = Hint.of(Mesh)
_PATCHES = Hint.of(VotedPatches)
_NOTHING_CHANGED = Overrides()


def load_flow(path: Path, overrides: Overrides = _NOTHING_CHANGED) -> Flow:
    """Read a flow and check all of it; `InputError` names the first place that is wrong."""
    return check_flow(read_document(path), path, overrides)


def check_flow(document: Any, path: Path, overrides: Overrides = _NOTHING_CHANGED) -> Flow:
    """Check a flow that has been read or made; relative paths in it start at the folder of ``path``."""
    if overrides.seed is not None and isinstance(document, dict):
        document = {**document, "seed": _seed(overrides.seed)}
    values = {
        target: given if isinstance(given, tuple) else parse_yaml(given, f"--set {target}")
        for target, given in overrides.params.items()
    }
    draft = compose(document, path, values)
    part = parse_part(*_options(draft.part, overrides.part))
    delivery = parse_delivery(*_options(draft.delivery, overrides.delivery)).reduced(part.reduce)
    if "texel_size" in draft.params and delivery.texel_size is not None:
        values.setdefault("texel_size", delivery.texel_size)
    draft.exports |= {file: _export(file, reference) for file, reference in overrides.exports.items()}
    flow = _Checker(draft, overrides, values, delivery).flow()
    return flow if part == WHOLE else _of_part(flow, draft, part)


def _options(declared: Mapping[str, Entry], asked: Mapping[str, str]) -> tuple[dict[str, str], Fail]:
    """Options as a flow declares them, with those of the command line; and the error of one."""

    def fail(name: str, problem: str) -> InputError:
        if name in declared and name not in asked:
            return declared[name].fail(problem)
        return of_option(name, problem)

    return {**{name: entry.value for name, entry in declared.items()}, **asked}, fail


def _of_part(flow: Flow, draft: Draft, part: Part) -> Flow:
    """The flow with a part of its first source; `InputError` where something names pixels of the whole."""
    option = "--reduce" if part.size is None else "--crop"
    first = next(iter(flow.sources), None)
    if first is None or first in flow.meshes:
        raise refused(f"{option}: {flow.name} takes no picture")
    for step in flow.steps.values():
        for param in document_params(type(step.params)):
            if getattr(step.params, param) is not None:
                raise refused(f"{option}: steps.{step.name}.params.{param} has positions in the whole picture")
    belonging = [name for name in flow.sources if getattr(draft.sources[name].value, "pair", None) == first]
    return dataclasses.replace(flow, parts=dict.fromkeys([first, *belonging], part))


def _export(file: str, reference: str) -> Entry:
    where = f"--export {file}"
    if not EXPORT.fullmatch(file):
        raise refused(f"{where}: must be {FILE_NAME}")
    return Entry(reference, Path(where), reference)


def _seed(seed: int) -> int:
    try:
        parse_flow({"seed": seed}, Path("--seed"))
    except InputError as error:
        raise refused(str(error).replace("--seed: seed", "--seed", 1)) from None
    return seed


def nearest_stage(name: str) -> str:
    """A hint at the stage that ``name``, with or without its group, may mean; else at all of them."""
    known = stage_names()
    by_word = {stage.rpartition(".")[2]: stage for stage in known}
    close = difflib.get_close_matches(name.rpartition(".")[2], by_word, n=1, cutoff=0.6)
    return f"; did you mean '{by_word[close[0]]}'?" if close else one_of(known)


def _chosen_source(name: str, given: str | Sequence[str], entry: Entry) -> str | Each:
    """What the caller gives, as the source that an entry declares."""
    references = [absolute(one, Path.cwd()) for one in ([given] if isinstance(given, str) else given)]
    if not isinstance(entry.value, SetPart):
        return source_of(name, references, None, is_map_set(absolute(entry.value, entry.path.parent)))
    if entry.value.stack is not None:
        return stack_of(name, references)
    return source_of(name, references, entry.value.pair, False)


def _declared_source(entry: Entry) -> str | Each:
    """The source of an entry that nothing replaces."""
    value, folder = entry.value, entry.path.parent
    if not isinstance(value, SetPart):
        return absolute(value, folder)
    if value.stack is not None:
        if value.each is not None or value.pair is not None:
            raise entry.fail("is either a 'stack' or a set with 'each'")
        return SCHEME + absolute(value.stack, folder)
    if value.is_required:
        return absolute(REQUIRED, folder)
    if value.each is None or not is_pattern(value.each):
        raise entry.fail(f"must be a pattern like 'folder/*.png', got {shown(value.each)}", "each")
    return Each((absolute(value.each, folder),), value.pair)


def _is_required(value: str | SetPart) -> bool:
    """Whether a source has no file unless the caller gives one."""
    if isinstance(value, SetPart):
        return value.is_required or value.stack == REQUIRED
    return value == REQUIRED


class _Checker:
    """Checks names, types and values of a composed flow."""

    def __init__(self, draft: Draft, overrides: Overrides, values: Mapping[str, Any], delivery: Delivery):
        self.draft = draft
        self.delivery = delivery
        self.path = draft.path
        self.overrides = overrides
        self.values = values
        self.sources: dict[str, str | Each] = {}
        self.dropped: set[str] = set()
        """the optional sources that an including flow leaves out for good"""
        self.stages: dict[str, Stage] = {}
        self.meshes: tuple[str, ...] = ()
        self.results: tuple[str, ...] = ()

    def fail(self, place: str, problem: str) -> InputError:
        return refused(f"{self.path}: {place}: {problem}")

    def flow(self) -> Flow:
        draft = self.draft
        self._check_sources()
        self.stages = {name: self._stage(step.stage) for name, step in draft.steps.items()}
        self.meshes, self.results = self._sources_taken_as(_MESH), self._sources_taken_as(_PATCHES)
        takers = {name: self._taker(name, step) for name, step in draft.steps.items()}
        takers |= {file: self._export_taker(file, entry) for file, entry in draft.exports.items()}
        self._leave_out(Presence(takers, self.dropped, is_set=True))
        self.sources, missing, left_out = self._sources()
        seeds = self._seeds()
        is_set = len(seeds) > 1 or any(isinstance(source, Each) for source in self.sources.values())
        there = Presence(takers, {*left_out, *self.dropped}, is_set)
        takers |= {name: self._changed(name, step, there) for name, step in draft.steps.items() if step.when}
        there = Presence(takers, {*left_out, *self.dropped}, is_set, there)
        self._check_given(there)
        self._check_asked(there)
        reasons = {name: _why_skipped(there.lacking.get(name)) for name in draft.steps if not there.is_there(name)}
        step_params = StepParams(draft, self.stages, reasons)
        flow_params = step_params.of_flow()
        params = step_params.checked(self.values)
        steps = {
            name: Step(
                name, self.stages[name], there.inputs(name), params[name], there.gathered(name), step.draws_as
            )
            for name, step in draft.steps.items()
            if there.is_there(name)
        }
        if not steps:
            raise self.fail("steps", "there must be at least one step")
        self._check_documents(steps, step_params.given(self.values))
        steps = {name: steps[name] for name in self._order(steps)}
        steps = self._scoped(steps, seeds)
        delivery = self.delivery
        exports, likes, surfaces = self._exports(there)
        self._add_layout(delivery, exports)
        self._check_likes(likes, exports, steps)
        declared = None if draft.runner is None else draft.runner.value
        runner = choose_runner(declared, self.overrides.runner, self.fail)
        chosen = self._chosen_sources()
        own = tuple(name for name in self.sources if chosen and name not in chosen and name not in missing)
        of_maps = tuple(
            file
            for file, entry in draft.exports.items()
            if file in exports and isinstance(entry.value, FolderPart) and entry.value.if_maps
        )
        skipped = {
            name: Skipped(self.stages[name], params[name], there.lacking.get(name, ()), reason)
            for name, reason in reasons.items()
        }
        unwritten = {file: there.lacking[file] for file in draft.exports if file in there.lacking}
        optional = {
            name: entry.value.optional or "" if isinstance(entry.value, SetPart) else ""
            for name, entry in draft.sources.items()
            if is_optional(entry.value)
        }
        overrides = dataclasses.replace(self.overrides, params=step_params.texts(self.overrides.params))
        return Flow(
            draft.name, self.path, seeds, self.sources, steps, exports, runner, likes, surfaces, self.meshes,
            self.results, of_maps, own, tuple(draft.included), flow_params, missing, left_out, overrides,
            delivery=delivery, skipped=skipped, unwritten=unwritten, optional=optional,
        )  # fmt: skip

    def _check_sources(self) -> None:
        """Set aside the sources that are left out for good, and check names."""
        draft = self.draft
        self.dropped = {name for name, entry in draft.sources.items() if entry.value is None}
        kept = [(name, entry) for name, entry in draft.sources.items() if name not in self.dropped]
        # the first source is the one that a command's picture stands for
        draft.sources = dict(sorted(kept, key=lambda item: is_optional(item[1].value)))
        self._chosen_sources()
        if not draft.steps:
            raise self.fail("steps", "there must be at least one step")
        for name, step in draft.steps.items():
            if name in draft.sources:
                raise step.at.fail("there is a source of the same name")

    def _leave_out(self, possible: Presence) -> None:
        """Forget what cannot be without sources that are left out for good, and those that nothing takes."""
        draft = self.draft
        keep(draft, {name for name in draft.steps if name not in possible.lacking})
        draft.exports = {file: entry for file, entry in draft.exports.items() if file not in possible.lacking}
        used = {
            one.name
            for name, taker in possible.takers.items()
            if name not in possible.lacking
            for alternatives in taker.taken()
            for one in alternatives
        }
        changes = [change for step in draft.steps.values() for change in step.when]
        used |= {text for change in changes for one in change.inputs.values() for text in texts_of(one.value)}
        self.dropped |= {
            name for name, entry in draft.sources.items() if is_optional(entry.value) and name not in used
        }
        draft.sources = {name: entry for name, entry in draft.sources.items() if name not in self.dropped}

    def _check_given(self, there: Presence) -> None:
        """Refuse optional sources that are given, but that nothing takes."""
        optional = {
            name for name, entry in self.draft.sources.items() if name in self.sources and is_optional(entry.value)
        }
        used = there.used_sources()
        for name in self.draft.sources:
            if name in optional - used:
                takers = [one for one, taker in there.takers.items() if Reference(name) in sum(taker.taken(), ())]
                lacks = [
                    one for taker in takers for one in there.lacking.get(taker, ()) if one in self.draft.sources
                ]
                if not lacks:
                    raise refused(f"--source {name}: nothing takes it with what else is given")
                raise refused(
                    f"--source {name}: is used only with {_and(lacks)}, as in: {self._example(name, lacks)}"
                )
        passed_over = there.passed_over(optional)
        if passed_over is not None:
            lost, won = ([name for name in self.draft.sources if name in names] for names in passed_over)
            others = f"cannot be given with {_and(won)}; leave one out" if won else "is taken by nothing"
            raise refused(f"--source {_and(lost)}: {others}")

    def _check_asked(self, there: Presence) -> None:
        """Refuse exports that the caller asks for, but of which nothing is there."""
        for file, reference in self.overrides.exports.items():
            if file in there.lacking:
                raise refused(f"--export {file}: {reference} is not there: {_why_skipped(there.lacking[file])}")

    def _example(self, name: str, lacks: Sequence[str]) -> str:
        """A command that gives a source, and those that it needs."""
        given = {one: f"{one}.png" for one in dict.fromkeys(lacks)} | {name: f"{name}.png"}
        options = " ".join(f"--source {one}={file}" for one, file in given.items())
        return f"texloom run {self.draft.name} {next(iter(self.draft.sources))}.png {options}"

    def _taker(self, name: str, step: DraftStep) -> Taker:
        """What a step takes, checked."""
        stage = self.stages[name]
        only: Alternatives = ()
        if step.only is not None and step.only.value != SETS:
            only = self._references(step.only)
        for change in step.when:
            for key, entry in change.inputs.items():
                if entry.value is not None:
                    self._check_input(entry, key, stage)
                    self._input(entry, Hint.of(stage.inputs[key]))
            for key, entry in change.params.items():
                if key not in stage.params.model_fields:
                    raise entry.fail(
                        f"stage {stage.name} has no param '{key}'{hint(key, stage.params.model_fields)}"
                    )
        required = {key for key in stage.inputs if key not in stage.optional}
        is_for_sets = step.only is not None and step.only.value == SETS
        gather = self._gather(name, step)
        return Taker(self._inputs(name, step), gather, required, only, is_for_sets)

    def _changed(self, name: str, step: DraftStep, there: Presence) -> Taker:
        """What a step takes with the sources that are there; its params are changed in the draft."""
        taker = there.takers[name]
        for change in step.when:
            if not self._holds(change, there):
                continue
            inputs = {
                key: None if entry.value is None else self._references(entry)
                for key, entry in change.inputs.items()
            }
            kept = {**taker.inputs, **inputs}
            taker = dataclasses.replace(taker, inputs={key: one for key, one in kept.items() if one is not None})
            step = dataclasses.replace(step, params={**step.params, **change.params})
        self.draft.steps[name] = step
        return taker

    def _holds(self, change: Change, there: Presence) -> bool:
        """Whether the source of a change is there; a step that nothing takes is gone, and with it what it made."""
        texts = texts_of(change.source.value)
        known = [text for text in texts if text.partition(".")[0] in {*self.stages, *self.sources}]
        return any(there.chosen((self._reference(change.source, text),)) for text in known)

    def _seeds(self) -> tuple[int, ...]:
        if isinstance(self.overrides.seeds, Sequence):
            return tuple(self.overrides.seeds)
        seeds = self.draft.seed or (0,)
        if self.overrides.seeds is not None:
            return tuple(seeds[0] + index for index in range(self.overrides.seeds))
        return seeds

    def _sources(self) -> tuple[dict[str, str | Each], tuple[str, ...], tuple[str, ...]]:
        """The sources by name, and the names of required and of optional ones that are missing."""
        sources: dict[str, str | Each] = {}
        chosen = self._chosen_sources()
        missing, left_out = [], []
        for name, entry in self.draft.sources.items():
            part = entry.value
            if isinstance(part, SetPart) and part.optional is not None and (part.each or part.stack):
                raise entry.fail("is either optional or has files of its own, by 'each' or 'stack'")
            if name in chosen:
                sources[name] = _chosen_source(name, chosen[name], entry)
            elif is_optional(part):
                left_out.append(name)
            else:
                sources[name] = _declared_source(entry)
                if _is_required(entry.value):
                    missing.append(name)
        for name, entry in self.draft.sources.items():
            if name in sources and isinstance(entry.value, SetPart) and entry.value.pair is not None:
                sources[name] = self._paired(name, entry.value, sources)
        return sources, tuple(missing), tuple(left_out)

    def _chosen_sources(self) -> dict[str, str | Sequence[str]]:
        """What replaces the sources of the file."""
        chosen, known = dict(self.overrides.sources), self.draft.sources
        for name in chosen:
            if name not in known:
                raise refused(f"--source {name}: the flow has no such source{hint(name, known)}")
        if pictures := self.overrides.pictures:
            if not known:
                raise self.fail("sources", f"the flow takes no picture, got {shown(pictures[0])}")
            first = next(iter(known))
            if first in chosen:
                raise refused(f"--source {first}: {pictures[0]} is given as '{first}' too; give one of them")
            chosen[first] = pictures
        return chosen

    def _paired(self, name: str, part: SetPart, sources: Mapping[str, str | Each]) -> str | Each:
        """The source called ``name``, whose set goes with that of ``part.pair``."""
        source, entry, pair = sources[name], self.draft.sources[name], str(part.pair)
        other, partner = sources.get(pair), self.draft.sources.get(pair)
        if other is None or partner is None:
            raise entry.fail(f"no source '{pair}'{hint(pair, sources)}", "pair")
        if isinstance(partner.value, SetPart) and partner.value.pair is not None:
            raise entry.fail(f"'{pair}' must be another source, without 'pair'", "pair")
        if not isinstance(source, Each) or isinstance(other, Each):
            return source
        if part.is_required or part.optional is not None:
            return dataclasses.replace(source, pair=None)
        if pair in self._chosen_sources():
            raise refused(
                f"--source {pair}: takes a folder or a quoted pattern, as '{pair}s/*.png', got {shown(other)}"
            )
        raise entry.fail(f"'{pair}' must be a source with 'each'", "pair")

    @staticmethod
    def _stage(entry: Entry) -> Stage:
        name = entry.value
        if not isinstance(name, str):
            raise entry.fail(f"must name a stage, got {shown(name)}")
        try:
            return find_stage(name)
        except KeyError:
            raise entry.fail(f"no stage '{name}'{nearest_stage(name)}") from None

    def _references(self, entry: Entry, *place: object) -> Alternatives:
        """The references in an entry, of which the first that is there is taken."""
        texts = entry.value if isinstance(entry.value, list) else [entry.value]
        if not texts:
            raise entry.fail("must be a source or STEP.OUTPUT, got []", *place)
        return tuple(self._reference(entry, text, *place) for text in texts)

    def _reference(self, entry: Entry, text: Any, *place: object) -> Reference:
        """One of the references in an entry."""
        stages, sources = self.stages, {*self.draft.sources, *self.dropped}
        if not isinstance(text, str):
            raise entry.fail(f"must be a source or STEP.OUTPUT, got {shown(text)}", *place)
        name, dot, output = text.partition(".")
        if not dot:
            if name in sources:
                return Reference(name)
            if name in stages:
                outputs = stages[name].outputs
                which = ", ".join(f"{name}.{one}" for one in outputs)
                raise entry.fail(f"which output of step '{name}'? {which}", *place)
            listed = [one for one in self.draft.sources if one not in self.dropped]
            known = [*listed, *(f"{step}.{one}" for step, stage in stages.items() for one in stage.outputs)]
            raise entry.fail(f"no source '{name}'{closest(name, known) or one_of(listed)}", *place)
        if name not in stages:
            near = closest(name, [*stages, *self.draft.spread])
            raise entry.fail(f"no step '{name}'{near or one_of(stages)}", *place)
        if output not in stages[name].outputs:
            if output in OUTPUTS:
                raise entry.fail(f"{text} is gone: {OUTPUTS[output]}", *place)
            raise entry.fail(f"step '{name}' has no output '{output}'{hint(output, stages[name].outputs)}", *place)
        return Reference(name, output)

    def _check_documents(self, steps: Mapping[str, Step], given: set[tuple[str, str]]) -> None:
        """A document of a file, such as a geometry, describes the picture that the same file names."""
        depths = {path: depth for depth, path in enumerate([self.path, *self.draft.included])}  # outermost first
        for name, step in steps.items():
            for param in document_params(self.stages[name].params):
                entry = self.draft.steps[name].params.get(param)
                if entry is None or entry.value is None or (name, param) in given:
                    continue
                for taken in step.inputs.values():
                    source = self.draft.sources.get(taken.name) if taken.output is None else None
                    if source is None or not isinstance(source.value, str) or is_optional(source.value):
                        continue
                    is_chosen = taken.name in self._chosen_sources() and source.value != REQUIRED
                    outer, inner = depths.get(source.path, 0), depths.get(entry.path, 0)
                    if outer < inner or (outer == inner and is_chosen):
                        raise self._foreign_document(f"{name}.{param}", taken.name, entry)

    def _foreign_document(self, target: str, source: str, entry: Entry) -> InputError:
        short = next((one for one, targets in self.draft.params.items() if target in targets.value), target)
        problem = f"{shown(entry.value)} of {entry.path.name} describes its example and not another '{source}'"
        studio = "; `texloom studio` makes one" if short.endswith("geometry") else ""
        return refused(f"sources.{source}: {short}: {problem}; give --set {short}=FILE{studio}")

    def _sources_taken_as(self, kind: Hint) -> tuple[str, ...]:
        """The sources that a step takes as a mesh, or as an earlier result."""
        taken = {
            text
            for name, step in self.draft.steps.items()
            for key, entry in step.inputs.items()
            if key in self.stages[name].inputs and Hint.of(self.stages[name].inputs[key]) == kind
            for text in texts_of(entry.value)
        }
        return tuple(name for name in self.draft.sources if name in taken)

    def _type_of(self, reference: Reference) -> Hint:
        if reference.output is None:
            name = reference.name
            return _MESH if name in self.meshes else _PATCHES if name in self.results else _IMAGE
        return Hint.of(self.stages[reference.name].outputs[reference.output])

    def _input(self, entry: Entry, wanted: Hint, *place: object) -> Alternatives:
        """The references in an entry, to values of the type ``wanted``."""
        references = self._references(entry, *place)
        for reference in references:
            kind = self._type_of(reference)
            if not kind.fits(wanted):
                raise entry.fail(f"must be {wanted}, but {reference} is {kind}", *place)
        return references

    @staticmethod
    def _check_input(entry: Entry, name: str, stage: Stage) -> None:
        if name not in stage.inputs:
            if name in INPUTS:
                raise entry.fail(f"is gone: {INPUTS[name]}")
            raise entry.fail(f"stage {stage.name} has no such input{hint(name, stage.inputs)}")

    def _gather(self, name: str, step: DraftStep) -> dict[str, Alternatives | Mapping[str, Alternatives]]:
        """Inputs that receive a list of all items' values, or such a list by label."""
        stage = self.stages[name]
        gathered: dict[str, Alternatives | Mapping[str, Alternatives]] = {}
        for key, entry in step.gather.items():
            self._check_input(entry, key, stage)
            wanted = Hint.of(stage.inputs[key])
            if wanted.element is None or key in step.inputs:
                raise entry.fail(f"stage {stage.name} takes {wanted}: give it as an input")
            element = Hint.of(wanted.element)
            if not wanted.is_labelled:
                gathered[key] = self._input(entry, element)
            elif isinstance(entry.value, dict) and entry.value:
                gathered[key] = {
                    str(label): self._input(dataclasses.replace(entry, value=text), element, label)
                    for label, text in entry.value.items()
                }
            else:
                raise entry.fail(f"must map labels to STEP.OUTPUT, got {shown(entry.value)}")
        return gathered

    def _inputs(self, name: str, step: DraftStep) -> dict[str, Alternatives]:
        stage = self.stages[name]
        references = {}
        for key, entry in step.inputs.items():
            self._check_input(entry, key, stage)
            references[key] = self._input(entry, Hint.of(stage.inputs[key]))
        taken = {*references, *step.gather}
        missing = [key for key in stage.inputs if key not in taken and key not in stage.optional]
        if missing:
            needed = f"'{missing[0]}' ({Hint.of(stage.inputs[missing[0]])})"
            raise step.at.fail(f"stage {stage.name} needs {needed}", "inputs")
        return references

    def _order(self, steps: Mapping[str, Step]) -> list[str]:
        """The names of the steps, as in the file as far as inputs allow."""
        try:
            graphlib.TopologicalSorter({name: step.needs for name, step in steps.items()}).prepare()
        except graphlib.CycleError as error:
            raise self.fail("steps", f"a cycle: {' <- '.join(error.args[1])}") from None
        places = {name: place for place, name in enumerate(steps)}
        waits_for = {name: len(step.needs) for name, step in steps.items()}
        taken_by: dict[str, list[str]] = {name: [] for name in steps}
        for name, step in steps.items():
            for needed in step.needs:
                taken_by[needed].append(name)
        ready = [(places[name], name) for name, count in waits_for.items() if not count]
        order: list[str] = []
        while ready:
            _, name = heapq.heappop(ready)
            order.append(name)
            for later in taken_by[name]:
                waits_for[later] -= 1
                if not waits_for[later]:
                    heapq.heappush(ready, (places[later], later))
        return order

    def _scoped(self, steps: Mapping[str, Step], seeds: Sequence[int]) -> dict[str, Step]:
        """The steps, in order, each with its scope."""
        scoped: dict[str, Step] = {}
        for name, step in steps.items():
            scoped[name] = dataclasses.replace(step, scope=self._scope(step, scoped, seeds))
        for name, step in scoped.items():
            for reference in flat(step.gather):
                if reference.output is not None and scoped[reference.name].scope == "final":
                    problem = f"{reference} exists only once; take it as an input"
                    raise self.draft.steps[name].at.fail(problem, "gather")
        return scoped

    def _scope(self, step: Step, scoped: Mapping[str, Step], seeds: Sequence[int]) -> Scope:
        """The scope of a step whose inputs come from those in ``scoped``."""
        taken = [reference for reference in step.inputs.values() if reference.output is not None]
        scopes = {scoped[reference.name].scope for reference in taken}
        if any(isinstance(self.sources.get(reference.name), Each) for reference in step.inputs.values()):
            scopes.add("item")
        if len(seeds) > 1 and step.stage.uses_rng and not step.gather:
            scopes.add("item")
        if step.gather:
            scopes.add("final")
        if {"item", "final"} <= scopes:
            one = next(str(r) for r in step.inputs.values() if r.output is None or scoped[r.name].scope == "item")
            problem = f"runs once for all items, but {one} exists for each; take it by 'gather'"
            raise self.draft.steps[step.name].at.fail(problem)
        return "item" if "item" in scopes else "final" if "final" in scopes else "shared"

    def _export_taker(self, file: str, entry: Entry) -> Taker:
        """What an export takes, checked."""
        image = entry.value
        inputs: dict[str, Alternatives] = {}
        only: Alternatives = ()
        if isinstance(entry.value, FolderPart):
            image, like, mesh = entry.value.image, entry.value.like, entry.value.mesh
            if entry.value.only is not None:
                only = self._references(dataclasses.replace(entry, value=entry.value.only), "only")
            if file.endswith("/") or (like is not None and file.endswith(".png")):
                if like is not None and (not isinstance(like, str) or like not in self.draft.sources):
                    raise entry.fail(f"no source {shown(like)}{hint(str(like), self.draft.sources)}", "like")
                if like is not None:
                    inputs["like"] = (Reference(like),)
                elif entry.value.if_maps:
                    raise entry.fail("needs 'like', the source that may be a map set", "if_maps")
            elif mesh is not None and file.endswith(MODELS):
                inputs["mesh"] = self._input(dataclasses.replace(entry, value=mesh), _MESH, "mesh")
            elif not only or like is not None or mesh is not None:
                raise entry.fail(
                    "must be a source or STEP.OUTPUT, got a mapping, which a folder takes, a PNG with 'like', "
                    "a .glb, .usda or .mtlx with 'mesh'"
                )
        other = file.removesuffix("/") if file.endswith("/") else f"{file}/"
        files = list(self.draft.exports)
        if other in files[: files.index(file)]:
            raise entry.fail(f"'{other}' is another export; a file and a folder cannot have the same name")
        inputs["image"] = self._references(dataclasses.replace(entry, value=image))
        for reference in inputs["image"]:
            self._check_export(file, entry, reference)
        return Taker(inputs, required={"image", "mesh"}, only=only)

    def _exports(self, there: Presence) -> tuple[dict[str, Reference], dict[str, str], dict[str, Reference]]:
        """What is written to which file, the sources that folders of maps and PNGs are like, meshes of models."""
        exports, likes, surfaces = {}, {}, {}
        for file in self.draft.exports:
            if file not in there.lacking:
                taken = there.inputs(file)
                exports[file] = taken["image"]
                if "like" in taken:
                    likes[file] = taken["like"].name
                if "mesh" in taken:
                    surfaces[file] = taken["mesh"]
        # a model of a picture that another one lays on a mesh
        meshes = {exports[file]: mesh for file, mesh in surfaces.items()}
        of_models = {
            file: meshes[made] for file, made in exports.items() if file.endswith(MODELS) and made in meshes
        }
        return exports, likes, of_models | surfaces

    def _check_likes(
        self, likes: Mapping[str, str], exports: Mapping[str, Reference], steps: Mapping[str, Step]
    ) -> None:
        """What is written like each file of a set must be of its items."""
        for file, like in likes.items():
            reference = exports[file]
            scope = "shared" if reference.output is None else steps[reference.name].scope
            if isinstance(self.sources[like], Each) and scope != "item" and reference.name != like:
                raise self.fail(f"exports.{file}.like", f"'{like}' is a set, but {reference} exists only once")

    def _check_export(self, file: str, entry: Entry, reference: Reference) -> None:
        made = self._type_of(reference)
        if file.endswith("/"):
            if made.plain is not Image:
                raise entry.fail(f"must be an image, whose maps it will hold, but {reference} is {made}")
            return
        kind = made.text or ("array" if made.is_array else "value")
        writer = writer_of(file)
        if writer is None:
            raise entry.fail(f"must end in {WRITTEN}")
        takes = writer.takes
        if kind != ("array" if takes in ("picture", "image") else takes):
            raise entry.fail(f"must be {_EXPORTABLE[takes]}, but {reference} is {made}")
        if takes == "picture" and not made.is_picture:
            raise entry.fail(f"must be a picture, but {reference} is {made}; export it as .exr")
        if takes == "image" and made.plain is not Image:
            raise entry.fail(f"must be an image, whose maps it will bind, but {reference} is {made}")
        writer.check_installed(f"{entry.path}: {entry.place}")
        folder = f"{file.removesuffix(writer.suffix)}{writer.companions}"
        if writer.companions and {folder, f"{folder}/"} & set(self.draft.exports):
            raise entry.fail(f"its maps are written into '{folder}', which is another export")

    def _add_layout(self, delivery: Delivery, exports: dict[str, Reference]) -> None:
        """With a layout there is a folder of maps: those of the flow, or one of its main image."""
        if delivery.layout is None:
            return
        if delivery.layout == "arnold":
            tx = writer_of(".tx")
            if tx is not None:
                tx.check_installed("--layout arnold")
        if any(file.endswith("/") for file in exports):
            return
        for file, reference in exports.items():
            if file.startswith("texture.") and self._type_of(reference).plain is Image:
                exports[_MAPS] = reference
                return
        raise refused(f"--layout: {self.draft.name} exports no picture as texture.* and no folder of maps")


def _why_skipped(lacks: Sequence[str] | None) -> str:
    """Why a step is left out."""
    return f"no {_and(lacks)}" if lacks else "nothing takes its result"


def _and(names: Sequence[str]) -> str:
    *first, last = dict.fromkeys(names)
    return f"{', '.join(first)} and {last}" if first else last


def absolute(reference: str, base: Path) -> str:
    """A source's reference, with a relative path resolved against ``base``."""
    if re.match(r"[a-z][a-z0-9]+:", reference):
        return reference
    return resolved(reference, base)
