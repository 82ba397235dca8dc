"""Runs of the page at full size."""

from __future__ import annotations

import contextlib
import secrets
from collections.abc import Callable
from pathlib import Path

from texloom.pipelines.studio.messages.answers import JobChanged, JobPicture
from texloom.pipelines.studio.messages.message import packed, unpacked
from texloom.pipelines.studio.messages.recipes import Recipe
from texloom.pipelines.studio.messages.runs import Job
from texloom.pipelines.studio.page_words import page_words
from texloom.pipelines.studio.run_queue import RunQueue
from texloom.pipelines.studio.work import Places, Ran, Running, RunWork

Listener = Callable[[bytes], None]
Watcher = Callable[[Job, Path | None], None]


class Jobs(RunQueue[Job]):
    """The runs of a studio since it was started."""

    def __init__(self, places: Places):
        super().__init__(places)
        self.listeners: set[Listener] = set()
        self.folders: dict[str, Path] = {}
        """job to the folder of its exports"""
        self.watch: Watcher = lambda _job, _folder: None
        """is told of each change, with the folder of the exports where it is known"""

    @staticmethod
    def new(name: str, recipe: Recipe) -> Job:
        """A run that is to be queued."""
        return Job(id=secrets.token_hex(8), name=name, recipe=recipe, state="waiting")

    def queue(self, job: Job) -> Job:
        """Queue a run."""
        return self._queue(job)

    def restore(self, job: Job, folder: Path | None) -> None:
        """Know a run of an earlier server, and the folder of its exports."""
        self.jobs[job.id] = job
        if folder is not None:
            self.folders[job.id] = folder

    def rename(self, job: str, name: str) -> None:
        """Call the files of a run otherwise."""
        if job in self.jobs and self.jobs[job].name != name:
            self._change(job, name=name)

    def again(self, job: str) -> Job:
        """Queue a run again that has failed or was cancelled; its finished steps are kept."""
        ended = self.jobs[job]
        if ended.state in ("failed", "cancelled"):
            self._queue(Job(id=ended.id, name=ended.name, recipe=ended.recipe, state="waiting"))
        return self.jobs[job]

    def _words(self, problem: str) -> str:
        return page_words(problem)

    def saved(self, job: str, out: str) -> Job:
        """Tell that the exports of a run have been saved in a folder."""
        self._change(job, saved=out)
        return self.jobs[job]

    def _work_of(self, job: str) -> RunWork:
        return RunWork(recipe=self.jobs[job].recipe)

    def _on_frame(self, job: str, frame: bytes) -> None:
        header, payload = unpacked(frame)
        with contextlib.suppress(ValueError):
            ran = Ran.model_validate_json(header)
            self.folders[job] = Path(ran.out)
            told = {name: getattr(ran, name) for name in ("files", "scores", "texture", "exemplar", "maps")}
            self._change(job, **told)
            return
        running = Running.model_validate_json(header)
        self._change(job, step=running.step, text=running.text, done=running.done)
        if running.height:
            picture = JobPicture(job=job, height=running.height, width=running.width)
            self.broadcast(packed(picture, bytes(payload)))

    def _tell(self, job: Job) -> None:
        self.watch(job, self.folders.get(job.id))
        self.broadcast(packed(JobChanged(job=job)))

    def broadcast(self, frame: bytes) -> None:
        """Send a message to all pages."""
        for listener in list(self.listeners):
            listener(frame)
