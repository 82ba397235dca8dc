"""What all executors have in common: the tasks that they receive, and how they tell what has become of them."""

from __future__ import annotations

import abc
import dataclasses
from collections.abc import Callable, Mapping
from typing import Any

from texloom.pipelines.engine.events import Event
from texloom.pipelines.engine.scope import ScopeInputs
from texloom.pipelines.engine.task import TaskSpec
from texloom.stages.vocabulary.declare import Stage
from texloom.stages.vocabulary.interruption import Interruption


@dataclasses.dataclass(frozen=True)
class Outcome:
    """What became of a task: the record of its result, or the exception that prevented it."""

    record: Mapping[str, Any] | None = None
    """see `texloom.pipelines.store.store.Artifact.record`"""
    seconds: float | None = None
    """none if the result was in the store by then"""
    error: BaseException | None = None
    is_lost: bool = False
    """with its worker; the task may succeed on another one"""


@dataclasses.dataclass
class StepTask:
    """A step to compute, and who hears of it."""

    spec: TaskSpec
    stage: Stage
    inputs: ScopeInputs
    """what it takes, for executors in this process"""
    threads: int = 0
    """how many it may use, where several tasks are computed at a time"""
    is_beside: bool = False
    """whether another one of the same process is submitted right after it"""
    tell: Callable[[Event], None] = lambda _: None
    """receives its notes and progress, from any thread"""
    end: Callable[[Outcome], None] = lambda _: None
    """receives its outcome, from any thread"""

    def interrupt(self) -> None:
        """Let it end at its next report, if it is computed on a thread of this process."""
        self.tell = _interrupt


def _interrupt(_: Event) -> None:
    raise Interruption


class Executor(abc.ABC):
    """Computes tasks. Its workers are started with the first one."""

    @abc.abstractmethod
    def slots(self) -> int:
        """How many tasks it computes at a time."""

    def ahead(self) -> int:
        """How many more it takes meanwhile, so that its workers need not wait for the scheduler."""
        return 0

    @abc.abstractmethod
    def submit(self, task: StepTask) -> None:
        """Compute a task now or later and call its ``end``.

        Raises
        ------
        InputError : there are no workers.
        """

    @abc.abstractmethod
    def stop(self, at_once: bool) -> None:
        """Release the workers; ``at_once``: whatever they are doing."""
