"""What a run says to the person at the terminal: a line a step, and bars with time left while something is long."""

from __future__ import annotations

import dataclasses
import sys
import time
from collections import Counter, defaultdict
from typing import Any, TextIO

from texloom.pipelines.engine.events import (
    Event,
    ItemReport,
    Note,
    StepProgress,
    StepReport,
    StepStarted,
    describe_progress,
)
from texloom.pipelines.errors import one_line
from texloom.stages.progress import Progress

_PLAIN_SECONDS = 10.0  # between two lines where there is no terminal


@dataclasses.dataclass
class _Working:
    """A step that is being computed."""

    last: float
    """when it last was heard of on standard error"""
    first: tuple[float, float] | None = None
    """when it first said how far it was, and how far"""
    bar: Any = None

    def left(self, progress: Progress, now: float) -> str:
        since, done = self.first or (now, progress.done)
        if progress.done <= done:
            return "time left not known yet"
        return f"{_clock((now - since) / (progress.done - done) * (1 - progress.done))} left"


class Terminal:
    """A `texloom.pipelines.engine.events.Listener`. Lines of steps go to ``lines``, progress to standard error."""

    def __init__(self, lines: TextIO, names: list[str], items: int = 0):
        """``names``: of the steps; ``items``: how many the set has, if the flow runs over one."""
        self.lines = lines
        self.width = max(map(len, names))
        self.items = items
        self.ended = 0
        self.failed = 0
        self.computed = 0
        """items that had something to compute"""
        self.since: float | None = None
        """when the first step began"""
        self.counts: dict[str | None, Counter[str]] = defaultdict(Counter)
        self.working: dict[str, _Working] = {}
        self.bar: Any = None
        self.set_bar: Any = None

    def __call__(self, event: Event) -> None:
        """Print what is worth a line."""
        match event:
            case StepStarted(step):
                now = time.monotonic()
                self.working[step] = _Working(now)
                if self.since is None:
                    self.since = now
                self._show_set()
            case StepProgress(step, progress):
                self._show_progress(step, progress)
            case StepReport():
                self._end_step(event)
            case ItemReport():
                self._end_item(event)
            case Note(text):
                self.close()
                _say(text, sys.stderr)

    def _show_progress(self, step: str, progress: Progress) -> None:
        """Move the bar; without a terminal, print a line now and then."""
        now = time.monotonic()
        working = self.working.setdefault(step, _Working(now))
        if working.first is None:
            working.first = now, progress.done
        text = f"{describe_progress(progress)}, {working.left(progress, now)}"
        if sys.stderr.isatty():
            self._show_set()
            if working.bar is None:
                working.bar = self._bars().add_task("", total=1.0, what=one_line(f"{step:{self.width}}"))
            self._bars().update(working.bar, completed=progress.done, description=text)
        elif now > working.last + _PLAIN_SECONDS:
            working.last = now
            _say(f"{step}: {text}", sys.stderr)

    def _end_step(self, report: StepReport) -> None:
        """Print the step's line; over a set, cached steps are only counted."""
        self.close()
        self.working.pop(report.label, None)
        self.counts[report.item][report.state] += 1
        self.width = max(self.width, len(report.label))
        took = "" if report.state == "cached" else f"  {report.seconds:6.2f} s"
        if report.item is None or report.state != "cached":
            _say(f"{report.label:{self.width}}  {report.state:6}{took}", self.lines)

    def _end_item(self, report: ItemReport) -> None:
        """Print the item's line: how many steps ran, or why it failed; then how many failed, and the time left."""
        self.close()
        problem = report.problem
        counts = self.counts.pop(report.item, Counter())
        self.items, self.ended = report.count, report.number
        self.failed += problem is not None
        self.computed += bool(counts["ran"] or counts["failed"])
        if problem is None:
            problem = ", ".join(f"{counts[state]} {state}" for state in ("ran", "cached") if counts[state])
        else:
            problem = f"failed: {problem}"
        outlook = self._outlook() if self.ended < self.items else ""
        _say(
            f"[{self.ended}/{self.items}] {report.item}: {problem}{f' ({outlook})' if outlook else ''}", self.lines
        )

    def close(self) -> None:
        """Take the bars away."""
        if self.bar is not None:
            self.bar.stop()
            self.bar = self.set_bar = None
            for working in self.working.values():
                working.bar = None

    def _outlook(self) -> str:
        """How many items have failed, and how long the others will take if they are like those so far."""
        words = [f"{self.failed} failed"] if self.failed else []
        if self.computed and self.since is not None:
            seconds = (time.monotonic() - self.since) / self.computed * (self.items - self.ended)
            words.append(f"{_clock(seconds)} left")
        return ", ".join(words)

    def _show_set(self) -> None:
        if not self.items or not sys.stderr.isatty():
            return
        if self.set_bar is None:
            self.set_bar = self._bars().add_task("", total=self.items, what=f"{'items':{self.width}}")
        words = [f"{self.ended} of {self.items}", *filter(None, [self._outlook()])]
        self._bars().update(self.set_bar, completed=self.ended, description=", ".join(words))

    def _bars(self) -> Any:
        if self.bar is None:
            from rich.console import Console
            from rich.progress import BarColumn, TextColumn
            from rich.progress import Progress as Bars

            self.bar = Bars(
                TextColumn("{task.fields[what]}", markup=False),
                BarColumn(bar_width=24),
                TextColumn("{task.description}", markup=False),
                console=Console(stderr=True),
                transient=True,
            )
            self.bar.start()
        return self.bar


def _say(text: str, stream: TextIO) -> None:
    """Print one line; names of files may hold line breaks and what a terminal would obey."""
    print(one_line(text), file=stream, flush=True)


def _clock(seconds: float) -> str:
    """Minutes and seconds; hours before them where there are any."""
    minutes, rest = divmod(round(seconds), 60)
    return f"{minutes}:{rest:02d}" if minutes < 60 else f"{minutes // 60}:{minutes % 60:02d}:{rest:02d}"
