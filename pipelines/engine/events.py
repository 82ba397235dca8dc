"""What a run reports while it goes on."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, Literal

from texloom.stages.vocabulary.messages import OWN_STEP
from texloom.stages.vocabulary.progress import Progress

State = Literal["cached", "ran", "failed"]


def label(step: str, item: str | None) -> str:
    """A step's name, after that of its item."""
    return step if item is None else f"{item}/{step}"


def warning_of(text: str, step: str) -> Note:
    """What a stage has warned of, told of the step with this `label`."""
    own = step.rpartition("/")[2]
    return Note(f"{step}: {text.replace(f'--set {OWN_STEP}.', f'--set {own}.')}", is_warning=True)


@dataclasses.dataclass(frozen=True)
class RunStarted:
    """A run begins; nothing has been looked up or computed."""

    flow: str
    sources: Mapping[str, str]
    """name to what it is: a file, a pattern"""
    size: tuple[int, int] | None
    """height and width of the result, px, where the flow has such a param"""
    seeds: tuple[int, ...]
    store: Path
    steps: tuple[str, ...]
    """the names of all steps, in the order of the flow"""
    items: int
    """how many the set has; 0 without a set"""


@dataclasses.dataclass(frozen=True)
class StepStarted:
    """A step begins to compute."""

    step: str
    """its `label`"""


@dataclasses.dataclass(frozen=True)
class StepProgress:
    """A step reports how far it is."""

    step: str
    """its `label`"""
    progress: Progress
    picture: bytes = b""
    """PNG of what there is, once for each scale, where the run `shows_scales`"""


@dataclasses.dataclass(frozen=True)
class StepReport:
    """A step is done, was cached, or has failed."""

    name: str
    stage: str
    key: str | None
    state: State
    seconds: float
    item: str | None = None
    """the item of a set that it ran for"""
    problem: str | None = None
    """why it has failed"""
    details: str = ""
    """the traceback, if its stage raised what no stage should"""

    @property
    def label(self) -> str:
        """Tells it from the same step of other items."""
        return label(self.name, self.item)


@dataclasses.dataclass(frozen=True)
class ItemReport:
    """An item of a set is done or has failed."""

    item: str
    number: int
    """how many items have ended so far"""
    count: int
    """of items"""
    problem: str | None
    """why it failed"""


@dataclasses.dataclass(frozen=True)
class Note:
    """Something that the user should know."""

    text: str
    is_warning: bool = False
    """whether the result may not be what the user wants"""
    exports: Mapping[str, Path] = dataclasses.field(default_factory=dict)
    """export name to file, of those that were written though the run has failed"""


@dataclasses.dataclass(frozen=True)
class Shared:
    """What has passed between the store and the shared one for a step."""

    fetched: bool = False
    uploaded: bool = False
    outage: str = ""
    """why the shared store could not be used"""
    is_known: bool = False
    """whether that says nothing new of the storage, which was not asked, or is not at fault"""
    refusal: str = ""
    """why its result was not used"""

    @property
    def has_failed(self) -> bool:
        """Whether something did not pass."""
        return bool(self.outage or self.refusal)


Event = RunStarted | StepStarted | StepProgress | StepReport | ItemReport | Note | Shared
Listener = Callable[[Event], None]


class Recorder:
    """A listener that keeps the reports of steps and items and passes all events on."""

    def __init__(self, listener: Listener):
        self.listener = listener
        self.reports: dict[str, StepReport] = {}
        self.ended: dict[str, str | None] = {}
        """item to why it failed, if it did"""
        self.warnings: list[str] = []
        """why results may not be what the user wants"""
        self.exports: dict[str, Path] = {}
        """see `Note`"""
        self.shared = {"fetched": 0, "uploaded": 0, "failed": 0}
        """how many results have passed from and to the shared store, and with how many something failed"""

    @property
    def problems(self) -> dict[str, str]:
        """Item to why it failed."""
        return {item: problem for item, problem in self.ended.items() if problem is not None}

    def __call__(self, event: Event) -> None:
        """Keep a report. A step that ran and is cached when the run is restarted remains one that ran."""
        if isinstance(event, StepReport):
            if event.label in self.reports and event.state == "cached":
                return
            self.reports[event.label] = event
        elif isinstance(event, ItemReport):
            self.ended[event.item] = event.problem
        elif isinstance(event, Note):
            self.warnings += [event.text] * event.is_warning
            self.exports |= event.exports
        elif isinstance(event, Shared):
            self.shared["fetched"] += event.fetched
            self.shared["uploaded"] += event.uploaded
            self.shared["failed"] += event.has_failed
        self.listener(event)

    def items(self, count: int) -> dict[str, Any]:
        """What has become of a set of ``count`` items, for a report."""
        failed, left = len(self.problems), count - len(self.ended)
        done = len(self.ended) - failed
        return {"count": count, "done": done, "failed": failed, "left": left, "problems": self.problems}


class HeldEvents:
    """A listener that passes nothing on until a run is accepted, so that of a refused one only the error is told.

    A run is accepted when its first step begins to compute or its first item has ended, and when it ends in any way
    but by an `InputError`.
    """

    def __init__(self, listener: Listener):
        self._listener = listener
        self._held: list[Event] | None = []

    def __call__(self, event: Event) -> None:
        """Hold or pass on an event."""
        if self._held is None:
            self._listener(event)
            return
        self._held.append(event)
        if isinstance(event, StepStarted | ItemReport):
            self.release()

    def release(self) -> None:
        """Pass on what has been held, and all that follows."""
        held, self._held = self._held or [], None
        for event in held:
            self._listener(event)


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
    items: dict[str, list[str]] = {}
    for item, problem in problems.items():
        items.setdefault(problem, []).append(item)
    listed = "; ".join(f"{', '.join(names)} ({problem})" for problem, names in items.items())
    return f"{len(problems)} of {count} items failed: {listed}"
