"""What a run says to the person at the terminal: a line a step, and a bar with time left while a step is long."""

from __future__ import annotations

import sys
import time
from collections import Counter
from typing import Any, TextIO

from pipelines.observers import StepReport, describe_progress
from stages.progress import Progress

_PLAIN_SECONDS = 10.0  # between two lines where there is no terminal


class Terminal:
    """A `pipelines.observers.Observer`. Lines of steps go to ``lines``, progress to standard error."""

    def __init__(self, lines: TextIO, names: list[str]):
        self.lines = lines
        self.width = max(map(len, names))
        self.counts: Counter[str] = Counter()
        self.first: tuple[float, float] | None = None
        self.last = 0.0
        self.bar: Any = None
        self.task: Any = None

    def started(self, step: str) -> None:  # noqa: ARG002
        """See `pipelines.observers.Observer`."""
        self.first, self.last = None, time.monotonic()

    def progressed(self, step: str, progress: Progress) -> None:
        """Move the bar; without a terminal, print a line now and then."""
        now = time.monotonic()
        if self.first is None:
            self.first = now, progress.done
        if sys.stderr.isatty():
            self._move_bar(step, progress, now)
        elif now > self.last + _PLAIN_SECONDS:
            self.last = now
            print(
                f"{step}: {describe_progress(progress)}, {self._left(progress, now)}", file=sys.stderr, flush=True
            )

    def finished(self, report: StepReport) -> None:
        """Print the step's line; over a set, cached steps are only counted."""
        self.close()
        self.counts[report.state] += 1
        self.width = max(self.width, len(report.label))
        took = "" if report.state == "cached" else f"  {report.seconds:6.2f} s"
        if report.item is None or report.state != "cached":
            print(f"{report.label:{self.width}}  {report.state:6}{took}", file=self.lines, flush=True)

    def finished_item(self, item: str, number: int, count: int, problem: str | None) -> None:
        """Print the item's line: how many steps ran, or why it failed."""
        self.close()
        if problem is None:
            states = [state for state in ("ran", "cached") if self.counts[state]]
            problem = ", ".join(f"{self.counts[state]} {state}" for state in states)
        else:
            problem = f"failed: {problem}"
        print(f"[{number}/{count}] {item}: {problem}", file=self.lines, flush=True)
        self.counts.clear()

    def noted(self, text: str) -> None:
        """Print a line to standard error."""
        self.close()
        print(text, file=sys.stderr, flush=True)

    def close(self) -> None:
        """Take the bar away."""
        if self.bar is not None:
            self.bar.stop()
            self.bar = None

    def _move_bar(self, step: str, progress: Progress, now: float) -> None:
        if self.bar is None:
            from rich.console import Console
            from rich.progress import BarColumn, TextColumn
            from rich.progress import Progress as Bar

            self.bar = Bar(
                TextColumn(f"{step:{self.width}}"),
                BarColumn(bar_width=24),
                TextColumn("{task.description}"),
                console=Console(stderr=True),
                transient=True,
            )
            self.bar.start()
            self.task = self.bar.add_task("", total=1.0)
        text = f"{describe_progress(progress)}, {self._left(progress, now)}"
        self.bar.update(self.task, completed=progress.done, description=text)

    def _left(self, progress: Progress, now: float) -> str:
        since, done = self.first or (now, progress.done)
        if progress.done <= done:
            return "time left not known yet"
        seconds = round((now - since) / (progress.done - done) * (1 - progress.done))
        return f"{seconds // 60}:{seconds % 60:02d} left"
