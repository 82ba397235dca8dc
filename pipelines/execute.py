"""Running a flow: which steps are cached, and one after the other those that are not. Plain Python, no engine."""

from __future__ import annotations

import contextlib
import dataclasses
import hashlib
import itertools
import os
import time
from collections.abc import Callable, Mapping
from functools import cached_property
from pathlib import Path
from typing import Any, Literal, Protocol

from pipelines import sources
from pipelines.fingerprint import KeyParts, generator, key_parts
from pipelines.flow import Flow, Reference, Step
from pipelines.store import Artifact, BrokenArtifactError, Store
from stages.arrays import Image
from stages.declare import InputError
from stages.progress import Progress, listening

State = Literal["cached", "ran", "failed"]


@dataclasses.dataclass(frozen=True)
class StepPlan:
    """What would become of a step."""

    name: str
    stage: str
    state: Literal["cached", "run", "wait"]
    """``wait``: its inputs will be computed first; if they come out as before, it is cached after all"""
    reasons: tuple[str, ...]
    """why it is not cached"""
    key: str | None
    """unknown while it waits"""


@dataclasses.dataclass(frozen=True)
class StepReport:
    """What became of a step."""

    name: str
    stage: str
    key: str | None
    state: State
    seconds: float


class StepFailedError(Exception):
    """A stage raised an exception, which is the cause of this one."""

    def __init__(self, step: str):
        super().__init__(step)
        self.step = step


class Observer(Protocol):
    """Who is told how a run goes."""

    def started(self, step: str) -> None:
        """A step begins to compute."""

    def progressed(self, step: str, progress: Progress) -> None:
        """A step says how far it is."""

    def finished(self, report: StepReport) -> None:
        """A step is done, was cached, or has failed."""

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

    def noted(self, text: str) -> None:
        """See `Observer`."""


class Recorder:
    """Keeps what became of the steps, and passes on what it is told."""

    def __init__(self, observer: Observer):
        self.observer = observer
        self.reports: dict[str, StepReport] = {}

    def started(self, step: str) -> None:
        """See `Observer`."""
        self.observer.started(step)

    def progressed(self, step: str, progress: Progress) -> None:
        """See `Observer`."""
        self.observer.progressed(step, progress)

    def finished(self, report: StepReport) -> None:
        """See `Observer`. A step that ran and is met again, as another one was broken, is still one that ran."""
        if report.name not in self.reports or report.state != "cached":
            self.reports[report.name] = report
            self.observer.finished(report)

    def noted(self, text: str) -> None:
        """See `Observer`."""
        self.observer.noted(text)


class Engine(Protocol):
    """Who keeps the records: calls ``work`` unless the result is there by the time that it is our turn."""

    shows_cached: bool
    """whether it wants to hear of steps whose result is in the store already"""

    def ensure(self, step: Step, parts: KeyParts, upstream: list[str], work: Callable[[], Artifact]) -> Artifact:
        """The artifact of ``parts.key``, which comes from the store or from ``work``."""


class Run:
    """One flow, its sources and its store."""

    def __init__(self, flow: Flow, store: Store):
        """Open the sources and check what stages say of them; nothing is decoded or written.

        Raises
        ------
        InputError : a source or param is not usable.
        """
        self.flow = flow
        self.store = store
        self.sources = {
            name: sources.open_source(name, reference)
            for name, reference in flow.sources.items()
            if name in self._used_sources()
        }
        for step in flow.steps.values():
            if step.stage.check is not None:
                known = {
                    name: self.sources[reference.name]
                    for name, reference in step.inputs.items()
                    if reference.output is None
                }
                try:
                    step.stage.check(step.params, known)
                except InputError as error:
                    source = known.get(str(error).partition(":")[0])
                    what = f" ({source.name} is {source.reference})" if source is not None else ""
                    raise InputError(f"{flow.where('steps', step.name)}: {error}{what}") from None

    def _used_sources(self) -> set[str]:
        references = [
            *self.flow.exports.values(),
            *(r for step in self.flow.steps.values() for r in step.inputs.values()),
        ]
        return {reference.name for reference in references if reference.output is None}

    @cached_property
    def images(self) -> Mapping[str, Image]:
        """The decoded sources."""
        return {name: source.read() for name, source in self.sources.items()}

    def plan(self) -> list[StepPlan]:
        """What would happen, from the records alone."""
        artifacts: dict[str, Artifact] = {}
        earlier = self.store.last_run(self.flow.name)
        plans = []
        for step in self.flow.steps.values():
            waits = [name for name in step.needs if name not in artifacts]
            parts = key_parts(step, self.flow.seed, self._digests(step, artifacts))
            reasons = _changes(parts, earlier.get(step.name), set(waits))
            if waits:
                reasons.append(f"waits for {', '.join(waits)}")
                plans.append(StepPlan(step.name, step.stage.name, "wait", tuple(reasons), None))
                continue
            try:
                found = self.store.find(parts.stage, parts.key)
            except BrokenArtifactError as error:
                found, reasons = None, [f"broken: {error}"]
            if found is not None:
                artifacts[step.name] = found
                plans.append(StepPlan(step.name, step.stage.name, "cached", (), parts.key))
                continue
            if not reasons:
                reasons = ["its result is no longer in the store" if step.name in earlier else "never run before"]
            plans.append(StepPlan(step.name, step.stage.name, "run", tuple(reasons), parts.key))
        return plans

    def execute(self, engine: Engine, observer: Observer, out: Path) -> dict[str, Path]:
        """Run what is not cached, then write the exports into the folder ``out``; export name to file.

        Raises
        ------
        StepFailedError : a stage raised an exception.
        InputError : a stage or source refused what it was given.
        """
        while True:
            try:
                return self._export(self._execute(engine, observer), out)
            except BrokenArtifactError as error:
                observer.noted(f"{error}; computing it again")

    def _export(self, artifacts: Mapping[str, Artifact], out: Path) -> dict[str, Path]:
        from pipelines import codecs

        written = {}
        for file, reference in self.flow.exports.items():
            out.mkdir(parents=True, exist_ok=True)
            provenance = {"flow": self.flow.name, "output": str(reference), "seed": self.flow.seed}
            kind: Any = Image
            if reference.output is not None:
                kind = self.flow.steps[reference.name].stage.outputs[reference.output]
                artifact = artifacts[reference.name]
                provenance |= self.store.provenance(artifact)
            codecs.export(self.value(reference, artifacts), kind, out / file, provenance)
            written[file] = out / file
        return written

    def _execute(self, engine: Engine, observer: Observer) -> dict[str, Artifact]:
        artifacts: dict[str, Artifact] = {}
        earlier = self.store.last_run(self.flow.name)
        history: dict[str, Any] = {}
        try:
            for step in self.flow.steps.values():
                parts = key_parts(step, self.flow.seed, self._digests(step, artifacts))
                artifacts[step.name] = self._ensure(step, parts, artifacts, engine, observer)
                self.store.touch(artifacts[step.name])
                history[step.name] = dataclasses.asdict(parts)
        finally:
            if any(earlier.get(name) != parts for name, parts in history.items()):
                self.store.remember_run(self.flow.name, {**earlier, **history})
        return artifacts

    def _ensure(
        self, step: Step, parts: KeyParts, artifacts: Mapping[str, Artifact], engine: Engine, observer: Observer
    ) -> Artifact:
        started = time.perf_counter()
        ran = False

        def work() -> Artifact:
            nonlocal ran
            ran = True
            observer.started(step.name)
            with listening(lambda progress: observer.progressed(step.name, progress)):
                result = self._compute(step, parts, artifacts, observer)
            provenance = {**dataclasses.asdict(parts), "flow": self.flow.name, "step": step.name}
            return self.store.save(step.stage, parts.key, result, provenance)

        def report(state: State) -> StepReport:
            return StepReport(step.name, step.stage.name, parts.key, state, time.perf_counter() - started)

        try:
            artifact = self.store.find(parts.stage, parts.key)
        except BrokenArtifactError as error:
            observer.noted(f"{step.name}: the stored result is broken ({error}); computing it again")
            artifact = None
        if artifact is None:
            _ = self.images  # a broken source must be found before anything is written
            self.store.create()
        try:
            if artifact is None or engine.shows_cached:
                artifact = engine.ensure(step, parts, step.needs, work)
        except BrokenArtifactError:
            raise
        except InputError as error:
            observer.finished(report("failed"))
            raise InputError(f"{self.flow.where('steps', step.name)}: {error}") from None
        except Exception as error:
            observer.finished(report("failed"))
            raise StepFailedError(step.name) from error
        observer.finished(report("ran" if ran else "cached"))
        return artifact

    def _compute(self, step: Step, parts: KeyParts, artifacts: Mapping[str, Artifact], observer: Observer) -> Any:
        """Call the stage."""
        keep_kernels()
        stage = step.stage
        arguments: dict[str, Any] = {}
        for name, reference in step.inputs.items():
            arguments[name] = self.value(reference, artifacts)
        if "params" in stage.function.__annotations__:
            arguments["params"] = step.params
        if stage.uses_rng:
            arguments["rng"] = generator(self.flow.seed, step.name)
        if stage.uses_checkpoints:
            checkpoints = self.store.checkpoints(stage.name, parts.key)
            if levels := checkpoints.levels():
                observer.noted(f"{step.name}: goes on after scale {levels[0]} of an interrupted run")
            arguments["checkpoints"] = checkpoints
        return stage.function(**arguments)

    def value(self, reference: Reference, artifacts: Mapping[str, Artifact]) -> Any:
        """A source's image or a step's output, read from the store.

        Raises
        ------
        BrokenArtifactError : the files are not what was written; their record is gone now, so that `execute` makes
            them again.
        """
        if reference.output is None:
            return self.images[reference.name]
        artifact = artifacts[reference.name]
        try:
            kind = self.flow.steps[reference.name].stage.result
            return self.store.load(artifact, kind, [reference.output])[reference.output]
        except BrokenArtifactError as error:
            self.store.forget(artifact)
            raise BrokenArtifactError(f"{reference.name}: the stored result is broken ({error})") from None

    def _digests(self, step: Step, artifacts: Mapping[str, Artifact]) -> dict[str, str]:
        """Content digests of the inputs that are known by now."""
        found = {}
        for name, reference in step.inputs.items():
            if reference.output is None:
                found[name] = self.sources[reference.name].digest
            elif reference.name in artifacts:
                found[name] = artifacts[reference.name].outputs[reference.output]
        return found


def default_out(store: Store, flow: str) -> Path:
    """A folder for this run's exports that is not there yet."""
    first = store.root / "runs" / f"{flow}-{time.strftime('%Y%m%d-%H%M%S')}"
    names = (first if count == 1 else first.with_name(f"{first.name}-{count}") for count in itertools.count(1))
    return next(path for path in names if not path.exists())


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


def _changes(parts: KeyParts, earlier: Mapping[str, Any] | None, waits: set[str]) -> list[str]:
    if earlier is None:
        return []
    unknown = {name for name in earlier.get("inputs", {}) if name not in parts.inputs} if waits else set()
    known = {name: digest for name, digest in earlier.get("inputs", {}).items() if name not in unknown}
    return parts.differences({**earlier, "inputs": known})


def keep_kernels() -> None:
    """Keep compiled kernels in the user's cache, by the digest of all kernels.

    Numba by itself sees a change in a kernel's own file only, not in those that it calls.
    """
    if "NUMBA_CACHE_DIR" in os.environ:
        return
    import platformdirs

    folder = platformdirs.user_cache_path("texloom") / f"kernels-{_kernel_digest()}"
    with contextlib.suppress(OSError):
        folder.mkdir(parents=True, exist_ok=True)
        if os.access(folder, os.W_OK):
            os.environ["NUMBA_CACHE_DIR"] = str(folder)


def _kernel_digest() -> str:
    import stages.kernels

    files = sorted(Path(next(iter(stages.kernels.__path__))).glob("*.py"))
    return hashlib.sha256(b"".join(path.read_bytes() for path in files)).hexdigest()[:16]
