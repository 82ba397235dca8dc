"""The steps of one scope: which can be computed now, and which are lost with what they take."""

from __future__ import annotations

from texloom.pipelines.engine.chosen_steps import present
from texloom.pipelines.engine.run import Run
from texloom.pipelines.engine.scope import Scope, ScopeInputs
from texloom.pipelines.flow.model import Step
from texloom.pipelines.store.store import Artifact


class ScopeRun:
    """The steps of one scope, in the order of the flow as far as their inputs allow."""

    def __init__(self, run: Run, scope: Scope, kind: str):
        self.scope = scope
        self.kind = kind
        self.problem: Exception | None = None
        """why the run fails; items fail by themselves, see `texloom.pipelines.engine.scope.Scope.lost`"""
        self._run = run
        self._waiting = {name: step for name, step in run.flow.steps.items() if step.scope == kind}
        self._running: dict[str, Step] = {}
        uses = [reference for step in self._waiting.values() for reference in step.inputs.values()]
        if kind != "shared" or not run.items:  # shared exports of a set are written after all items
            uses += run.exports_of(kind).values()
        else:
            uses = [given for given in uses if given.output is not None]
        self.inputs = ScopeInputs(run.store, scope, uses)

    def next(self) -> Step | None:
        """A step that can be computed now."""
        for name, declared in list(self._waiting.items()):
            if self.problem is not None:
                break
            if any(needed in self._waiting or needed in self._running for needed in declared.needs):
                continue
            del self._waiting[name]
            step = present(declared, self.scope, self._run.store)
            if step is not None and not self._run.is_lost(step, self.scope):
                self._running[name] = step
                return step
            self.inputs.release(declared.inputs.values())
        return None

    def pass_over(self, step: Step, reason: str) -> None:
        """Go on without a step that refused what it takes, as others were chosen beside it."""
        del self._running[step.name]
        self.inputs.release(step.inputs.values())
        self.scope.passed_over[step.name] = reason

    def end(self, step: Step, result: Artifact | Exception) -> None:
        """Go on with the steps that take the result, or without it; what all items share must be there."""
        del self._running[step.name]
        self.inputs.release(step.inputs.values())
        if isinstance(result, Artifact):
            self.scope.artifacts[step.name] = result
        elif self.scope.item is None:
            self.problem = result
        else:
            self.scope.lost[step.name] = str(result)

    @property
    def is_over(self) -> bool:
        """Whether all steps have ended, or no more can be computed."""
        return not self._running and (self.problem is not None or not self._waiting)
