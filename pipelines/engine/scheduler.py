"""Several steps at a time: which can be computed now, and what becomes of them.

Only steps whose result is not in the store are given to workers, and only when all that they take is there. So
their keys are known, and what a worker receives is an order of plain data. Which worker computes it, and when, is
not decided here.
"""

from __future__ import annotations

import dataclasses
import graphlib
import queue
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, Protocol

from texloom.pipelines.engine.events import Observer, StepReport
from texloom.pipelines.engine.keys import KeyParts
from texloom.pipelines.engine.run import Run, Scope, StepFailedError, healing, tell_notes, why
from texloom.pipelines.engine.task import Order
from texloom.pipelines.engine.worker import Outcome
from texloom.pipelines.flow.model import Step
from texloom.pipelines.store.store import Artifact, BrokenArtifactError
from texloom.stages.declare import InputError
from texloom.stages.kernels.core.threads import thread_count
from texloom.stages.progress import Progress


class Workers(Protocol):
    """Who computes orders. They are called together for the first order, if there is one."""

    def slots(self) -> int:
        """How many orders they can compute at a time."""

    def submit(
        self, order: Order, threads: int, heard: Callable[[Progress], None], done: Callable[[Outcome], None]
    ) -> None:
        """Hand an order to one of them, who may use so many threads. Any thread may call ``heard`` and ``done``.

        Raises
        ------
        InputError : there are no workers to be had.
        """

    def stop(self, at_once: bool) -> None:
        """Send them away; ``at_once``: whatever they are doing."""


class WorkerError(Exception):
    """What a stage raised on a worker."""

    def __init__(self, problem: str, details: str):
        super().__init__(details.rstrip() or problem)
        self.problem = problem

    def __repr__(self) -> str:
        return self.problem


def execute_with(workers: Workers, run: Run, observer: Observer, out: Path) -> dict[str, Path]:
    """As `texloom.pipelines.engine.run.Run.execute`, items and independent steps at the same time.

    When an order is lost with its worker, those that were under way are given out again one by one; what is lost
    then has failed.

    Raises
    ------
    StepFailedError : a stage raised an exception.
    InputError : a stage or source refused what it was given, or the workers are not to be had.
    BrokenStoreError : a result is broken each time that it has been computed again.
    """
    at_once = True
    try:
        exports = healing(run.store, observer, lambda: _Dispatch(workers, run, observer, out).exports())
        at_once = False
        return exports
    finally:
        workers.stop(at_once)


class _Course:
    """The steps of one scope, in the order that their inputs allow."""

    def __init__(self, run: Run, scope: Scope, kind: str):
        self.scope = scope
        self._run = run
        self.problem: Exception | None = None
        self.under_way = 0
        steps = {name: step for name, step in run.flow.steps.items() if step.scope == kind}
        self._steps = steps
        self._sorter = graphlib.TopologicalSorter(
            {name: [needed for needed in step.needs if needed in steps] for name, step in steps.items()}
        )
        self._sorter.prepare()
        self._ready: list[Step] = []

    def next(self) -> Step | None:
        """A step that can be computed now."""
        while self.problem is None:
            self._ready += [self._steps[name] for name in self._sorter.get_ready()]
            if not self._ready:
                break
            step = self._ready.pop(0)
            if not self._run.is_lost(step, self.scope):
                return step
            self._sorter.done(step.name)
        return None

    def done(self, step: Step, artifact: Artifact) -> None:
        """Go on with the steps that take its result."""
        self.scope.artifacts[step.name] = artifact
        self._sorter.done(step.name)

    def failed(self, step: Step, problem: Exception) -> None:
        """Go on without its result in an item; what all items share must be there."""
        if self.scope.item is None:
            self.problem = problem
        else:
            self.scope.lost[step.name] = why(problem)
            self._sorter.done(step.name)

    @property
    def is_over(self) -> bool:
        """Whether all steps are done, or no more can be."""
        return not self.under_way and (self.problem is not None or not self._sorter.is_active())


@dataclasses.dataclass
class _Flight:
    """A key that is being computed, and for which steps."""

    order: Order
    parts: KeyParts
    wanted: list[tuple[_Course, Step]]
    threads: int = 0
    alone: bool = False
    """whether no other is under way"""


class _Dispatch:
    """One go at a run."""

    def __init__(self, workers: Workers, run: Run, observer: Observer, out: Path):
        self.workers = workers
        self.run = run
        self.observer = observer
        self.out = out
        self.history: dict[str, Any] = {}
        self.written: dict[str, Path] = {}
        self.flights: dict[str, _Flight] = {}
        self.suspects: list[_Flight] = []
        self.broken: BrokenArtifactError | None = None
        self.said: queue.SimpleQueue[Callable[[], None]] = queue.SimpleQueue()
        self.finished = 0

    def exports(self) -> dict[str, Path]:
        """Run what is not cached, and write the exports."""
        run = self.run
        earlier = run.store.last_run(run.flow.name)
        run.shared.lost.clear()
        tell_notes(run.shared, self.observer)
        try:
            self._complete(iter([_Course(run, run.shared, "shared")]))
            self._complete(self._items())
            self._complete(iter([_Course(run, run.shared, "final")]))
            self.written |= run.export(run.shared, "shared", self.out)
            self.written |= run.export(run.shared, "final", self.out)
        finally:
            run.remember(earlier, self.history)
        return run.in_order(self.written)

    def _items(self) -> Iterator[_Course]:
        for item in self.run.items:
            self.run.scopes[item.name] = None
            try:
                self.run.scopes[item.name] = scope = Scope(self.run.flow, item, self.run.shared)
            except InputError as error:
                self._end_item(item.name, str(error))
            else:
                tell_notes(scope, self.observer)
                yield _Course(self.run, scope, "item")

    # -- what can be computed

    def _complete(self, courses: Iterator[_Course]) -> None:
        """Take all courses to their end."""
        active: list[_Course] = []
        while True:
            self._give_out(active, courses)
            if not self.flights:
                break
            self.said.get()()
        if self.broken is not None:
            raise self.broken

    def _give_out(self, active: list[_Course], courses: Iterator[_Course]) -> None:
        chosen: list[_Flight] = []
        if self.suspects:
            if not self.flights:
                chosen = [dataclasses.replace(self.suspects.pop(0), alone=True)]
        else:
            while self.broken is None and (not self.flights or len(self.flights) < self.workers.slots()):
                flight = self._next(active, courses)
                if flight is None:
                    break
                self.flights[flight.parts.key] = flight
                chosen.append(flight)
        self._submit(chosen)

    def _next(self, active: list[_Course], courses: Iterator[_Course]) -> _Flight | None:
        """The first step that is to be computed, of courses that have begun or of the next ones."""
        while True:
            for course in list(active):
                while (step := course.next()) is not None:
                    flight = self._look_up(course, step)
                    if flight is not None:
                        return flight
                if course.is_over:
                    active.remove(course)
                    self._end(course)
            begun = next(courses, None)
            if begun is None:
                return None
            active.append(begun)

    def _look_up(self, course: _Course, step: Step) -> _Flight | None:
        """The order for a step whose result is neither in the store nor on its way."""
        parts = self.run.parts(step, course.scope)
        self.history[course.scope.label(step)] = parts.as_dict()
        if parts.key in self.flights:
            self.flights[parts.key].wanted.append((course, step))
            course.under_way += 1
            return None
        found = self.run.found(step, course.scope.label(step), parts, self.observer)
        if found is not None:
            self.run.store.touch(found)
            self._report(course, step, parts, "cached", 0.0)
            course.done(step, found)
            return None
        course.under_way += 1
        return _Flight(self.run.order(step, parts, course.scope), parts, [(course, step)])

    def _submit(self, flights: list[_Flight]) -> None:
        used = sum(flight.threads for flight in self.flights.values())
        for flight in flights:
            self.flights[flight.parts.key] = flight
            flight.threads = max(1, (thread_count() - used) // len(flights))
        for flight in flights:
            label = flight.order.label
            self.observer.started(label)

            def heard(progress: Progress, label: str = label) -> None:
                self.said.put(lambda: self.observer.progressed(label, progress))

            def done(outcome: Outcome, flight: _Flight = flight) -> None:
                self.said.put(lambda: self._land(flight, outcome))

            self.workers.submit(flight.order, flight.threads, heard, done)

    # -- what has become of it

    def _land(self, flight: _Flight, outcome: Outcome) -> None:
        del self.flights[flight.parts.key]
        for note in outcome.notes:
            self.observer.noted(note)
        if outcome.state == "lost" and not flight.alone:
            self.observer.noted(f"{flight.order.label}: {outcome.problem}; computing it again")
            self.suspects.append(flight)
            return
        artifact, problem = None, None
        try:
            artifact, problem = self._result(flight, outcome)
        except BrokenArtifactError as error:
            self.broken = error
        for number, (course, step) in enumerate(flight.wanted):
            course.under_way -= 1
            if artifact is not None:
                state = "ran" if outcome.state == "ran" and number == 0 else "cached"
                self._report(course, step, flight.parts, state, outcome.seconds if number == 0 else 0.0)
                course.done(step, artifact)
            elif problem is not None:
                course.failed(step, problem)
                self._report(course, step, flight.parts, "failed", outcome.seconds)

    def _result(self, flight: _Flight, outcome: Outcome) -> tuple[Artifact | None, Exception | None]:
        """The artifact, or what kept it from being made; `BrokenArtifactError` if what it takes is broken."""
        step = flight.wanted[0][1]
        if outcome.record is not None:
            return self.run.checked(step, flight.order.label, flight.parts, outcome.record), None
        if outcome.state == "broken":
            raise BrokenArtifactError(outcome.problem, outcome.broken)
        if outcome.state == "unreadable":
            return None, InputError(outcome.problem)
        if outcome.state == "refused":
            return None, InputError(f"{self.run.flow.where('steps', step.name)}: {outcome.problem}")
        failure = StepFailedError(step.name)
        details = outcome.details
        failure.__cause__ = WorkerError(outcome.problem, details) if details else OSError(outcome.problem)
        return None, failure

    def _report(self, course: _Course, step: Step, parts: KeyParts, state: Any, seconds: float) -> None:
        self.observer.finished(StepReport(step.name, step.stage.name, parts.key, state, seconds, course.scope.name))

    def _end(self, course: _Course) -> None:
        """An item is done, as far as it could be; the run has failed where a step that all share has."""
        name = course.scope.name
        if name is None:
            if course.problem is not None:
                raise course.problem
            return
        try:
            self.written |= self.run.export(course.scope, "item", self.out)
        except BrokenArtifactError as error:
            self.broken = error
            return
        course.scope.forget_images()
        self._end_item(name, course.scope.problem)

    def _end_item(self, name: str, problem: str | None) -> None:
        self.finished += 1
        self.observer.finished_item(name, self.finished, len(self.run.items), problem)
