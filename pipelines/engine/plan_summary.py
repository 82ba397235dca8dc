"""What a plan comes to: how many steps would run, for how many items, and what they take."""

from __future__ import annotations

import dataclasses
from collections import Counter
from collections.abc import Sequence

from texloom.pipelines.engine.footprint import Footprint, describe_seconds, seconds_of
from texloom.pipelines.engine.run import Run, StepPlan

_STATES = {"cached": "cached", "run": "to run", "wait": "waiting", "refused": "refused"}


@dataclasses.dataclass(frozen=True)
class PlanSummary:
    """A plan in numbers."""

    items: int
    """of a set; 0 without one"""
    states: dict[str, int]
    """how many steps are in each state, over all items"""
    seconds: float
    """that the steps take which are not cached, as far as their stages tell; 0 if they do not"""
    footprint: Footprint | None
    """what large pictures take of memory and disk"""

    @property
    def is_refused(self) -> bool:
        """Whether something would not run as it is."""
        return "refused" in self.states or (self.footprint is not None and bool(self.footprint.problem))

    def __str__(self) -> str:
        counts = [f"{self.states[state]} {words}" for state, words in _STATES.items() if state in self.states]
        steps = ", ".join(counts)
        lines = [steps if not self.items else f"{self.items} item{'s' * (self.items > 1)}: {steps}"]
        if self.seconds:
            lines.append(f"takes about {describe_seconds(self.seconds)} on this machine")
        if self.footprint is not None:
            lines.append(self.footprint.problem or str(self.footprint))
        return "; ".join(lines)


def summary(run: Run, steps: Sequence[StepPlan]) -> PlanSummary:
    """What a plan of a run comes to."""
    pending = [step for step in steps if step.state in ("run", "wait")]
    seconds = 0.0
    for scope in run.known_scopes:
        names = {step.name for step in pending if step.item == scope.name}
        seconds += seconds_of([step for name, step in run.flow.steps.items() if name in names], scope)
    taken = run.footprint() if pending else None
    return PlanSummary(len(run.items), dict(Counter(step.state for step in steps)), seconds, taken)
