"""Flows before their names are checked: every value with the place where it is written."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Collection, Iterable, Mapping
from pathlib import Path
from typing import Any

from texloom.pipelines.errors import refused
from texloom.pipelines.flow.schema import FolderPart
from texloom.pipelines.flow.shipped import flow_word
from texloom.stages.vocabulary.declare import InputError

EACH = "*"
"""in labels, file names and ``draws_as``: the label of each variant"""
FORMER = "former."
"""prefix of references to the round before"""


@dataclasses.dataclass(frozen=True)
class Entry:
    """A value and where it is written."""

    value: Any
    path: Path
    place: str

    def where(self, *more: object) -> str:
        """This place, or one inside of it, for errors."""
        return f"{flow_word(self.path)}: {'.'.join([self.place, *map(str, more)])}"

    def fail(self, problem: str, *more: object) -> InputError:
        """The error of this place, or of one inside of it."""
        return refused(f"{self.where(*more)}: {problem}")


@dataclasses.dataclass(frozen=True)
class Change:
    """What changes in a step where a source is there."""

    source: Entry
    """or what an including flow has bound to it"""
    inputs: Mapping[str, Entry]
    params: Mapping[str, Entry]

    def without(self, inputs: Collection[str], params: Collection[str]) -> Change:
        """The change without that of some inputs and params."""
        kept = {name: entry for name, entry in self.inputs.items() if name not in inputs}
        return Change(self.source, kept, {name: one for name, one in self.params.items() if name not in params})


@dataclasses.dataclass(frozen=True)
class DraftStep:
    """A step before its stage is known."""

    at: Entry
    stage: Entry
    inputs: Mapping[str, Entry]
    """to a reference, or to a list of which the first that is there is taken"""
    gather: Mapping[str, Entry]
    """to the same, or labels to the same"""
    params: Mapping[str, Entry]
    draws_as: str
    when: tuple[Change, ...] = ()
    only: Entry | None = None
    """the source or condition (see `texloom.pipelines.flow.conditions`) without which it is left out, or `SETS`"""
    chosen: Entry | None = None
    """STEP.LABEL: it runs only where that step, a choice, takes the label"""
    own: bool = True
    """written in the file itself; steps that are included run only if something needs them"""

    def references(self) -> list[str]:
        """All references, also those that it takes only where a source is there."""
        changed = [entry for change in self.when for entry in change.inputs.values()]
        entries = [*self.inputs.values(), *self.gather.values(), *changed, *filter(None, [self.only, self.chosen])]
        return [text for entry in entries for text in texts_of(entry.value)]

    @property
    def joins_variants(self) -> bool:
        """Whether it receives the results of all variants, by label."""
        return any(isinstance(entry.value, dict) and EACH in entry.value for entry in self.gather.values())

    def same(self, other: DraftStep) -> bool:
        """Whether both have the same content; file names depend on the folder."""

        def content(step: DraftStep) -> list[Any]:
            parts = [step.inputs, step.gather, *(change.inputs for change in step.when)]
            taken = [{name: entry.value for name, entry in part.items()} for part in parts]
            params = [
                {name: (entry.value, entry.path.parent) for name, entry in part.items()}
                for part in (step.params, *(change.params for change in step.when))
            ]
            conditions = [
                entry.value for entry in (*(change.source for change in step.when), step.only, step.chosen) if entry
            ]
            return [step.stage.value, step.draws_as, taken, params, conditions]

        return content(self) == content(other)

    def with_references(self, change: Callable[[Entry], Entry | None]) -> DraftStep:
        """The step with every reference changed; inputs for which ``change`` gives none are left out."""

        def gathered(entry: Entry) -> Entry | None:
            if not isinstance(entry.value, dict):
                return changed(entry, change)
            labelled = {
                label: changed(dataclasses.replace(entry, value=text), change)
                for label, text in entry.value.items()
            }
            return dataclasses.replace(entry, value={label: new.value for label, new in labelled.items() if new})

        def all_changed(inputs: Mapping[str, Entry]) -> dict[str, Entry]:
            return {name: new for name, entry in inputs.items() if (new := changed(entry, change)) is not None}

        when = [
            Change(source, all_changed(one.inputs), one.params)
            for one in self.when
            if (source := changed(one.source, change)) is not None
        ]
        return dataclasses.replace(
            self,
            inputs=all_changed(self.inputs),
            gather={name: new for name, entry in self.gather.items() if (new := gathered(entry)) is not None},
            when=tuple(when),
            only=None if self.only is None else changed(self.only, change),
            chosen=None if self.chosen is None else changed(self.chosen, change),
        )


@dataclasses.dataclass
class Draft:
    """A composed flow, its names not yet checked."""

    name: str
    path: Path
    seed: tuple[int, ...] | None = None
    runner: Entry | None = None
    delivery: dict[str, Entry] = dataclasses.field(default_factory=dict)
    """options of `texloom.pipelines.media.delivery.parse_delivery`"""
    part: dict[str, Entry] = dataclasses.field(default_factory=dict)
    """options of `texloom.pipelines.media.part.parse_part`"""
    sources: dict[str, Entry] = dataclasses.field(default_factory=dict)
    steps: dict[str, DraftStep] = dataclasses.field(default_factory=dict)
    exports: dict[str, Entry] = dataclasses.field(default_factory=dict)
    params: dict[str, Entry] = dataclasses.field(default_factory=dict)
    """name to the list of STEP.PARAM that take its value"""
    spread: dict[str, dict[str, str]] = dataclasses.field(default_factory=dict)
    """name of a step that differs between variants to their labels and names there"""
    last: dict[str, str] = dataclasses.field(default_factory=dict)
    """name of a step that is there for every round to its name in the last one"""
    lacking: dict[str, list[str]] = dataclasses.field(default_factory=dict)
    """name of a step or param to the variants that have none"""
    partial: dict[str, Entry] = dataclasses.field(default_factory=dict)
    """the params that some variants lack, as ``params``"""
    included: list[Path] = dataclasses.field(default_factory=list)
    """the other files that it was read from"""
    keep: str | None = None
    """which results stay in the store"""


def step_of(text: Any) -> str:
    """The step that a reference names, or nothing."""
    name, dot, _ = text.partition(".") if isinstance(text, str) else ("", "", "")
    return name if dot else ""


def texts_of(value: Any) -> list[str]:
    """The references in a value: itself, one of a list, or those of labels."""
    if isinstance(value, dict):
        return [text for one in value.values() for text in texts_of(one)]
    return [text for text in (value if isinstance(value, list) else [value]) if isinstance(text, str)]


def changed(entry: Entry, change: Callable[[Entry], Entry | None]) -> Entry | None:
    """An entry with each reference changed; nothing where ``change`` leaves none of a list."""
    if not isinstance(entry.value, list):
        return change(entry)
    kept: list[Any] = []
    for text in entry.value:
        new = change(dataclasses.replace(entry, value=text))
        if new is not None:
            kept += new.value if isinstance(new.value, list) else [new.value]
    return dataclasses.replace(entry, value=kept) if kept or not entry.value else None


def changed_export(entry: Entry, change: Callable[[Entry], Entry | None]) -> Entry | None:
    """The same of an export; nothing where nothing is left that it is made of."""
    if not isinstance(entry.value, FolderPart):
        return changed(entry, change)
    parts = {
        name: changed(dataclasses.replace(entry, value=getattr(entry.value, name)), change)
        for name in ("image", "mesh", "only")
        if getattr(entry.value, name) is not None
    }
    if any(part is None for part in parts.values()):
        return None
    update = {name: part.value for name, part in parts.items() if part is not None}
    return dataclasses.replace(entry, value=entry.value.model_copy(update=update))


def image_of(export: Any) -> Any:
    """What an export is made of."""
    return export.image if isinstance(export, FolderPart) else export


def upstream(steps: Mapping[str, DraftStep], names: Iterable[str]) -> set[str]:
    """The steps called ``names`` and all whose results they take."""
    needed: set[str] = set()
    waiting = [name for name in names if name in steps]
    while waiting:
        name = waiting.pop()
        if name not in needed:
            needed.add(name)
            waiting += [step for text in steps[name].references() if (step := step_of(text)) in steps]
    return needed


def keep(draft: Draft, names: set[str]) -> None:
    """Drop all other steps, the targets of params in them, and params whose first target is in one of them."""
    dropped = set(draft.steps) - names
    draft.steps = {name: step for name, step in draft.steps.items() if name in names}
    for name, entry in list(draft.params.items()):
        targets = [target for target in entry.value if step_of(target) not in dropped]
        draft.params[name] = dataclasses.replace(entry, value=targets)
        if targets[:1] != entry.value[:1]:  # it is about that step; the others follow it
            del draft.params[name]
