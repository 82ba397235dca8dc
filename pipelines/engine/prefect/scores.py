"""The scores of a run as tables of its flow run."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator, Mapping
from typing import Any

from prefect.artifacts import create_table_artifact

from texloom.pipelines.engine.prefect.task_runs import artifact_key
from texloom.pipelines.engine.run import Run
from texloom.pipelines.engine.task_spec import Inputs, Output
from texloom.pipelines.store.result_files import BrokenArtifactError
from texloom.pipelines.store.types import hints_of


def show_scores(run: Run) -> None:
    """Show the tables of all evaluating steps, one table for each step; over a set, with a row for each item."""
    for step in run.flow.steps.values():
        if step.stage.name.startswith("evaluation.") and hints_of(step.stage.result).get("table"):
            with contextlib.suppress(Exception):
                rows = list(_rows_of_step(run, step.name))
                if rows:
                    create_table_artifact(
                        rows, artifact_key(run.flow.name, step.name, "-scores"), f"{step.name}.table"
                    )


def _rows_of_step(run: Run, name: str) -> Iterator[dict[str, Any]]:
    is_item = run.flow.steps[name].scope == "item"
    for scope in run.scopes.values() if is_item else [run.shared]:
        artifact = None if scope is None else scope.artifacts.get(name)
        if scope is not None and artifact is not None:
            with contextlib.suppress(BrokenArtifactError):
                table = Inputs(run.store).output(Output(name, artifact.stage, artifact.key, "table", ""))
                yield from [{"item": scope.name, **_flat(table.get("summary", table))}] if is_item else _rows(table)


def _rows(table: Mapping[str, Any]) -> list[dict[str, Any]]:
    """A table of scores as rows of plain values."""
    if isinstance(table.get("rows"), list):
        return [_flat(row) for row in table["rows"]]
    if isinstance(table.get("measures"), dict):
        return [{"measure": name, **_flat(line)} for name, line in table["measures"].items()]
    return [{"name": name, "value": value} for name, value in _flat(table).items()]


def _flat(entry: Mapping[str, Any], prefix: str = "") -> dict[str, Any]:
    """Plain values by dotted names; lists are left out."""
    values: dict[str, Any] = {}
    for name, value in entry.items():
        if isinstance(value, dict):
            values |= _flat(value, f"{prefix}{name}.")
        elif not isinstance(value, list):
            values[f"{prefix}{name}"] = value
    return values
