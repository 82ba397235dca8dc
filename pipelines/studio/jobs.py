"""Runs at full size: one at a time, in the order in which they came. They go on when the page is closed."""

from __future__ import annotations

import asyncio
import contextlib
import secrets
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

from texloom.pipelines.studio.messages.answers import JobChanged, JobPicture
from texloom.pipelines.studio.messages.message import packed, unpacked
from texloom.pipelines.studio.messages.recipes import Recipe
from texloom.pipelines.studio.messages.runs import Job
from texloom.pipelines.studio.processes import WorkCancelledError, WorkerProcess
from texloom.pipelines.studio.work import Places, Ran, Running, RunWork
from texloom.stages.vocabulary.declare import InputError

Listener = Callable[[bytes], None]


class Jobs:
    """The runs of a studio since it was started."""

    def __init__(self, places: Places):
        self.jobs: dict[str, Job] = {}
        self.listeners: set[Listener] = set()
        self.folders: dict[str, Path] = {}
        """job to the folder of its exports"""
        self._worker = WorkerProcess(places)
        self._waiting: asyncio.Queue[str] = asyncio.Queue()
        self._current = ""

    def add(self, name: str, recipe: Recipe) -> Job:
        """Queue a run."""
        job = Job(id=secrets.token_hex(8), name=name, recipe=recipe, state="waiting")
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

    def saved(self, job: str, out: str) -> Job:
        """Tell that the exports of a run have been saved in a folder."""
        self._change(job, saved=out)
        return self.jobs[job]

    async def work(self) -> None:
        """Run what waits, for ever."""
        try:
            while True:
                self._current = await self._waiting.get()
                if self.jobs[self._current].state == "waiting":
                    await self._run(self._current)
                self._current = ""
        finally:
            self._worker.kill()

    async def _run(self, job: str) -> None:
        began = time.perf_counter()
        self._change(job, state="running", text="starting")
        changes: dict[str, Any] = {"state": "done", "text": ""}
        try:
            async for frame in self._worker.frames(RunWork(recipe=self.jobs[job].recipe)):
                self._on_frame(job, frame)
        except WorkCancelledError:
            changes = {"state": "cancelled", "text": "finished steps are kept; the next run goes on from there"}
        except InputError as error:
            changes = {"state": "failed", "text": str(error)}
        self._change(job, seconds=time.perf_counter() - began, **changes)

    def _on_frame(self, job: str, frame: bytes) -> None:
        header, payload = unpacked(frame)
        with contextlib.suppress(ValueError):
            ran = Ran.model_validate_json(header)
            self.folders[job] = Path(ran.out)
            self._change(job, files=ran.files, scores=ran.scores, texture=ran.texture, maps=ran.maps)
            return
        running = Running.model_validate_json(header)
        self._change(job, step=running.step, text=running.text, done=running.done)
        if running.height:
            picture = JobPicture(job=job, height=running.height, width=running.width)
            self._tell(packed(picture, bytes(payload)))

    def _change(self, job: str, **changes: Any) -> None:
        self._set(self.jobs[job].model_copy(update=changes))

    def _set(self, job: Job) -> None:
        self.jobs[job.id] = job
        self._tell(packed(JobChanged(job=job)))

    def _tell(self, frame: bytes) -> None:
        for listener in list(self.listeners):
            listener(frame)
