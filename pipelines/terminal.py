"""What a run shows to the person at the terminal: a header, a line a step, live lines meanwhile, and a summary."""

from __future__ import annotations

import dataclasses
import os
import sys
import time
from collections import Counter, defaultdict
from collections.abc import Mapping
from pathlib import Path
from typing import Any, TextIO

from texloom.pipelines.engine.events import (
    Event,
    ItemReport,
    Note,
    RunStarted,
    Shared,
    StepProgress,
    StepReport,
    StepStarted,
    describe_progress,
)
from texloom.pipelines.errors import one_line
from texloom.stages.vocabulary.progress import Progress
from texloom.stages.vocabulary.sizes import format_size

_PLAIN_SECONDS = 10.0  # between two lines where there is no terminal
_MIN_DONE = 0.01  # of a step, from which the time left is known; before that, kernels may have been compiled
_MAX_LIVE_LINES = 12  # steps that are shown at work
_MAX_NAME = 40  # characters of a source's name
_STYLES = {"cached": "2", "failed": "31", "warning": "33", "header": "1"}  # SGR codes
_STATE_WIDTH = len("cached")


@dataclasses.dataclass
class _Working:
    """A step that is being computed."""

    began: float
    last: float
    """when it last was heard of on standard error"""
    progress: Progress | None = None
    first: tuple[float, float] | None = None
    """when it first said how far it was, and how far"""

    def update(self, progress: Progress, now: float) -> None:
        self.progress = progress
        if self.first is None:
            self.first = now, progress.done

    def describe(self, now: float) -> str:
        """How far it is, the time left where that is known, and then what a narrow terminal may cut."""
        if self.progress is None or self.first is None:
            return ""
        share, *more = describe_progress(self.progress).split(", ")
        since, done = self.first
        if self.progress.done - done >= _MIN_DONE:
            left = (now - since) / (self.progress.done - done) * (1 - self.progress.done)
            more.insert(0, f"{_clock(left)} left")
        return ", ".join([share, *more])


class Terminal:
    """A `texloom.pipelines.engine.events.Listener`. Lines of steps go to ``lines``, progress to standard error."""

    def __init__(self, lines: TextIO):
        self.lines = lines
        self.began = time.monotonic()
        self.steps: tuple[str, ...] = ()
        self.width = 0
        """of the names of steps"""
        self.items = 0
        """how many the set has, if the flow runs over one"""
        self.ended = 0
        self.failed = 0
        self.computed = 0
        """items that had something to compute"""
        self.since: float | None = None
        """when the first step began"""
        self.states: Counter[str] = Counter()
        """of all steps so far"""
        self.item_states: dict[str | None, Counter[str]] = defaultdict(Counter)
        self.working: dict[str, _Working] = {}
        self.live: Any = None
        self.shared: Counter[str] = Counter()
        """what has passed from and to the shared store"""

    def __call__(self, event: Event) -> None:
        """Print what is worth a line."""
        match event:
            case RunStarted():
                self.steps, self.items = event.steps, event.items
                self.width = max(map(len, event.steps))
                self._say(header(event), self.lines, "header")
            case StepStarted(step):
                now = time.monotonic()
                self.working[step] = _Working(now, now)
                if self.since is None:
                    self.since = now
                self._show_live()
            case StepProgress(step, progress):
                self._show_progress(step, progress)
            case StepReport():
                self._end_step(event)
            case ItemReport():
                self._end_item(event)
            case Shared(fetched, uploaded):
                self.shared.update({"fetched": fetched, "uploaded": uploaded})
                self.shared.update({"refused": bool(event.refusal), "not shared": bool(event.outage)})
            case Note(text, is_warning):
                self._say(f"warning: {text}" if is_warning else text, sys.stderr, "warning" if is_warning else "")

    def summarise(
        self,
        scores: Mapping[str, float],
        folder: Path | None,
        choices: Mapping[str, Mapping[str, Any]] | None = None,
    ) -> None:
        """Print the last line: how many steps ran, how long it took, the main scores, and where the exports are.

        ``choices``: tables of choices by step; each has a line before, and ``scores`` are those of what
        was chosen.
        """
        for step, table in (choices or {}).items():
            self._say(f"{step}: {_describe_choice(table)}", self.lines)
        counts = ", ".join(
            f"{self.states[state]} {state}" for state in ("ran", "cached", "failed") if self.states[state]
        )
        words = [f"{counts} in {_duration(time.monotonic() - self.began)}"]
        if any(self.shared.values()):
            words.append(", ".join(f"{count} {what}" for what, count in self.shared.items() if count))
        if scores:
            of = f"{list(choices.values())[-1]['chosen']}: " if choices else ""
            words.append(of + _describe_scores(scores))
        if folder is not None:
            words.append(str(folder))
        self._say("; ".join(words), self.lines, "header")

    def close(self) -> None:
        """Take the live lines away."""
        if self.live is not None:
            self.live.stop()
            self.live = None

    # -- lines

    def _say(self, text: str, stream: TextIO, style: str = "") -> None:
        """Print one line; names of files may hold line breaks and what a terminal would obey."""
        self.close()
        text = one_line(text)
        if style and stream.isatty() and not os.environ.get("NO_COLOR"):
            text = f"\x1b[{_STYLES[style]}m{text}\x1b[0m"
        print(text, file=stream, flush=True)
        if self.working:
            self._show_live()

    def _number(self, step: str) -> str:
        """``[3/9]``: the place of a step in the flow; ``step`` may be a label."""
        name = step.rpartition("/")[2]
        if name not in self.steps:
            return ""
        count = str(len(self.steps))
        return f"[{self.steps.index(name) + 1:{len(count)}}/{count}] "

    def _end_step(self, report: StepReport) -> None:
        """Print the step's line; over a set, cached steps are only counted."""
        self.working.pop(report.label, None)
        self.states[report.state] += 1
        self.item_states[report.item][report.state] += 1
        self.width = max(self.width, len(report.label))
        took = "" if report.state == "cached" else f"  {report.seconds:6.2f} s"
        if report.item is None or report.state != "cached":
            number = self._number(report.name)
            text = f"{number}{report.label:{self.width}}  {report.state:{_STATE_WIDTH}}{took}"
            self._say(text.rstrip(), self.lines, "" if report.state == "ran" else report.state)

    def _end_item(self, report: ItemReport) -> None:
        """Print the item's line: how many steps ran, or why it failed; then how many failed, and the time left."""
        problem = report.problem
        counts = self.item_states.pop(report.item, Counter())
        self.items, self.ended = report.count, report.number
        self.failed += problem is not None
        self.computed += bool(counts["ran"] or counts["failed"])
        text = ", ".join(f"{counts[state]} {state}" for state in ("ran", "cached") if counts[state])
        text = text or "no steps of its own"
        if problem is not None:
            text = f"failed: {problem}"
        outlook = self._outlook() if self.ended < self.items else ""
        if outlook:
            text = f"{text} ({outlook})"
        line = f"item {self.ended}/{self.items} {report.item}: {text}"
        self._say(line, self.lines, "" if problem is None else "failed")

    def _outlook(self) -> str:
        """How many items have failed, and how long the others will take if they are like those so far."""
        words = [f"{self.failed} failed"] if self.failed else []
        if self.computed and self.since is not None:
            seconds = (time.monotonic() - self.since) / self.computed * (self.items - self.ended)
            words.append(f"{_clock(seconds)} left")
        return ", ".join(words)

    # -- what is at work

    def _show_progress(self, step: str, progress: Progress) -> None:
        """Keep it for the live line; without a terminal, print a line now and then."""
        now = time.monotonic()
        working = self.working.setdefault(step, _Working(now, now))
        working.update(progress, now)
        if sys.stderr.isatty():
            self._show_live()
        elif now > working.last + _PLAIN_SECONDS:
            working.last = now
            self._say(f"{self._number(step)}{step}: {working.describe(now)}", sys.stderr)

    def _show_live(self) -> None:
        """Show the live lines, which a thread redraws until `close`."""
        if self.live is not None or not sys.stderr.isatty():
            return
        from rich.console import Console
        from rich.live import Live

        console = Console(stderr=True, highlight=False)
        self.live = Live(get_renderable=self._live_lines, console=console, transient=True, refresh_per_second=8)
        self.live.start()

    def _live_lines(self) -> Any:
        """A line for the set, and one for each step that is being computed, with the time since it began."""
        from rich.progress_bar import ProgressBar
        from rich.table import Table
        from rich.text import Text

        def cell(text: str) -> Text:
            return Text(one_line(text), no_wrap=True, overflow="ellipsis")

        now = time.monotonic()
        lines = Table.grid(padding=(0, 1))
        if self.items:
            words = [f"{self.ended} of {self.items}", *filter(None, [self._outlook()])]
            lines.add_row(
                cell("items"), ProgressBar(self.items, self.ended, 24), self._elapsed(now), cell(", ".join(words))
            )
        at_work = list(self.working.items())
        for step, working in at_work[:_MAX_LIVE_LINES]:
            done = None if working.progress is None else working.progress.done
            bar = ProgressBar(1.0, done or 0.0, 24, pulse=done is None)
            took = _clock(now - working.began)
            lines.add_row(cell(f"{self._number(step)}{step}"), bar, took, cell(working.describe(now)))
        if len(at_work) > _MAX_LIVE_LINES:
            lines.add_row(cell(f"and {len(at_work) - _MAX_LIVE_LINES} more steps"), "", "", "")
        return lines

    def _elapsed(self, now: float) -> str:
        return _clock(now - (self.began if self.since is None else self.since))


def _describe_scores(scores: Mapping[str, float | None]) -> str:
    return ", ".join(f"{name} {value:.2f}" for name, value in scores.items() if value is not None)


def _describe_choice(table: Mapping[str, Any]) -> str:
    """What was chosen, with its scores, and what was not, with its own; of several labels alone, why these."""
    chosen = table["chosen"]
    if not isinstance(chosen, str):
        return f"{', '.join(chosen)}, {table['because']}"
    others = [label for label in table["scores"] if label != chosen]
    described = [
        f"{label} ({_describe_scores(table['scores'][label]) or 'no scores'})" for label in (chosen, *others)
    ]
    return f"chosen is {described[0]}" + (f", not {', '.join(described[1:])}" if others else "")


def header(started: RunStarted) -> str:
    """What is run: flow, sources, size, seeds and store."""
    sources = [_source(source) for source in started.sources.values()]
    if len(sources) > 1:
        sources = [f"{name} {source}" for name, source in zip(started.sources, sources, strict=True)]
    words = [", ".join(sources)] if sources else []
    if started.items:
        words.append(f"{started.items} item{'' if started.items == 1 else 's'}")
    if started.size is not None:
        words.append(format_size(started.size))
    first, last = started.seeds[0], started.seeds[-1]
    words.append(f"seed {first}" if len(started.seeds) == 1 else f"{len(started.seeds)} seeds, {first} to {last}")
    return f"{started.flow}: {'; '.join([*words, f'store {_short_path(started.store)}'])}"


def _source(reference: str) -> str:
    name = Path(reference).name
    return name if len(name) <= _MAX_NAME else f"{name[: _MAX_NAME - 3]}..."


def _short_path(path: Path) -> str:
    """A path as one would write it in the working folder."""
    return str(path.relative_to(Path.cwd())) if path.is_relative_to(Path.cwd()) else str(path)


def _clock(seconds: float) -> str:
    """Minutes and seconds; hours before them where there are any."""
    minutes, rest = divmod(round(seconds), 60)
    return f"{minutes}:{rest:02d}" if minutes < 60 else f"{minutes // 60}:{minutes % 60:02d}:{rest:02d}"


def _duration(seconds: float) -> str:
    return f"{seconds:.1f} s" if seconds < 60 else _clock(seconds)
