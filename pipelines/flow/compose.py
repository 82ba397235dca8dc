"""Composition of flow files: `include` takes the steps of another flow, `for` and `repeat` make variants of it."""

from __future__ import annotations

import dataclasses
import itertools
import math
import re
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from texloom.pipelines.errors import hint
from texloom.pipelines.flow.conditions import is_condition
from texloom.pipelines.flow.draft import (
    EACH,
    FORMER,
    Change,
    Draft,
    DraftStep,
    Entry,
    changed_export,
    image_of,
    keep,
    step_of,
    texts_of,
    upstream,
)
from texloom.pipelines.flow.finding import find_flow
from texloom.pipelines.flow.schema import (
    EXPORT,
    NAME,
    OPTIONAL,
    REQUIRED,
    SETS,
    SOURCE,
    DeliveryPart,
    FlowPart,
    FolderPart,
    IncludePart,
    SetPart,
    StepPart,
    TakenPart,
    VariantPart,
    is_optional,
    parse_flow,
)
from texloom.pipelines.flow.variants import merged, prune
from texloom.pipelines.yaml import read_document
from texloom.stages.vocabulary.declare import InputError

STRUCTURAL = ("include", "repeat")
"""the fields that a param of a flow may stand for, besides STEP.PARAM"""
_FOR = "for."
_DEEPEST = 8
_MOST_VARIANTS = 1000
"""of a flow, with those of the files that it includes"""
_MOST_STEPS = 10_000
"""of all variants, with those of the files that they include"""


@dataclasses.dataclass
class Tally:
    """How much has been composed so far, in all files."""

    variants: int = 0
    steps: int = 0

    def add(self, at: Entry, variants: int = 0, steps: int = 0) -> None:
        """Count more; `InputError` where it is too much."""
        self.variants += variants
        self.steps += steps
        if self.variants > _MOST_VARIANTS:
            raise at.fail(f"{self.variants} variants, at most {_MOST_VARIANTS} with those of included files")
        if self.steps > _MOST_STEPS:
            raise at.fail(f"{self.steps} steps, at most {_MOST_STEPS} in all variants and included files")


def compose(
    document: Any,
    path: Path,
    values: Mapping[str, Any],
    stack: tuple[Path, ...] = (),
    tally: Tally | None = None,
) -> Draft:
    """Compose a flow from a document and the files that it includes.

    Parameters
    ----------
    document : what the file at ``path`` holds.
    values : for the flow's params; those that stand for `STRUCTURAL` fields are used here.
    stack : the files that include this one, outermost first.
    tally : what they have composed before it.

    Raises
    ------
    InputError : the structure of a file is wrong, it includes what cannot be, or makes too many variants or steps.
    """
    part = _with_structure(parse_flow(document, path), path, values)
    return _Composer(part, path, values, stack, tally or Tally()).draft()


def is_structural(target: str) -> bool:
    """Whether a target of a param is a `STRUCTURAL` field, or a list of ``for``, as ``for.method``."""
    return target in STRUCTURAL or target.startswith(_FOR)


def _with_structure(part: FlowPart, path: Path, values: Mapping[str, Any]) -> FlowPart:
    """The flow with `STRUCTURAL` fields changed by its params."""
    for name, target in part.params.items():
        if not isinstance(target, str) or not is_structural(target) or name not in values:
            continue
        field, _, listed = target.partition(".")
        value = values[name]
        if field == "for":
            value = {**part.for_, listed: value.split(",") if isinstance(value, str) else value}
        elif field == "include":
            flow = str(Path.cwd() / value) if isinstance(value, str) and Path(value).is_file() else value
            value = part.include.model_dump() | {"flow": flow} if isinstance(part.include, IncludePart) else flow
        checked = parse_flow({field: value}, Path(f"{path}: params.{name}"))
        known = "for_" if field == "for" else field
        part = part.model_copy(update={known: getattr(checked, known)})
    return part


class _Composer:
    """One file, with what it includes."""

    def __init__(
        self, part: FlowPart, path: Path, values: Mapping[str, Any], stack: tuple[Path, ...], tally: Tally
    ):
        self.part = part
        self.tally = tally
        self.path = path
        self.values = values
        self.stack = (*stack, path.resolve())
        self.has_variants = bool(part.for_) or part.repeat is not None

    def entry(self, value: Any, *place: object) -> Entry:
        return Entry(value, self.path, ".".join(map(str, place)))

    def draft(self) -> Draft:
        part = self.part
        if part.for_ and part.repeat is not None:
            raise self.entry(None, "repeat").fail("a flow has either 'for' or 'repeat'")
        if part.repeat is not None:
            self.tally.add(self.entry(None, "repeat"), variants=part.repeat)
            rounds = [f"round_{index + 1}" for index in range(part.repeat)]
            return merged({label: self.variant(None, "", label == rounds[0]) for label in rounds}, are_rounds=True)
        if part.for_:
            draft = merged(
                {label: self.variant(*more) for label, more in self.variants().items()}, are_rounds=False
            )
            listed = {name for name, value in part.for_.items() if isinstance(value, list)}
            draft.params = {name: entry for name, entry in draft.params.items() if name not in listed}
            return draft
        draft = self.variant(None, "")
        prune({"": draft})
        self.check_no_labels(draft)
        return draft

    @staticmethod
    def check_no_labels(draft: Draft) -> None:
        """Refuse `EACH` where there are no variants."""
        problem = f"'{EACH}' is for the labels of 'for' and 'repeat'; the flow has neither"
        for file, entry in draft.exports.items():
            if not EXPORT.fullmatch(file):
                raise entry.fail(problem)
        for step in draft.steps.values():
            if step.joins_variants or EACH in step.draws_as:
                raise step.at.fail(problem)

    def variants(self) -> dict[str, tuple[VariantPart, str]]:
        """Label to what differs, and where that is written."""
        listed = {name: value for name, value in self.part.for_.items() if isinstance(value, list)}
        variants: dict[str, tuple[VariantPart, str]] = {
            label: (part, f"for.{label}.")
            for label, part in self.part.for_.items()
            if isinstance(part, VariantPart)
        }
        if listed and variants:
            raise self.entry(None, "for", *variants).fail("either lists of values or variants by label, not both")
        for name, listing in listed.items():
            if not listing:
                raise self.entry(None, "for", name).fail("must list at least one value, got []")
        count = math.prod(map(len, listed.values())) if listed else len(variants)
        self.tally.add(self.entry(None, "for"), variants=count)
        if listed:
            for values in itertools.product(*listed.values()):
                chosen = dict(zip(listed, values, strict=True))
                label = "_".join(_label(name, value) for name, value in chosen.items())
                included = {"include": chosen.pop("include")} if "include" in chosen else {}
                part = parse_flow({**included, "with": chosen}, Path(f"{self.path}: for"))
                if label in variants:
                    raise self.entry(None, "for").fail(f"two variants would be called '{label}'")
                variants[label] = part, "for: "
        return variants

    def variant(self, variant: VariantPart | None, place: str, first: bool = True) -> Draft:
        """The flow of one variant, or of the only one; references to the round before are kept."""
        part = self.part
        parts = [(part, ""), *([(variant, place)] if variant is not None else [])]
        draft = self.included(parts, first)
        self.set_params(draft, part.with_, "with", draft.params)
        included = dict(draft.params)
        if self.has_variants and (part.exports or (variant is not None and variant.exports)):
            draft.exports = {}
        for name, targets in part.params.items():
            listed = [targets] if isinstance(targets, str) else targets
            draft.params[name] = self.entry(listed, "params", name)
        for one, where in parts:
            if where:
                # What the file names may be a param of the merged flow, which reaches no step of this one.
                reaching = {name: entry for name, entry in draft.params.items() if _reaches(entry, draft)}
                self.set_params(draft, one.with_, f"{where}with", draft.params | included | reaching)
            for name, source in one.sources.items():
                entry = self.entry(source, f"{where}sources", name)
                if source is None and name not in draft.sources:
                    raise entry.fail(f"{SOURCE}, got nothing")
                if source is None and not is_optional(draft.sources[name].value or OPTIONAL):
                    raise entry.fail("is not optional in the included flow, so that it cannot be left out")
                before = draft.sources.get(name)
                if before is not None and (before.value is None or is_optional(before.value)):
                    del draft.sources[name]  # one that the file needs has the place that the file gives it
                draft.sources[name] = entry
            for name, step in one.steps.items():
                self.set_step(draft, name, step, f"{where}steps.{name}")
            for file, export in one.exports.items():
                if export is None and file in draft.exports:
                    del draft.exports[file]
                else:
                    draft.exports[file] = self.entry(export, f"{where}exports", file)
        _take_last_rounds(draft)
        if self.has_variants or len(self.stack) == 1:
            field = "for" if part.for_ else "steps" if part.repeat is None else "repeat"
            self.tally.add(self.entry(None, field), steps=len(draft.steps))
        if part.repeat is not None and first:
            draft.steps = {name: step.with_references(_unless_former) for name, step in draft.steps.items()}
        return draft

    def options(self, given: DeliveryPart | TakenPart | None, field: str) -> dict[str, Entry]:
        texts = {} if given is None else given.model_dump(exclude_none=True)
        return {name: self.entry(text, f"{field}.{name}") for name, text in texts.items()}

    def included(self, parts: list[tuple[Any, str]], first: bool) -> Draft:
        """The draft of the flow that is included, or an empty one."""
        part = self.part
        own = Draft(part.flow or self.path.stem, self.path, tuple(part.seed) if part.seed else None)
        own.runner = None if part.runner is None else self.entry(part.runner, "runner")
        own.keep = part.keep
        own.delivery, own.part = self.options(part.delivery, "delivery"), self.options(part.part, "part")
        fields: dict[str, Any] = {}
        where = ""
        for one, place in parts:
            if one.include is not None:
                more = one.include if isinstance(one.include, IncludePart) else IncludePart(flow=one.include)
                fields |= {name: getattr(more, name) for name in more.model_fields_set}
                where = place
        if not fields:
            return own
        at = self.entry(None, f"{where}include")
        if fields.get("flow") is None:
            raise at.fail("which flow? give its name or file as 'flow'")
        base = self.loaded(at, fields["flow"], [one.with_ for one, _ in parts])
        if fields.get("steps") is not None:
            _select(base, fields["steps"], at)
        inputs = fields.get("inputs", {})
        bound = {name: self.entry(text, f"{where}include.inputs", name) for name, text in inputs.items()}
        _bind(base, bound, first)
        base.name, base.path = own.name, own.path
        base.seed, base.runner = own.seed or base.seed, own.runner or base.runner
        base.keep = own.keep or base.keep
        base.delivery |= own.delivery
        base.part |= own.part
        chosen = None
        if fields.get("only") is not None:
            chosen = self.entry(fields["only"], f"{where}include", "only")
        base.steps = {
            name: dataclasses.replace(step, own=False, chosen=step.chosen or chosen)
            for name, step in base.steps.items()
        }
        return base

    def loaded(self, at: Entry, flow: str, values: list[dict[str, Any]]) -> Draft:
        try:
            path = find_flow(flow, self.path.parent)
        except InputError as error:
            raise at.fail(str(error)) from None
        if path.resolve() in self.stack or len(self.stack) > _DEEPEST:
            raise at.fail(f"{flow} includes itself" if path.resolve() in self.stack else "nested too deeply")
        known = dict(itertools.chain(self.values.items(), *(more.items() for more in values)))
        base = compose(read_document(path), path, known, self.stack, self.tally)
        base.included = [path, *base.included]
        return base

    def set_params(self, draft: Draft, values: Mapping[str, Any], place: str, known: Mapping[str, Entry]) -> None:
        """Give values to params that are ``known``, by what these stand for."""
        for name, value in values.items():
            entry = self.entry(value, place, name)
            if name not in known:
                raise entry.fail(f"the flow has no param '{name}'{hint(str(name), known)}")
            for target in known[name].value:
                step, _, param = target.partition(".")
                if step in draft.steps:
                    before = draft.steps[step]
                    when = tuple(change.without((), (param,)) for change in before.when)
                    params = {**before.params, param: entry}
                    draft.steps[step] = dataclasses.replace(before, params=params, when=when)

    def set_step(self, draft: Draft, name: str, part: StepPart | None, place: str) -> None:
        """Add a step, or change one that is there."""
        at = self.entry(None, place)
        before = draft.steps.get(name)
        if part is None:
            if before is None:
                raise at.fail("must be a mapping with 'stage', 'inputs' and 'params', got nothing")
            del draft.steps[name]
            return
        fields: dict[str, dict[str, Entry]] = {
            field: {key: self.entry(value, place, field, key) for key, value in getattr(part, field).items()}
            for field in ("inputs", "gather", "params")
        }
        when = self.when(draft, part, place)
        only = None if part.only is None else self.entry(part.only, place, "only")
        chosen = None
        if only is not None and "." in only.value and not is_condition(only.value):
            only, chosen = None, only
        if only is not None and only.value != SETS and not is_condition(only.value):
            self.check_condition(draft, only)
        if before is None or part.stage is not None:
            stage = self.entry(part.stage, place, "stage")
            inputs, gather, params = fields.values()
            draft.steps[name] = DraftStep(
                at, stage, inputs, gather, params, part.draws_as or name, when, only, chosen
            )
            return
        changed = fields["inputs"] | fields["gather"]
        known = {**before.inputs, **before.gather}
        for key, entry in changed.items():
            if entry.value is None and key not in known:
                raise entry.fail(f"the step takes no '{key}' that could be left out{hint(key, known)}")

        def updated(before: Mapping[str, Entry], entry: Mapping[str, Entry]) -> dict[str, Entry]:
            kept = {key: value for key, value in before.items() if key not in changed}
            return kept | {key: value for key, value in entry.items() if value.value is not None}

        draft.steps[name] = dataclasses.replace(
            before,
            inputs=updated(before.inputs, fields["inputs"]),
            gather=updated(before.gather, fields["gather"]),
            params={**before.params, **fields["params"]},
            draws_as=part.draws_as or before.draws_as,
            when=(*(change.without(changed, fields["params"]) for change in before.when), *when),
            only=only or before.only,
            chosen=chosen or before.chosen,
        )

    def when(self, draft: Draft, part: StepPart, place: str) -> tuple[Change, ...]:
        """What changes in a step where sources are there."""
        changes = []
        for source, change in part.when.items():
            where = f"{place}.when.{source}"
            condition = Entry(source, self.path, where)
            self.check_condition(draft, condition)
            inputs = {key: self.entry(value, where, "inputs", key) for key, value in change.inputs.items()}
            params = {key: self.entry(value, where, "params", key) for key, value in change.params.items()}
            changes.append(Change(condition, inputs, params))
        return tuple(changes)

    @staticmethod
    def check_condition(draft: Draft, entry: Entry) -> None:
        if entry.value not in draft.sources:
            raise entry.fail(f"no source '{entry.value}'{hint(entry.value, draft.sources)}")


def _label(name: str, value: Any) -> str:
    """The label of the variant of a param's value."""
    if isinstance(value, str) and NAME.fullmatch(value):
        return value
    if name == "include":
        value = Path(str(value)).stem
    words = re.sub(r"[^a-z0-9]+", "_", str(value).lower()).strip("_")
    return words if NAME.fullmatch(words) else f"{name}_{words}"


def _reaches(param: Entry, draft: Draft) -> bool:
    """Whether a param of a flow is one of a step of a draft."""
    return any(target.partition(".")[0] in draft.steps for target in param.value)


def _unless_former(entry: Entry) -> Entry | None:
    former = isinstance(entry.value, str) and entry.value.startswith(FORMER)
    return None if former else entry


def _take_last_rounds(draft: Draft) -> None:
    """References to a step of an included flow's rounds are to that of the last one."""

    def change(entry: Entry) -> Entry:
        name, dot, output = entry.value.partition(".") if isinstance(entry.value, str) else ("", "", "")
        if name in draft.steps or name not in draft.last:
            return entry
        return dataclasses.replace(entry, value=f"{draft.last[name]}{dot}{output}")

    _change_references(draft, change)


def _change_references(draft: Draft, change: Callable[[Entry], Entry | None]) -> None:
    """Change all references of steps and exports."""
    draft.steps = {name: step.with_references(change) for name, step in draft.steps.items()}
    exports = {file: changed_export(entry, change) for file, entry in draft.exports.items()}
    draft.exports = {file: entry for file, entry in exports.items() if entry is not None}


def _select(draft: Draft, names: list[str], at: Entry) -> None:
    """Keep the steps called ``names``, those whose results they take, and what refers to them."""
    for index, name in enumerate(names):
        if name not in draft.steps:
            raise at.fail(f"no step '{name}'{hint(name, draft.steps)}", "steps", index)
    kept = upstream(draft.steps, names)
    exports = {
        file: changed_export(entry, lambda one: one if step_of(one.value) in {"", *kept} else None)
        for file, entry in draft.exports.items()
        if set(map(step_of, texts_of(image_of(entry.value)))) & kept
    }
    draft.exports = {file: entry for file, entry in exports.items() if entry is not None}
    keep(draft, kept)
    taken = {text for step in draft.steps.values() for text in step.references()}
    sets = [entry.value for entry in draft.sources.values() if isinstance(entry.value, SetPart)]
    taken |= {part.pair for part in sets if part.pair is not None}
    draft.sources = {name: entry for name, entry in draft.sources.items() if name in taken}


def _bind(draft: Draft, inputs: Mapping[str, Entry], first: bool) -> None:
    """Replace sources of an included flow by other references."""
    bound = {}
    replaced = {name for name, entry in inputs.items() if _source_in(entry) is None}
    for name, entry in inputs.items():
        if name not in draft.sources or draft.sources[name].value is None:
            raise entry.fail(f"the included flow has no source '{name}'{hint(str(name), draft.sources)}")
        if not (first and _unless_former(entry) is None):
            bound[name] = entry
            del draft.sources[name]
    for name, source in draft.sources.items():
        part = source.value
        if not isinstance(part, SetPart) or part.pair is None:
            continue
        if is_optional(part) and part.pair in replaced:
            # what belongs to a file belongs to no result
            draft.sources[name] = dataclasses.replace(source, value=None)
        elif part.pair in bound and (part.is_required or is_optional(part)):
            partner = _source_in(bound[part.pair])
            alone = part.model_copy(update={"pair": partner}) if partner is not None else REQUIRED
            draft.sources[name] = dataclasses.replace(source, value=alone)

    def change(entry: Entry) -> Entry:
        return bound.get(entry.value, entry) if isinstance(entry.value, str) else entry

    _change_references(draft, change)
    for file, entry in list(draft.exports.items()):
        if isinstance(entry.value, FolderPart) and entry.value.like in bound:
            like = _source_in(bound[entry.value.like])
            if like is not None:
                part = entry.value.model_copy(update={"like": like})
                draft.exports[file] = dataclasses.replace(entry, value=part)
            elif entry.value.if_maps:  # a result is no map set
                del draft.exports[file]


def _source_in(entry: Entry) -> str | None:
    """The source that a reference is; None where it is a step's output, or a list."""
    return entry.value if isinstance(entry.value, str) and "." not in entry.value else None
