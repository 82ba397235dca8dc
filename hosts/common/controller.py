"""Runs without a window: what is asked of texloom, how far it is, cancel. Nothing here waits but `Job.wait`."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from types import MappingProxyType
from typing import Any, NamedTuple

from .texloom_client import CancelledError, Client, Pixels, RunHandle, RunResult, TexloomError

_PAUSE = 0.05  # seconds between looks, of scripts


class Request(NamedTuple):
    """One run of a flow."""

    flow: str
    sources: Mapping[str, Any]
    params: Mapping[str, Any] = MappingProxyType({})
    options: Mapping[str, Any] = MappingProxyType({})
    files: tuple[str, ...] = ()


class Progress(NamedTuple):
    """How far a job is."""

    state: str
    """running, done, failed or cancelled"""
    share: float
    """of the runs, 0..1; within a run, of its step"""
    text: str
    """one line for a person"""


class Job:
    """Runs one after another, for one operator."""

    def __init__(self, client: Client, title: str, requests: Sequence[Request]):
        if not requests:
            raise TexloomError(f"{title}: there is nothing to make")
        self.title = title
        self.results: list[RunResult] = []
        self.progress = Progress("running", 0.0, f"{title}: texloom starts")
        self._client, self._requests = client, list(requests)
        self._is_cancelled = False
        self._run = self._submitted()

    def _submitted(self) -> RunHandle:
        asked = self._requests[len(self.results)]
        return self._client.submit(asked.flow, asked.sources, asked.params, files=asked.files, **asked.options)

    @property
    def has_ended(self) -> bool:
        return self.progress.state != "running"

    @property
    def notes(self) -> list[str]:
        """What texloom has guessed, clipped or left out, each once."""
        return list(dict.fromkeys(note for made in self.results for note in made.notes))

    def preview(self) -> Pixels | None:
        """What the present run has made so far, R G B A."""
        return self._run.preview()

    def tick(self) -> Progress:
        """Look how far it is, at once; the next run begins when one has ended."""
        if self.has_ended:
            return self.progress
        status = self._run.poll()
        if not status.has_ended:
            return self._told(status.done, f"{status.step} {status.text}".strip() or status.state)
        try:
            self.results.append(self._run.wait(0))
        except CancelledError:
            return self._end("cancelled", "cancelled")
        except TexloomError as error:
            return self._end("failed", str(error))
        if self._is_cancelled:
            return self._end("cancelled", "cancelled")
        if len(self.results) < len(self._requests):
            self._run = self._submitted()
            return self._told(0.0, "the next one")
        self.progress = Progress("done", 1.0, f"{self.title}: done")
        return self.progress

    def _told(self, done: float, text: str) -> Progress:
        count, number = len(self._requests), len(self.results)
        which = f" {number + 1} of {count}" if count > 1 else ""
        text = "is being cancelled" if self._is_cancelled else text
        self.progress = Progress("running", (number + done) / count, f"{self.title}{which}: {text}")
        return self.progress

    def _end(self, state: str, problem: str) -> Progress:
        self.progress = Progress(state, self.progress.share, f"{self.title}: {' '.join(problem.split())}")
        return self.progress

    def cancel(self) -> None:
        """Cancel what is left, which `tick` tells a little later."""
        if not self.has_ended:
            self._is_cancelled = True
            self._run.cancel()

    def wait(self, tell: Callable[[Progress], None] = lambda _: None) -> list[RunResult]:
        """The results, once they are there; for scripts, which may block.

        Raises
        ------
        CancelledError, TexloomError : it was cancelled, or has failed.
        """
        while not self.has_ended:
            tell(self.tick())
            time.sleep(_PAUSE)
        if self.progress.state != "done":
            raise (CancelledError if self.progress.state == "cancelled" else TexloomError)(self.progress.text)
        return self.results


class Step(NamedTuple):
    """What an operator has to do after a look at its job."""

    state: str
    """running; finished, with a line of information; failed, with a problem; cancelled"""
    text: str


def step(job: Job, apply: Callable[[list[RunResult]], str]) -> Step:
    """Look at a job, and apply its results once they are all there."""
    progress = job.tick()
    if progress.state in ("running", "cancelled", "failed"):
        return Step(progress.state, progress.text)
    try:
        return Step("finished", f"{job.title}: {apply(job.results)}")
    except TexloomError as error:
        return Step("failed", f"{job.title}: {error}")


class Jobs:
    """The jobs that go on in a program, and its one client, which starts texloom when a job needs it."""

    def __init__(self, connect: Callable[[], Client]) -> None:
        self.running: list[Job] = []
        self._connect = connect
        self._client: Client | None = None

    def begin(self, title: str, requests: Sequence[Request]) -> Job:
        if self._client is None:
            self._client = self._connect()
        job = Job(self._client, title, requests)
        self.running.append(job)
        return job

    def end(self, job: Job) -> None:
        """Forget a job; one that goes on is cancelled."""
        job.cancel()
        if job in self.running:
            self.running.remove(job)

    def cancel_all(self) -> None:
        for job in self.running:
            job.cancel()

    def close(self) -> None:
        """Cancel all, and end the server; the next job starts one, with the settings of then."""
        self.cancel_all()
        if self._client is not None:
            self._client.close()
            self._client = None
