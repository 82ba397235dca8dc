"""Variants of a flow merged into one flow, which has steps that are equal in all variants once."""

from __future__ import annotations

import dataclasses
import itertools
from collections.abc import Mapping
from typing import Any

from texloom.pipelines.errors import shown
from texloom.pipelines.flow.draft import (
    EACH,
    FORMER,
    Draft,
    DraftStep,
    Entry,
    image_of,
    keep,
    step_of,
    texts_of,
    upstream,
)
from texloom.pipelines.flow.schema import NAME, FolderPart


def merged(drafts: Mapping[str, Draft], are_rounds: bool) -> Draft:
    """The variants, by label, as one flow; of `are_rounds`, each may refer to the one before."""
    return _Merger(drafts, are_rounds).draft()


def prune(drafts: Mapping[str, Draft]) -> None:
    """Drop what is included and nothing needs."""
    references = [text for draft in drafts.values() for step in draft.steps.values() for text in step.references()]
    former = {step_of(text.removeprefix(FORMER)) for text in references if text.startswith(FORMER)}
    referenced = set(map(step_of, references))
    for label, draft in drafts.items():
        needed = {
            name for name, step in draft.steps.items() if step.own or f"{label}_{name}" in referenced
        } | former
        made = [text for entry in draft.exports.values() for text in texts_of(image_of(entry.value))]
        needed |= set(map(step_of, made))
        keep(draft, upstream(draft.steps, needed))


class _Merger:
    def __init__(self, drafts: Mapping[str, Draft], are_rounds: bool):
        self.drafts = drafts
        self.labels = list(drafts)
        self.are_rounds = are_rounds
        names = dict.fromkeys(name for draft in drafts.values() for name in draft.steps)
        self.once = _shared(names, drafts)
        self.lacking = _lacking(drafts, self.once)
        prune(drafts)
        self.spread = {
            name: {label: f"{label}_{name}" for label in self.labels if name in drafts[label].steps}
            for name in names
            if name not in self.once
        }

    def draft(self) -> Draft:
        first = self.drafts[self.labels[0]]
        whole = Draft(
            first.name,
            first.path,
            first.seed,
            first.runner,
            first.delivery,
            first.part,
            lacking=self.lacking,
            keep=first.keep,
        )
        for label, draft in self.drafts.items():
            whole.included += [path for path in draft.included if path not in whole.included]
            whole.sources = {**draft.sources, **whole.sources}
            self.add_steps(whole, label)
        for file in dict.fromkeys(file for draft in self.drafts.values() for file in draft.exports):
            whole.exports |= self.exports(file)
        whole.spread = {name: dict(names) for name, names in self.spread.items()}
        if self.are_rounds:
            last = self.labels[-1]
            whole.last = {name: names[last] for name, names in self.spread.items() if last in names}
        for label, draft in self.drafts.items():
            for name, names in draft.spread.items():
                renamed = {f"{label}_{inner}": self.resolved(label, f"{old}.")[:-1] for inner, old in names.items()}
                whole.spread.setdefault(name, {}).update(renamed)
        for name in dict.fromkeys(name for draft in self.drafts.values() for name in draft.params):
            param = self.param(name)
            if name not in self.lacking:
                whole.params[name] = param
            elif param.value:
                whole.partial[name] = param
        return whole

    def add_steps(self, whole: Draft, label: str) -> None:
        """Add the steps of a variant, those that exist once unless they are there."""
        for name, step in self.drafts[label].steps.items():
            if name not in self.once:
                new = self.spread[name][label]
                if new in whole.steps or new in self.once or not NAME.fullmatch(new):
                    raise step.at.fail(f"as that of {label} it would be called '{new}', which cannot be")
                whole.steps[new] = self.of_variant(step, label)
            elif name not in whole.steps:
                whole.steps[name] = self.joined(step)

    def resolved(self, label: str, text: Any) -> Any:
        """A reference of a variant, or a list of them, in the flow of all."""
        if isinstance(text, list):
            return [self.resolved(label, one) for one in text]
        if not isinstance(text, str):
            return text
        if self.are_rounds and text.startswith(FORMER):
            text, label = text.removeprefix(FORMER), self.labels[max(self.labels.index(label) - 1, 0)]
        name, dot, output = text.partition(".")
        return f"{self.spread[name][label]}{dot}{output}" if dot and label in self.spread.get(name, ()) else text

    def of_variant(self, step: DraftStep, label: str) -> DraftStep:
        """A step that differs between variants, in one."""

        def change(entry: Entry) -> Entry:
            return dataclasses.replace(entry, value=self.resolved(label, entry.value))

        draws_as = step.draws_as.replace(EACH, label)
        if self.are_rounds and label != self.labels[0]:
            draws_as = f"{label}_{draws_as}"
        return dataclasses.replace(step.with_references(change), draws_as=draws_as)

    def joined(self, step: DraftStep) -> DraftStep:
        """A step that exists once; what it gathers of all variants is by their labels."""
        last = self.labels[-1]

        def by_label(label: str, reference: Any) -> dict[str, Any]:
            if label != EACH:
                return {label: self.resolved(last, reference)}
            each = reference if isinstance(reference, dict) else dict.fromkeys(self.labels, reference)
            lacking = [one for one in self.labels if one not in each]
            if lacking:
                raise step.at.fail(f"'{EACH}' of {shown(reference)} has no '{lacking[0]}'", "gather")
            return {one: self.resolved(one, each[one]) for one in self.labels}

        def gathered(value: Any) -> Any:
            if not isinstance(value, dict):
                return self.resolved(last, value)
            return dict(itertools.chain(*(by_label(*entry).items() for entry in value.items())))

        for entry in step.inputs.values():
            if not self.are_rounds and self.resolved(last, entry.value) != entry.value:
                problem = f"runs once for all variants, but {entry.value} exists for each; take it by 'gather'"
                raise entry.fail(f"the step {problem}")
        gather = {
            name: dataclasses.replace(entry, value=gathered(entry.value)) for name, entry in step.gather.items()
        }
        taking = step.with_references(
            lambda entry: dataclasses.replace(entry, value=self.resolved(last, entry.value))
        )
        return dataclasses.replace(taking, gather=gather)

    def exports(self, file: str) -> dict[str, Entry]:
        """An export of the variants: one for all, the last round's, or one for each with its label."""
        by_label = {}
        for label, draft in self.drafts.items():
            if file in draft.exports:
                value = draft.exports[file].value
                if isinstance(value, FolderPart):
                    resolved = {
                        name: self.resolved(label, getattr(value, name)) for name in ("image", "mesh", "only")
                    }
                    value = value.model_copy(update=resolved)
                else:
                    value = self.resolved(label, value)
                by_label[label] = dataclasses.replace(draft.exports[file], value=value)
        last = list(by_label.values())[-1]
        if EACH in file:
            return {file.replace(EACH, label): entry for label, entry in by_label.items()}
        if self.are_rounds or all(entry.value == last.value for entry in by_label.values()):
            return {file: last}
        return {f"{label}_{file}": entry for label, entry in by_label.items()}

    def param(self, name: str) -> Entry:
        """A param of all variants that have it; those whose steps nobody needs have lost it."""
        entries = {label: draft.params[name] for label, draft in self.drafts.items() if name in draft.params}
        targets = [self.resolved(label, target) for label, entry in entries.items() for target in entry.value]
        return dataclasses.replace(next(iter(entries.values())), value=list(dict.fromkeys(targets)))


def _lacking(drafts: Mapping[str, Draft], once: set[str]) -> dict[str, list[str]]:
    """Steps, but for those that exist ``once``, and params, with the labels of the variants that lack them."""
    steps = dict.fromkeys(name for draft in drafts.values() for name in draft.steps if name not in once)
    params = dict.fromkeys(name for draft in drafts.values() for name in draft.params)
    lacking = {name: [label for label, draft in drafts.items() if name not in draft.steps] for name in steps}
    lacking |= {name: [label for label, draft in drafts.items() if name not in draft.params] for name in params}
    return {name: labels for name, labels in lacking.items() if labels}


def _shared(names: Mapping[str, Any], drafts: Mapping[str, Draft]) -> set[str]:
    """The steps that are the same in all variants, or that receive the results of all."""
    steps = {name: [draft.steps[name] for draft in drafts.values() if name in draft.steps] for name in names}
    joining = {name for name, (first, *_) in steps.items() if first.joins_variants}
    once = joining | {
        name
        for name, (first, *others) in steps.items()
        if len(others) + 1 == len(drafts) and all(map(first.same, others)) and EACH not in first.draws_as
    }
    while True:
        differing = {
            name
            for name in once - joining
            if any(step_of(text) in steps and step_of(text) not in once for text in steps[name][0].references())
        }
        if not differing:
            return once
        once -= differing
