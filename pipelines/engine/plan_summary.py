"""What a plan comes to: how many steps would run, for how many items, and what they take.

Time and disk of a step are those of its last result for the same sources, in proportion to the pixels that it
makes, where the store has that; else they are estimated. Memory is estimated.
"""

from __future__ import annotations

import dataclasses
import math
from collections import Counter
from collections.abc import Callable, Sequence
from statistics import fmean
from typing import Any, NamedTuple

from texloom.pipelines.byte_size import format_byte_size
from texloom.pipelines.engine.executors.executor_choice import worker_count
from texloom.pipelines.engine.footprint import (
    Footprint,
    describe_seconds,
    disk_of,
    disk_of_exports,
    memory_of,
    seconds_of,
)
from texloom.pipelines.engine.run import Run, StepPlan
from texloom.pipelines.engine.scope import Scope
from texloom.pipelines.flow.model import Step
from texloom.pipelines.store.history import History
from texloom.pipelines.store.result_files import BrokenArtifactError, read_manifest
from texloom.stages.vocabulary.sizes import parse_size

_STATES = {"cached": "cached", "fetch": "to fetch", "run": "to run", "wait": "waiting", "refused": "refused"}
_SAMPLES = 8  # items whose earlier results stand for those of all


class Taken(NamedTuple):
    """What a step took, or takes."""

    seconds: float
    disk: float
    """bytes"""


@dataclasses.dataclass(frozen=True)
class PlanSummary:
    """A plan in numbers."""

    items: int
    """of a set; 0 without one"""
    states: dict[str, int]
    """how many steps are in each state, over all items"""
    seconds: float
    """that the steps take which are not cached"""
    memory: int
    """bytes, of all processes together; 0 if all is cached"""
    disk: int
    """bytes of their results and of the exports; of large results at most, with all that is there for a while"""
    measured: int
    """steps that are not cached whose time and disk are those of an earlier result"""
    footprint: Footprint | None
    """what large pictures take of memory and disk"""
    fetched: int = 0
    """bytes that come from the shared store"""
    left_out: int = 0
    """bytes of the results that are not kept, as they are intermediate"""

    @property
    def is_refused(self) -> bool:
        """Whether something would not run as it is."""
        return "refused" in self.states or (self.footprint is not None and bool(self.footprint.problem))

    def __str__(self) -> str:
        counts = [f"{self.states[state]} {words}" for state, words in _STATES.items() if state in self.states]
        steps = ", ".join(counts)
        lines = [steps if not self.items else f"{self.items} item{'s' * (self.items > 1)}: {steps}"]
        if "fetch" in self.states:
            lines.append(f"fetches {format_byte_size(self.fetched)}")
        pending = self.states.get("run", 0) + self.states.get("wait", 0)
        if pending:
            memory, disk = format_byte_size(self.memory), format_byte_size(self.disk)
            lines.append(f"takes about {describe_seconds(self.seconds)}, {memory} of memory and {disk} of disk")
            if self.left_out:
                lines[-1] += f", of which {format_byte_size(self.left_out)} is left out at the end (keep: final)"
            some = "" if self.measured == pending else f" of {self.measured} steps"
            measured = f"time and disk{some} as their last results took, else estimated"
            lines.append(measured if self.measured else "roughly estimated")
        if self.footprint is not None and self.footprint.problem:
            lines.append(self.footprint.problem)
        return "; ".join(lines)


def summary(run: Run, steps: Sequence[StepPlan]) -> PlanSummary:
    """What a plan of a run comes to."""
    states: dict[str, int] = dict(Counter(step.state for step in steps))
    pending = [step for step in steps if step.state in ("run", "wait")]
    fetched = sum(step.fetched for step in steps)
    if not pending:
        return PlanSummary(len(run.items), states, 0, 0, 0, 0, None, fetched)
    earlier = _earlier(run)
    counts = Counter(step.name for step in pending if step.name in earlier)
    seconds = sum(count * earlier[name].seconds for name, count in counts.items())
    disk = sum(count * earlier[name].disk for name, count in counts.items())
    passing = run.flow.intermediate
    left_out = sum(count * earlier[name].disk for name, count in counts.items() if name in passing)
    memory = 0
    pending_of: dict[str | None, set[str]] = {}
    for step in pending:
        pending_of.setdefault(step.item, set()).add(step.name)
    for scope in run.known_scopes:
        names = pending_of.get(scope.name, set())
        own = [step for name, step in run.flow.steps.items() if name in names]
        unknown = [step for step in own if step.name not in earlier]
        seconds += seconds_of(unknown, run.flow.steps, scope)
        disk += disk_of(unknown, run.flow.steps, scope) + disk_of_exports(run.flow, own, scope)
        left_out += disk_of([step for step in unknown if step.name in passing], run.flow.steps, scope)
        memory = max(memory, memory_of(own, run.flow.steps, scope))
    if run.flow.runner.name == "processes":
        memory *= min(len(pending), run.flow.runner.workers or worker_count(run))
    large = run.footprint()
    if large is not None:
        memory, disk = large.all_memory, max(disk, large.disk)
    return PlanSummary(
        len(run.items), states, seconds, memory, int(disk), counts.total(), large, fetched, int(left_out)
    )


def _earlier(run: Run) -> dict[str, Taken]:
    """Step to what it takes by its last results for the same sources, those of the first items that have them."""
    history = run.history()
    found: dict[str, list[Taken]] = {}
    for scope in run.known_scopes if history.steps else []:
        if not _has_same_sources(run, scope, history):
            continue
        for name, step in run.flow.steps.items():
            known = found.setdefault(name, [])
            if len(known) < _SAMPLES and (taken := _last(run, step, scope, history)) is not None:
                known.append(taken)
    return {
        name: Taken(fmean(one.seconds for one in known), fmean(one.disk for one in known))
        for name, known in found.items()
        if known
    }


def _has_same_sources(run: Run, scope: Scope, history: History) -> bool:
    """Whether what the last run took of a scope's sources has the content that is there now."""
    for step in run.flow.steps.values():
        inputs = history.steps.get(scope.label(step), {}).get("inputs", {})
        for name, given in step.inputs.items():
            is_own = given.output is None and given.name in scope.sources
            if is_own and name in inputs and inputs[name] != scope.source(given.name).digest:
                return False
    return True


def _last(run: Run, step: Step, scope: Scope, history: History) -> Taken | None:
    """What the last result of a step took, in proportion to its pixels; None where the store has none."""
    known = history.steps.get(scope.label(step))
    if known is None or (step.scope == "item") != (scope.item is not None):
        return None
    try:
        manifest, _ = read_manifest(run.store.location(known["stage"], known["key"]).place)
        seconds, disk = float(manifest["seconds"]), sum(int(file["bytes"]) for file in manifest["files"].values())
    except (BrokenArtifactError, KeyError, TypeError, ValueError):
        return None

    def earlier_size(one: Step) -> Any:
        size = history.steps.get(scope.label(one), {}).get("params", {}).get("size")
        return parse_size(size) if isinstance(size, str) else None

    now = _pixels(run, step, lambda one: getattr(one.params, "size", None))
    before = _pixels(run, step, earlier_size)
    share = now / before if now and before else 1.0
    return Taken(seconds * share, disk * share)


def _pixels(run: Run, step: Step, size_of: Callable[[Step], Any]) -> int:
    """The pixels of the largest size that a step, or one that it needs, has as a param; 0 where none has."""
    size = size_of(step)
    own = math.prod(size) if isinstance(size, tuple) else 0
    return max([own, *(_pixels(run, run.flow.steps[name], size_of) for name in step.needs)])
