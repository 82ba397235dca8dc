"""Loading of flows: YAML files that connect stages, checked completely before anything runs."""

from __future__ import annotations

import dataclasses
import difflib
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from texloom.pipelines.errors import hint, refused, shown
from texloom.pipelines.flow.compose import compose
from texloom.pipelines.flow.conditions import conditions, is_condition
from texloom.pipelines.flow.connections import Connections
from texloom.pipelines.flow.draft import Draft, Entry, keep, texts_of
from texloom.pipelines.flow.finding import find_flow
from texloom.pipelines.flow.model import Each, Flow, Overrides, Reference, Skipped, Step, intermediate_steps
from texloom.pipelines.flow.presence import Presence
from texloom.pipelines.flow.runner import choose_runner
from texloom.pipelines.flow.schema import (
    EXPORT,
    FILE_NAME,
    REQUIRED,
    FolderPart,
    SetPart,
    is_optional,
    parse_flow,
)
from texloom.pipelines.flow.shipped import flow_word
from texloom.pipelines.flow.source_choice import SourceChoice
from texloom.pipelines.flow.step_order import in_order, scoped_steps
from texloom.pipelines.flow.step_params import StepParams, document_params
from texloom.pipelines.media.delivery import Delivery, Fail, of_option, parse_delivery
from texloom.pipelines.media.part import WHOLE, Part, parse_part
from texloom.pipelines.media.writers.writer_registry import MODELS, writer_of
from texloom.pipelines.yaml import parse_yaml, read_document
from texloom.stages.lookup.registry import find_stage, stage_names
from texloom.stages.vocabulary.arrays import Image
from texloom.stages.vocabulary.declare import InputError, Stage

__all__ = ["check_flow", "find_flow", "load_flow", "nearest_stage"]

_MAPS = "maps/"
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
    if first is None or flow.kinds.get(first) == "mesh":
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
    """A hint at the stage that ``name``, with or without its group, may mean; else at their list."""
    known = stage_names()
    by_word = {stage.rpartition(".")[2]: stage for stage in known}
    close = difflib.get_close_matches(name.rpartition(".")[2], by_word, n=1, cutoff=0.6)
    return f"; did you mean '{by_word[close[0]]}'?" if close else "; `texloom stages` lists them"


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
        self.choice = SourceChoice(draft, overrides)

    def fail(self, place: str, problem: str) -> InputError:
        return refused(f"{flow_word(self.path)}: {place}: {problem}")

    def flow(self) -> Flow:
        draft = self.draft
        self._check_sources()
        self.stages = {name: self._stage(step.stage) for name, step in draft.steps.items()}
        connections = Connections(draft, self.stages, self.dropped)
        takers = {name: connections.of_step(name, step) for name, step in draft.steps.items()}
        takers |= {file: connections.of_export(file, entry) for file, entry in draft.exports.items()}
        self._leave_out(Presence(takers, self.dropped, is_set=True))
        self.sources, missing, left_out = self.choice.named()
        seeds = self._seeds()
        is_set = len(seeds) > 1 or any(isinstance(source, Each) for source in self.sources.values())
        there = Presence(takers, {*left_out, *self.dropped}, is_set)
        takers |= {
            name: connections.changed(name, step, there, self.sources)
            for name, step in draft.steps.items()
            if step.when
        }
        wanted = conditions(draft.steps.values(), self.stages)
        unmet = StepParams(draft, self.stages, {}).unmet(wanted, self.values)
        there = Presence(takers, {*left_out, *self.dropped, *unmet}, is_set, there)
        self._check_given(there)
        self._check_asked(there)
        reasons = {name: _why_skipped(there.lacking.get(name)) for name in draft.steps if not there.is_there(name)}
        deciding = {condition.step for condition in wanted.values()}  # their params may be given at any rate
        refusing = {name: reason for name, reason in reasons.items() if name not in deciding}
        step_params = StepParams(draft, self.stages, refusing)
        flow_params = step_params.of_flow()
        params = step_params.checked(self.values)
        steps = {
            name: Step(
                name,
                self.stages[name],
                there.inputs(name),
                params[name],
                there.gathered(name),
                step.draws_as,
                chosen=there.chosen(takers[name].chosen),
            )
            for name, step in draft.steps.items()
            if there.is_there(name)
        }
        if not steps:
            raise self.fail("steps", "there must be at least one step")
        self._check_labels(steps)
        self._check_documents(steps, step_params.given(self.values))
        steps = scoped_steps(in_order(steps, draft), self.sources, seeds, draft)
        delivery = self.delivery
        exports, likes, surfaces = self._exports(there)
        self._add_layout(draft.name, delivery, exports, likes, connections, steps)
        folders = {file: one.value for file, one in draft.exports.items() if isinstance(one.value, FolderPart)}
        of_maps = tuple(file for file, part in folders.items() if file in exports and part.if_maps)
        if_made = tuple(file for file, part in folders.items() if file in exports and part.if_made)
        self._check_likes(likes, exports, steps, of_maps)
        declared = None if draft.runner is None else draft.runner.value
        runner = choose_runner(declared, self.overrides.runner, self.fail)
        chosen = self.choice.chosen()
        own = tuple(name for name in self.sources if chosen and name not in chosen and name not in missing)
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
        is_final = (self.overrides.keep or draft.keep) == "final"
        written = [*exports.values(), *surfaces.values()]
        overrides = dataclasses.replace(self.overrides, params=step_params.texts(self.overrides.params))
        return Flow(
            draft.name, self.path, seeds, self.sources, steps, exports, runner, likes, surfaces, connections.kinds,
            of_maps, if_made, own, tuple(draft.included), flow_params, missing, left_out, overrides,
            delivery=delivery, skipped=skipped, unwritten=unwritten, optional=optional,
            intermediate=intermediate_steps(steps, written) if is_final else frozenset(),
        )  # fmt: skip

    def _check_sources(self) -> None:
        """Set aside the sources that are left out for good, and check names."""
        draft = self.draft
        self.dropped = {name for name, entry in draft.sources.items() if entry.value is None}
        kept = [(name, entry) for name, entry in draft.sources.items() if name not in self.dropped]
        # the first source is the one that a command's picture stands for
        draft.sources = dict(sorted(kept, key=lambda item: is_optional(item[1].value)))
        self.choice.chosen()
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

    def _seeds(self) -> tuple[int, ...]:
        if isinstance(self.overrides.seeds, Sequence):
            return tuple(self.overrides.seeds)
        seeds = self.draft.seed or (0,)
        if self.overrides.seeds is not None:
            return tuple(seeds[0] + index for index in range(self.overrides.seeds))
        return seeds

    @staticmethod
    def _stage(entry: Entry) -> Stage:
        name = entry.value
        if not isinstance(name, str):
            raise entry.fail(f"must name a stage, got {shown(name)}")
        try:
            return find_stage(name)
        except KeyError:
            raise entry.fail(f"no stage '{name}'{nearest_stage(name)}") from None

    def _check_labels(self, steps: Mapping[str, Step]) -> None:
        """The labels on which steps depend are those of the choices."""
        for name, step in steps.items():
            chosen, at = step.chosen, self.draft.steps[name].chosen
            labels = () if chosen is None else dict(steps[chosen.name].params)["labels"]
            if chosen is not None and at is not None and chosen.output not in labels:
                problem = f"'{chosen.name}' has no label '{chosen.output}'"
                raise at.fail(problem + hint(str(chosen.output), labels))

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
                    is_chosen = taken.name in self.choice.chosen() and source.value != REQUIRED
                    outer, inner = depths.get(source.path, 0), depths.get(entry.path, 0)
                    if outer < inner or (outer == inner and is_chosen):
                        raise self._foreign_document(f"{name}.{param}", taken.name, entry)

    def _foreign_document(self, target: str, source: str, entry: Entry) -> InputError:
        short = next((one for one, targets in self.draft.params.items() if target in targets.value), target)
        problem = f"{shown(entry.value)} of {entry.path.name} describes its example and not another '{source}'"
        studio = "; `texloom studio` makes one" if short.endswith("geometry") else ""
        return refused(f"sources.{source}: {short}: {problem}; give --set {short}=FILE{studio}")

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
        self,
        likes: Mapping[str, str],
        exports: Mapping[str, Reference],
        steps: Mapping[str, Step],
        of_maps: Sequence[str],
    ) -> None:
        """What is written like each file of a set must be of its items, or only ask whether all have maps."""
        for file, like in likes.items():
            reference = exports[file]
            if file not in of_maps and not self._is_one_each(like, reference, steps):
                raise self.fail(f"exports.{file}.like", f"'{like}' is a set, but {reference} exists only once")

    def _is_one_each(self, like: str, reference: Reference, steps: Mapping[str, Step]) -> bool:
        """Whether there is one of a source for each of what is exported."""
        scope = "shared" if reference.output is None else steps[reference.name].scope
        return not isinstance(self.sources[like], Each) or scope == "item" or reference.name == like

    def _add_layout(
        self,
        name: str,
        delivery: Delivery,
        exports: dict[str, Reference],
        likes: dict[str, str],
        connections: Connections,
        steps: Mapping[str, Step],
    ) -> None:
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
            if file.startswith("texture.") and connections.type_of(reference).plain is Image:
                exports[_MAPS] = reference
                first = next(iter(self.sources), None)  # of a set that is gathered, it is like none of the others
                fitting = (one for one in self.sources if self._is_one_each(one, reference, steps))
                is_gathered = first is not None and not self._is_one_each(first, reference, steps)
                if (like := likes.get("texture.png") or (None if is_gathered else next(fitting, None))) is not None:
                    likes[_MAPS] = like
                return
        raise refused(f"--layout: {name} exports no picture as texture.* and no folder of maps")


def _why_skipped(lacks: Sequence[str] | None) -> str:
    """Why a step is left out."""
    if not lacks:
        return "nothing takes its result"
    unmet = [one for one in lacks if is_condition(one)]
    return f"only with {_and(unmet)}" if unmet else f"no {_and(lacks)}"


def _and(names: Sequence[str]) -> str:
    *first, last = dict.fromkeys(names)
    return f"{', '.join(first)} and {last}" if first else last
