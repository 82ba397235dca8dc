"""Task runs: what a Prefect server shows of each step, made from the events of the run."""

from __future__ import annotations

import base64
import dataclasses
import functools
import re
import time
from collections.abc import Iterable
from pathlib import Path
from types import TracebackType
from typing import Any
from uuid import UUID

import numpy as np
import PIL.Image
import prefect
from prefect.client.orchestration import SyncPrefectClient
from prefect.client.schemas.actions import ArtifactCreate, ArtifactUpdate
from prefect.client.schemas.objects import State, TaskRun, TaskRunResult
from prefect.logging.loggers import task_run_logger
from prefect.states import Completed, Crashed, Failed, Running

from texloom.pipelines.engine.events import (
    Event,
    ItemReport,
    Listener,
    Note,
    StepProgress,
    StepReport,
    StepStarted,
    describe_progress,
    label,
)
from texloom.pipelines.engine.prefect.teller import Teller
from texloom.pipelines.engine.run import Run
from texloom.pipelines.store.preview import small_png
from texloom.stages.vocabulary.progress import Progress

_SECONDS = 2.0  # between two reports of progress
_PATIENCE = 15.0  # seconds without an answer in which a run that has ended waits for the server
_LESS_PATIENCE = 10.0  # the same of an interrupted run


@dataclasses.dataclass
class _Shown:
    """A step that the server shows."""

    task_run: TaskRun
    step: str
    needs: list[UUID]
    """the task runs of what it takes"""
    is_known: bool = False
    """to the server"""
    is_over: bool = False
    told: float = 0.0
    """when progress was last told"""
    scale: int = -1
    progress: UUID | None = None
    """its artifact"""


class TaskRuns:
    """A listener that shows each step as a task run of the current flow run, in a ``with`` block."""

    def __init__(self, run: Run, listener: Listener):
        """``listener`` hears in the end if the server could not be told all."""
        self._run, self._listener = run, listener
        self._flow_run = UUID(str(prefect.runtime.flow_run.id))
        self._shown: dict[str, _Shown] = {}
        """label of a step to its last task run"""
        self._teller = Teller()

    def __enter__(self) -> TaskRuns:
        return self

    def __exit__(self, _: object, error: BaseException | None, __: TracebackType | None) -> None:
        """Wait until the server knows all; what is still running has failed with the run."""
        is_interrupted = error is not None and not isinstance(error, Exception)
        state: State[Any] = (
            Crashed(message="the run was interrupted") if is_interrupted else Failed(message=str(error))
        )
        self._end_all(self._shown.values(), state)
        untold = self._teller.close(_LESS_PATIENCE if is_interrupted else _PATIENCE)
        if untold:
            self._listener(Note(f"the Prefect server does not answer: it lacks the last {untold} reports of steps"))

    def __call__(self, event: Event) -> None:
        """Show what a run tells."""
        match event:
            case StepStarted(step):
                before = self._shown.get(step)
                if before is not None and not before.is_over:
                    self._end(before, Crashed(message="it did not end, and is computed again"))
                self._begin(step, Running())
            case StepProgress(step, progress, picture):
                shown = self._shown.get(step) or self._begin(step, Running())
                self._show_progress(shown, progress, picture)
            case StepReport():
                self._show_report(event)
            case ItemReport(item, problem=problem):
                ours = [shown for name, shown in self._shown.items() if name.startswith(f"{item}/")]
                self._end_all(ours, Failed(message=problem))

    # -- in the thread of the run

    def _begin(self, name: str, state: State[Any]) -> _Shown:
        step = name.rpartition("/")[2]
        run = TaskRun(flow_run_id=self._flow_run, task_key=step, dynamic_key=name, name=name)
        run.dynamic_key = str(run.id)  # a step is begun again when its worker is killed
        self._shown[name] = shown = _Shown(run, step, self._needs(name, step))
        self._teller.tell(lambda client: self._create(client, shown, state))
        return shown

    def _needs(self, name: str, step: str) -> list[UUID]:
        """The task runs of the steps that a step takes something of: of its item, shared, or of all items."""
        item = name.rpartition("/")[0] or None
        found = []
        for one in self._run.flow.steps[step].needs:
            own = self._shown.get(label(one, item), self._shown.get(one))
            found += [own] if own is not None else [shown for shown in self._shown.values() if shown.step == one]
        return [shown.task_run.id for shown in found]

    def _end(self, shown: _Shown, state: State[Any]) -> None:
        shown.is_over = True
        self._teller.tell(lambda client: self._set_state(client, shown, state))

    def _end_all(self, ended: Iterable[_Shown], state: State[Any]) -> None:
        for shown in ended:
            if not shown.is_over:
                self._end(shown, state)

    def _show_progress(self, shown: _Shown, progress: Progress, picture: bytes) -> None:
        now = time.monotonic()
        if picture or progress.done >= 1 or now >= shown.told + _SECONDS:
            shown.told = now
            self._teller.tell(lambda client: self._tell_progress(client, shown, progress, picture), False)

    def _show_report(self, report: StepReport) -> None:
        shown = self._shown.get(report.label)
        if report.state == "failed":
            state: State[Any] = Failed(message=report.problem)
        else:
            result = str(self._run.store.folder(report.stage, str(report.key)))
            state = Completed(message=result, name="Cached" if report.state == "cached" else None)
        if shown is None or shown.is_over:
            shown = self._begin(report.label, state)
            shown.is_over = True
        else:
            self._end(shown, state)
        if report.state != "failed":
            self._teller.tell(lambda client: self._tell_result(client, shown, report))
        elif report.details:
            task_run_logger(shown.task_run, _task(shown.step)).error(report.details)

    # -- in the thread that tells the server

    def _create(self, client: SyncPrefectClient, shown: _Shown, state: State[Any]) -> None:
        run = shown.task_run
        needs: list[Any] = [TaskRunResult(id=one) for one in shown.needs]
        client.create_task_run(
            _task(shown.step), run.flow_run_id, run.dynamic_key, id=run.id, name=run.name, state=state,
            task_inputs={"wait_for": needs} if needs else None,
        )  # fmt: skip
        shown.is_known = True

    def _set_state(self, client: SyncPrefectClient, shown: _Shown, state: State[Any]) -> None:
        if shown.is_known:
            client.set_task_run_state(shown.task_run.id, state, force=True)
        else:
            self._create(client, shown, state)

    def _tell_progress(self, client: SyncPrefectClient, shown: _Shown, progress: Progress, picture: bytes) -> None:
        text, done = describe_progress(progress), 100 * progress.done
        if shown.progress is None:
            shown.progress = self._tell(client, shown, "-progress", "progress", done, text)
        else:
            client.update_artifact(shown.progress, ArtifactUpdate(data=done, description=text))
        if progress.scale != shown.scale:
            shown.scale = progress.scale
            task_run_logger(shown.task_run, _task(shown.step)).info(text)
        if picture:
            self._tell(client, shown, "-scale", "image", _url(picture), text)

    def _tell_result(self, client: SyncPrefectClient, shown: _Shown, report: StepReport) -> None:
        folder = self._run.store.folder(report.stage, str(report.key))
        path = next((path for path in (folder / "image.png", *sorted(folder.glob("*.png"))) if path.exists()), None)
        if path is not None:
            self._tell(client, shown, "", "image", _url(_small(path)), f"{report.label}.{path.stem}")

    def _tell(self, client: SyncPrefectClient, shown: _Shown, what: str, kind: str, data: Any, text: str) -> UUID:
        key = artifact_key(self._run.flow.name, shown.task_run.name, what)
        made = ArtifactCreate(
            key=key, type=kind, data=data, description=text, flow_run_id=self._flow_run,
            task_run_id=shown.task_run.id,
        )  # fmt: skip
        return client.create_artifact(made).id


def artifact_key(flow: str, step: str, what: str = "") -> str:
    """An artifact's key: small letters, digits and dashes."""
    return re.sub(r"[^a-z0-9]+", "-", f"{flow}-{step}{what}".lower())


def _small(path: Path) -> bytes:
    with PIL.Image.open(path) as picture:
        return small_png(np.asarray(picture.convert("RGB")))


def _url(png: bytes) -> str:
    return f"data:image/png;base64,{base64.b64encode(png).decode()}"


@functools.cache
def _task(step: str) -> prefect.Task[[], None]:
    """What a server calls a step; it is not called."""
    return prefect.Task(_task_body, name=step)


def _task_body() -> None:
    """Steps are computed by the executor."""
