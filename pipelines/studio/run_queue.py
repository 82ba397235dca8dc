"""Runs one at a time in a worker process, in the order in which they came. They go on when nobody looks."""

from __future__ import annotations

import asyncio
import time
from abc import ABC, abstractmethod
from typing import Any, Generic, TypeVar

from texloom.pipelines.studio.messages.runs import Queued
from texloom.pipelines.studio.processes import WorkCancelledError, WorkerProcess
from texloom.pipelines.studio.work import Places, Work
from texloom.stages.vocabulary.declare import InputError

State = TypeVar("State", bound=Queued)


class RunQueue(ABC, Generic[State]):
    """The runs since the server was started."""

    def __init__(self, places: Places):
        self.jobs: dict[str, State] = {}
        self._worker = WorkerProcess(places)
        self._waiting: asyncio.Queue[str] = asyncio.Queue()
        self._current = ""

    @abstractmethod
    def _work_of(self, job: str) -> Work:
        """What the worker does for a run."""

    @abstractmethod
    def _on_frame(self, job: str, frame: bytes) -> None:
        """Take what the worker sends while it runs."""

    @abstractmethod
    def _tell(self, job: State) -> None:
        """A run is new or has changed."""

    def _queue(self, job: State) -> State:
        self._set(job)
        self._waiting.put_nowait(job.id)
        return job

    def cancel(self, job: str) -> None:
        """Cancel a run that waits or goes on; its finished steps are kept. `KeyError` if there is none."""
        if self.jobs[job].state == "waiting":
            self._change(job, state="cancelled")
        elif job == self._current:
            self._change(job, text="stopping; finished steps are kept")
            self._worker.cancel()

    async def work(self) -> None:
        """Run what waits, for ever."""
        try:
            while True:
                self._current = await self._waiting.get()
                waiting = self.jobs.get(self._current)
                if waiting is not None and waiting.state == "waiting":
                    await self._run(self._current)
                self._current = ""
        finally:
            self._worker.kill()

    async def _run(self, job: str) -> None:
        began = time.perf_counter()
        self._change(job, state="running", text="starting")
        changes: dict[str, Any] = {"state": "done", "text": ""}
        try:
            async for frame in self._worker.frames(self._work_of(job)):
                self._on_frame(job, frame)
        except WorkCancelledError:
            changes = {"state": "cancelled", "text": "finished steps are kept; the next run goes on from there"}
        except InputError as error:
            changes = {"state": "failed", "text": self._words(str(error))}
        self._change(job, seconds=time.perf_counter() - began, **changes)

    def _words(self, problem: str) -> str:
        """A problem as those are told it who have queued the run."""
        return problem

    def _change(self, job: str, **changes: Any) -> None:
        self._set(self.jobs[job].model_copy(update=changes))

    def _set(self, job: State) -> None:
        self.jobs[job.id] = job
        self._tell(job)
