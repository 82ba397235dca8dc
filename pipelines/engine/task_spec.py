"""Tasks: one step with all that it takes as plain data, so that any process that sees the store can compute it."""

from __future__ import annotations

import contextlib
import dataclasses
import time
import traceback
from collections.abc import Iterator, Mapping
from typing import Any

import pydantic

from texloom.pipelines.engine.events import Listener, Note, StepProgress, warning_of
from texloom.pipelines.engine.keys import KeyParts, generator, key_parts
from texloom.pipelines.engine.stage_call import call_stage
from texloom.pipelines.engine.stage_log import logging_to
from texloom.pipelines.flow.model import Reference, Step
from texloom.pipelines.media.sources import Source, SourceValue
from texloom.pipelines.store.outputs import Outputs
from texloom.pipelines.store.preview import small_png
from texloom.pipelines.store.result_files import BrokenArtifactError
from texloom.pipelines.store.store import Store
from texloom.stages.kernels.core.threads import sharing
from texloom.stages.lookup.registry import find_stage
from texloom.stages.vocabulary.declare import InputError, Stage
from texloom.stages.vocabulary.progress import Progress, listening


@dataclasses.dataclass(frozen=True)
class Output:
    """An output of a step whose result is in the store."""

    step: str
    stage: str
    key: str
    output: str
    digest: str
    """of the output's content"""

    @property
    def reference(self) -> Reference:
        """What a flow calls it."""
        return Reference(self.step, self.output)

    @property
    def label(self) -> str:
        """For provenance."""
        return str(self.reference)


Given = Source | Output
GivenList = list[Given | None]


@dataclasses.dataclass(frozen=True)
class Upstream:
    """A step whose result has gone into this one."""

    step: str
    item: str | None
    stage: str
    key: str


@dataclasses.dataclass(frozen=True)
class TaskSpec:
    """A step to compute."""

    flow: str
    step: str
    label: str
    """what the step is called among those of other items"""
    parts: KeyParts
    """what the key of the result is made of"""
    params: Mapping[str, Any]
    """as JSON has them"""
    seed: int
    draws_as: str
    inputs: Mapping[str, Given]
    gather: Mapping[str, GivenList | dict[str, GivenList]]
    items: list[dict[str, Any]] | None
    """all items, for stages that take them"""
    upstream: list[Upstream] | None
    """for stages that take provenance, in the order of the flow"""
    shows_scales: bool = False
    """whether what it reports comes with a picture of each scale"""

    def to_json(self) -> str:
        """All of it as text."""
        return _ADAPTER.dump_json(self).decode()

    @classmethod
    def from_json(cls, text: str) -> TaskSpec:
        """The task that `to_json` wrote."""
        return _ADAPTER.validate_json(text)


_ADAPTER = pydantic.TypeAdapter(TaskSpec)


class Inputs:
    """Where a task gets what it takes: sources are decoded and outputs read from the store."""

    def __init__(self, store: Store):
        self.store = store

    def source(self, source: Source) -> SourceValue:
        """A decoded source."""
        return source.value()

    def output(self, given: Output) -> Any:
        """An output of another step.

        Raises
        ------
        BrokenArtifactError : the files are not what was written; their record is removed by then.
        """
        artifact = self.store.location(given.stage, given.key)
        try:
            return self.store.load(artifact, find_stage(given.stage).result, [given.output])[given.output]
        except BrokenArtifactError as error:
            self.store.forget(given.stage, given.key)
            raise BrokenArtifactError(f"{given.step}: the stored result is broken ({error})", given.key) from None

    def keep(self, step: str, outputs: Outputs) -> None:
        """Receive the result of a task, for those that take it."""

    def value(self, given: Given | None) -> Any:
        """Whatever a task takes."""
        if given is None:
            return None
        return self.source(given) if isinstance(given, Source) else self.output(given)


def run_task(
    spec: TaskSpec, stage: Stage, inputs: Inputs, threads: int | None, listener: Listener
) -> dict[str, Any]:
    """Compute a step and save its result; its record. The caller holds the lock of its key.

    Parameters
    ----------
    threads : how many it may use; all if not given.
    listener : receives notes and progress.
    """
    began = time.perf_counter()
    warnings: list[str] = []

    def warn(text: str) -> None:
        warnings.append(text)
        listener(warning_of(text, spec.label))

    with sharing(threads) if threads is not None else contextlib.nullcontext(), _releasing_arrays():
        with (
            listening(_ProgressReports(spec, listener)),
            logging_to(stage.module, warn),
            inputs.store.scratch(),
        ):
            outputs = call_stage(stage, _arguments(spec, stage, inputs, listener))
        labels = {name: given.label for name, given in spec.inputs.items()}
        provenance = {**spec.parts.as_dict(), "flow": spec.flow, "step": spec.step, "from": labels}
        provenance |= {"warnings": warnings} if warnings else {}
        artifact = inputs.store.save(stage, spec.parts.key, outputs, provenance, time.perf_counter() - began)
    inputs.keep(spec.step, outputs)
    return artifact.record


@contextlib.contextmanager
def _releasing_arrays() -> Iterator[None]:
    """Release what the frames of an exception hold, as they are in a cycle: without memory all else would fail."""
    try:
        yield
    except Exception as error:
        cause: BaseException | None = error
        while cause is not None:
            traceback.clear_frames(cause.__traceback__)
            cause = cause.__context__
        raise


class _ProgressReports:
    """Reports of a step as events, with a picture of each scale where those are shown."""

    def __init__(self, spec: TaskSpec, listener: Listener):
        self._spec, self._listener = spec, listener
        self._scale = -1

    def __call__(self, progress: Progress) -> None:
        picture = b""
        if self._spec.shows_scales and progress.preview is not None and progress.scale != self._scale:
            self._scale = progress.scale
            with contextlib.suppress(Exception):  # a plug-in's may be wrong, and its result right
                picture = small_png(progress.preview().srgb)
        self._listener(StepProgress(self._spec.label, progress, picture))


def _arguments(spec: TaskSpec, stage: Stage, inputs: Inputs, listener: Listener) -> dict[str, Any]:
    known: dict[str, Any] = {}

    def values(listed: GivenList) -> list[Any]:
        """Equal ones are read once."""
        for given in listed:
            if given is not None and given.digest not in known:
                known[given.digest] = inputs.value(given)
        return [None if given is None else known[given.digest] for given in listed]

    arguments: dict[str, Any] = {name: inputs.value(given) for name, given in spec.inputs.items()}
    for name, gathered in spec.gather.items():
        if isinstance(gathered, list):
            arguments[name] = values(gathered)
        else:
            arguments[name] = {tag: values(listed) for tag, listed in gathered.items()}
    if "params" in stage.function.__annotations__:
        arguments["params"] = stage.params.model_validate(spec.params)
    if stage.uses_rng:
        arguments["rng"] = generator(spec.seed, spec.draws_as)
    if stage.uses_items:
        arguments["items"] = spec.items
    if stage.uses_provenance:
        arguments["provenance"] = [_provenance(entry, inputs.store) for entry in spec.upstream or ()]
    if stage.uses_checkpoints:
        checkpoints = inputs.store.checkpoints(stage.name, spec.parts.key)
        if levels := checkpoints.levels():
            listener(Note(f"{spec.label}: goes on after scale {levels[0]} of an interrupted run"))
        arguments["checkpoints"] = checkpoints
    return arguments


def _provenance(entry: Upstream, store: Store) -> dict[str, Any]:
    artifact = store.location(entry.stage, entry.key)
    return {"step": entry.step, "item": entry.item, **store.provenance(artifact)}


def check_same(spec: TaskSpec) -> None:
    """`InputError` unless this process has the code and the files that the task was made with."""
    try:
        stage = find_stage(spec.parts.stage)
    except KeyError:
        problem = "this machine has no such stage; install the plug-in"
        raise InputError(f"{spec.label}: {spec.parts.stage}: {problem}") from None
    step = Step(spec.step, stage, {}, stage.params.model_validate(spec.params), draws_as=spec.draws_as)
    ours = key_parts(step, spec.seed, spec.parts.inputs)
    if ours.key != spec.parts.key:
        changes = ", ".join(ours.differences(spec.parts.as_dict()))
        raise InputError(f"{spec.label}: its texloom or its files are not those of the run: {changes}")
