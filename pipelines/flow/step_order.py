"""In which order steps run, and how often: once, once an item, or once after all items."""

from __future__ import annotations

import dataclasses
import graphlib
import heapq
from collections.abc import Mapping, Sequence

from texloom.pipelines.errors import refused
from texloom.pipelines.flow.draft import Draft
from texloom.pipelines.flow.model import Each, Scope, Step, flat
from texloom.pipelines.flow.shipped import flow_word


def in_order(steps: Mapping[str, Step], draft: Draft) -> dict[str, Step]:
    """The steps, as in the file as far as inputs allow; `InputError` where they take what they make."""
    try:
        graphlib.TopologicalSorter({name: step.needs for name, step in steps.items()}).prepare()
    except graphlib.CycleError as error:
        raise refused(f"{flow_word(draft.path)}: steps: a cycle: {' <- '.join(error.args[1])}") from None
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
    return {name: steps[name] for name in order}


def scoped_steps(
    steps: Mapping[str, Step], sources: Mapping[str, str | Each], seeds: Sequence[int], draft: Draft
) -> dict[str, Step]:
    """The steps, in order, each with its scope."""
    scoped: dict[str, Step] = {}
    for name, step in steps.items():
        scoped[name] = dataclasses.replace(step, scope=_scope(step, scoped, sources, seeds, draft))
    for name, step in scoped.items():
        for reference in flat(step.gather):
            if reference.output is not None and scoped[reference.name].scope == "final":
                problem = f"{reference} exists only once; take it as an input"
                raise draft.steps[name].at.fail(problem, "gather")
    return scoped


def _scope(
    step: Step,
    scoped: Mapping[str, Step],
    sources: Mapping[str, str | Each],
    seeds: Sequence[int],
    draft: Draft,
) -> Scope:
    """The scope of a step whose inputs come from those in ``scoped``."""
    taken = [reference for reference in step.inputs.values() if reference.output is not None]
    if step.chosen is not None:
        taken.append(step.chosen)
    scopes = {scoped[reference.name].scope for reference in taken}
    if any(isinstance(sources.get(reference.name), Each) for reference in step.inputs.values()):
        scopes.add("item")
    if len(seeds) > 1 and step.stage.uses_rng and not step.gather:
        scopes.add("item")
    if step.gather:
        scopes.add("final")
    if {"item", "final"} <= scopes:
        one = next(str(r) for r in step.inputs.values() if r.output is None or scoped[r.name].scope == "item")
        problem = f"runs once for all items, but {one} exists for each; take it by 'gather'"
        raise draft.steps[step.name].at.fail(problem)
    return "item" if "item" in scopes else "final" if "final" in scopes else "shared"
