"""The scores that a run shows: tables of its stages by their roles."""

from __future__ import annotations

from typing import Any

from texloom.pipelines.engine.run import Run


def choices_of(run: Run) -> dict[str, dict[str, Any]]:
    """The tables of choices by the labels of their steps, after a run; not where one thing alone was there."""
    steps = [step for step in run.flow.steps.values() if step.stage.role == "choice"]
    tables = {
        scope.label(step): run.store.table(artifact, "table")
        for step in steps
        for scope in run.known_scopes
        if (artifact := scope.artifacts.get(step.name)) is not None
    }
    return {label: table for label, table in tables.items() if len(table.get("scores", ())) != 1}


def scores(run: Run) -> dict[str, Any]:
    """The table of the flow's scores, after a run: of what it chose, if it did; empty over a set or without."""
    steps = list(run.flow.steps.values())
    measured = [step.name for step in steps if step.stage.role == "scores"]
    for step in reversed(steps):  # the last is that of the results
        given = [name for name in step.stage.inputs if name.endswith("_scores")]  # in the order of the labels
        if given and step.stage.role == "choice" and step.name in run.shared.artifacts:
            table = run.store.table(run.shared.artifacts[step.name], "table")
            better = dict(step.params)["labels"].index(table["chosen"])
            measured.insert(0, step.inputs[given[better]].name)
            break
    artifact = next((run.shared.artifacts[name] for name in measured if name in run.shared.artifacts), None)
    return {} if artifact is None else dict(run.store.table(artifact, "table"))


def main_scores(run: Run) -> dict[str, float]:
    """The summary of `scores` by name."""
    summary = scores(run).get("summary", {})
    return {name: value for name, value in summary.items() if isinstance(value, float)}
