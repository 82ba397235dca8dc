"""Who is told how a run goes."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from typing import Any, Literal, Protocol

from texloom.stages.progress import Progress

State = Literal["cached", "ran", "failed"]


@dataclasses.dataclass(frozen=True)
class StepReport:
    """What became of a step."""

    name: str
    stage: str
    key: str | None
    state: State
    seconds: float
    item: str | None = None
    """the item of a set that it ran for"""

    @property
    def label(self) -> str:
        """Tells it from the same step of other items."""
        return label(self.name, self.item)


def label(step: str, item: str | None) -> str:
    """A step's name, after that of its item."""
    return step if item is None else f"{item}/{step}"


class Observer(Protocol):
    """Hears how a run goes. Steps are called by their labels."""

    def started(self, step: str) -> None:
        """A step begins to compute."""

    def progressed(self, step: str, progress: Progress) -> None:
        """A step says how far it is."""

    def finished(self, report: StepReport) -> None:
        """A step is done, was cached, or has failed."""

    def finished_item(self, item: str, number: int, count: int, problem: str | None) -> None:
        """An item of a set is done, the ``number``-th of ``count``, or has failed by a problem."""

    def noted(self, text: str) -> None:
        """Something the user should know."""


class Silent:
    """Tells nobody."""

    def started(self, step: str) -> None:
        """See `Observer`."""

    def progressed(self, step: str, progress: Progress) -> None:
        """See `Observer`."""

    def finished(self, report: StepReport) -> None:
        """See `Observer`."""

    def finished_item(self, item: str, number: int, count: int, problem: str | None) -> None:
        """See `Observer`."""

    def noted(self, text: str) -> None:
        """See `Observer`."""


class Recorder:
    """Keeps what became of the steps, and passes on what it is told."""

    def __init__(self, observer: Observer):
        self.observer = observer
        self.reports: dict[str, StepReport] = {}
        self.problems: dict[str, str] = {}
        """item to why it failed"""
        self.done: set[str] = set()
        """items that have not failed"""

    def started(self, step: str) -> None:
        """See `Observer`."""
        self.observer.started(step)

    def progressed(self, step: str, progress: Progress) -> None:
        """See `Observer`."""
        self.observer.progressed(step, progress)

    def finished(self, report: StepReport) -> None:
        """See `Observer`. A step that ran and is met again, as another one was broken, is still one that ran."""
        if report.label not in self.reports or report.state != "cached":
            self.reports[report.label] = report
            self.observer.finished(report)

    def finished_item(self, item: str, number: int, count: int, problem: str | None) -> None:
        """See `Observer`."""
        self.problems.pop(item, None)
        self.done.add(item)
        if problem is not None:
            self.problems[item] = problem
            self.done.discard(item)
        self.observer.finished_item(item, number, count, problem)

    def noted(self, text: str) -> None:
        """See `Observer`."""
        self.observer.noted(text)

    def items(self, count: int) -> dict[str, Any]:
        """What has become of a set of ``count`` items, for a report."""
        return {
            "count": count,
            "done": len(self.done),
            "failed": len(self.problems),
            "left": count - len(self.done) - len(self.problems),
            "problems": dict(self.problems),
        }


def describe_progress(progress: Progress) -> str:
    """One line: scale, iteration, energy, share done."""
    words = [f"{100 * progress.done:.0f} %"]
    if progress.scales:
        words.append(f"scale {progress.scale}/{progress.scales}")
    if progress.iterations:
        words.append(f"iteration {progress.iteration}/{progress.iterations}")
    if progress.energy is not None:
        words.append(f"energy {progress.energy:.4g}")
    return ", ".join(words)


def summary_of(problems: Mapping[str, str], count: int) -> str:
    """Which items of ``count`` failed, and why."""
    listed = "; ".join(f"{item} ({problem})" for item, problem in problems.items())
    return f"{len(problems)} of {count} items failed: {listed}"
