"""Steps that run only where a choice took their label: which are there, once it is made."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterable

from texloom.pipelines.engine.scope import Scope
from texloom.pipelines.flow.model import Reference, Step
from texloom.pipelines.store.store import Store


def present(step: Step, scope: Scope, store: Store) -> Step | None:
    """The step with what it takes of the results that are there; None if it is passed over, which its scope keeps.

    It is passed over where a choice that is made has not taken it, or where it needs what is passed over.
    """
    reason = _why_not_chosen(step, scope, store)
    inputs = dict(step.inputs)
    for name, given in step.inputs.items():
        gone = None if given.output is None else scope.why_passed_over(given.name)
        if gone is not None and name in step.stage.optional:
            del inputs[name]
        elif reason is None:
            reason = gone
    if reason is not None:
        scope.passed_over[step.name] = reason
        return None
    return step if len(inputs) == len(step.inputs) else dataclasses.replace(step, inputs=inputs)


def may_refuse(step: Step, steps: Iterable[Step], scope: Scope, store: Store) -> bool:
    """Whether another label that was chosen beside a step's goes on where the step refuses what it takes.

    Parameters
    ----------
    steps : all of the flow.
    """
    if step.chosen is None:
        return False
    gone = {step.chosen} | {other.chosen for other in steps if scope.why_passed_over(other.name) is not None}
    name = step.chosen.name
    return any(Reference(name, label) not in gone for label in _chosen(name, scope, store))


def _why_not_chosen(step: Step, scope: Scope, store: Store) -> str | None:
    """Why a step does not run, if a choice is made that has not taken it."""
    if step.chosen is None:
        return None
    name, label = step.chosen.name, step.chosen.output
    if (gone := scope.why_passed_over(name)) is not None:
        return gone
    chosen = _chosen(name, scope, store)
    return f"{name} took {', '.join(chosen)}, not {label}" if chosen and label not in chosen else None


def _chosen(name: str, scope: Scope, store: Store) -> list[str]:
    """The labels that a choice has taken; none while it is not made."""
    artifact = scope.artifact(name)
    if artifact is None:
        return []
    chosen = store.table(artifact, "table")["chosen"]
    return [chosen] if isinstance(chosen, str) else list(chosen)
