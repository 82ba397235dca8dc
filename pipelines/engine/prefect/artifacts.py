"""What a Prefect server shows of a run: progress, pictures and scores as Prefect's artifacts.

A server that does not answer stops no work.
"""

from __future__ import annotations

import base64
import contextlib
import io
import re
import time
from collections.abc import Iterator, Mapping
from typing import Any

from texloom.pipelines.engine.events import StepReport, describe_progress
from texloom.pipelines.engine.prefect import records  # noqa: F401 (turns telemetry off before Prefect is imported)
from texloom.pipelines.engine.run import Run
from texloom.pipelines.engine.task import Inputs, Output
from texloom.pipelines.store.preview import eight_bits
from texloom.pipelines.store.store import BrokenArtifactError, Store
from texloom.pipelines.store.types import hints_of
from texloom.stages.vocabulary.progress import Progress

import prefect  # isort: skip
from prefect.artifacts import (  # isort: skip
    create_image_artifact,
    create_progress_artifact,
    create_table_artifact,
    update_progress_artifact,
)

_PREVIEW_SIDE = 512  # px
_SECONDS = 2.0  # between two reports of progress


class ProgressArtifact:
    """Shows how far a task is, and a picture of each scale. To be used inside of the task."""

    def __init__(self, flow: str, label: str):
        self.flow = flow
        self.label = label
        self.artifact: Any = None
        self.last = 0.0
        self.scale = -1

    def update(self, progress: Progress) -> None:
        """Report, unless the last report was a moment ago."""
        now = time.monotonic()
        if progress.done < 1 and now < self.last + _SECONDS:
            return
        self.last = now
        text = describe_progress(progress)
        with contextlib.suppress(Exception):
            if self.artifact is None:
                key = _key(self.flow, self.label, "-progress")
                self.artifact = create_progress_artifact(100 * progress.done, key, text)
            else:
                update_progress_artifact(self.artifact, 100 * progress.done, text)
            if progress.scale != self.scale:
                self.scale = progress.scale
                prefect.get_run_logger().info(text)
                if progress.preview is not None:
                    import PIL.Image

                    picture = PIL.Image.fromarray(eight_bits(progress.preview().color))
                    _show_picture(_key(self.flow, self.label, "-scale"), picture, text)


def show_result(flow: str, store: Store, report: StepReport) -> None:
    """Show the picture of a step's result, its image if it has one."""
    import PIL.Image

    folder = store.folder(report.stage, str(report.key))
    path = next((path for path in (folder / "image.png", *sorted(folder.glob("*.png"))) if path.exists()), None)
    if path is not None:
        with contextlib.suppress(Exception), PIL.Image.open(path) as picture:
            _show_picture(_key(flow, report.label), picture.convert("RGB"), f"{report.label}.{path.stem}")


def show_scores(run: Run) -> None:
    """Show the tables of all evaluating steps, one table for each step; over a set, with a row for each item."""
    for step in run.flow.steps.values():
        if step.stage.name.startswith("evaluation.") and hints_of(step.stage.result).get("table"):
            with contextlib.suppress(Exception):
                rows = list(_rows_of_step(run, step.name))
                if rows:
                    create_table_artifact(rows, _key(run.flow.name, step.name, "-scores"), f"{step.name}.table")


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


def _key(flow: str, step: str, what: str = "") -> str:
    """An artifact's key: small letters, digits and dashes."""
    return re.sub(r"[^a-z0-9]+", "-", f"{flow}-{step}{what}".lower())


def _show_picture(key: str, picture: Any, text: str) -> None:
    picture.thumbnail((_PREVIEW_SIDE, _PREVIEW_SIDE))
    stream = io.BytesIO()
    picture.save(stream, "png")
    create_image_artifact(f"data:image/png;base64,{base64.b64encode(stream.getvalue()).decode()}", key, text)
