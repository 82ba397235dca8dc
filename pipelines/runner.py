"""Engines: who runs a flow's steps. Both keep the same records, so what one has computed the other finds cached.

`LocalEngine` needs no server: Prefect's transactions, records and locks in this process. `PrefectEngine` makes
every step a task of a Prefect flow run, with progress and pictures for the UI.
"""

from __future__ import annotations

import base64
import contextlib
import contextvars
import io
import json
import logging
import re
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import httpx

from pipelines import records
from pipelines.execute import Run, default_out
from pipelines.fingerprint import KeyParts
from pipelines.flow import find_flow, load_flow
from pipelines.flow_model import Each, Overrides, Step
from pipelines.observers import Observer, Recorder, Silent, StepReport, describe_progress, summary_of
from pipelines.preview import eight_bits
from pipelines.store import Artifact, Store, record_name
from stages.arrays import Image
from stages.declare import InputError
from stages.progress import Progress

# after records, which says that nothing is to be sent anywhere
import prefect  # isort: skip
from prefect.logging.handlers import PrefectConsoleHandler  # isort: skip
from prefect.artifacts import create_image_artifact, create_progress_artifact, update_progress_artifact  # isort: skip
from prefect.settings import PREFECT_API_URL, PREFECT_FLOWS_HEARTBEAT_FREQUENCY, temporary_settings  # isort: skip
from prefect.transactions import IsolationLevel, transaction  # isort: skip

_PREVIEW_SIDE = 512  # px of pictures in the UI
_SECONDS = 2.0  # between two reports to the server
_given: contextvars.ContextVar[tuple[Run, Observer] | None] = contextvars.ContextVar("given", default=None)


class LocalEngine:
    """Steps in this process, without server."""

    shows_cached = False

    def __init__(self, store: Store):
        self.store = store
        self.records = records.result_store(store)

    def ensure(
        self,
        step: Step,  # noqa: ARG002
        name: str,
        parts: KeyParts,
        upstream: list[str],  # noqa: ARG002
        work: Callable[[], Artifact],
    ) -> Artifact:
        """See `pipelines.execute.Engine`."""
        key = record_name(parts.stage, parts.key)
        with transaction(key=key, store=self.records, isolation_level=IsolationLevel.SERIALIZABLE) as current:
            if current.is_committed():
                found = current.read()
            else:
                artifact = work()
                current.stage(artifact.record)
                found = None
        if found is not None:
            return self.store.check_record(found.result)
        if not current.is_committed():
            raise OSError(f"the record of {name} could not be written to {self.store.records}")
        return artifact


class PrefectEngine:
    """Every step a task of the flow run that is at work."""

    shows_cached = True

    def __init__(self, flow: str, store: Store):
        self.flow = flow
        self.store = store
        records.use(store)
        self.locks = records.FileLocks(store)
        self.states: dict[str, Any] = {}

    def ensure(
        self, step: Step, name: str, parts: KeyParts, upstream: list[str], work: Callable[[], Artifact]
    ) -> Artifact:
        """See `pipelines.execute.Engine`."""

        def compute(key: str) -> dict[str, Any]:  # noqa: ARG001 (the cache policy takes the key from here)
            artifact = work()
            _publish_preview(self.flow, name, artifact)
            return artifact.record

        task = prefect.task(
            name=step.name,
            task_run_name=name,
            description=step.stage.summary,
            tags=[step.stage.name],
            cache_policy=records.StepKey().configure(
                isolation_level=IsolationLevel.SERIALIZABLE, lock_manager=self.locks
            ),
            result_storage=self.store.records,
            result_serializer=records.ArtifactSerializer(),
            persist_result=True,
            cache_result_in_memory=False,
        )(compute)
        state = task(
            record_name(parts.stage, parts.key),
            return_state=True,
            wait_for=[self.states[other] for other in upstream if other in self.states],
        )
        self.states[name] = state
        return self.store.check_record(state.result())


class PrefectObserver:
    """Passes on what it is told, and tells the server."""

    def __init__(self, flow: str, observer: Observer):
        self.flow = flow
        self.observer = observer
        self.artifact: Any = None
        self.last = 0.0
        self.scale = -1

    def started(self, step: str) -> None:
        """See `pipelines.observers.Observer`."""
        self.artifact, self.last, self.scale = None, 0.0, -1
        self.observer.started(step)

    def progressed(self, step: str, progress: Progress) -> None:
        """Progress as an artifact and a log line, a picture at each scale."""
        self.observer.progressed(step, progress)
        now = time.monotonic()
        if progress.done < 1 and now < self.last + _SECONDS:
            return
        self.last = now
        text = describe_progress(progress)
        with contextlib.suppress(Exception):  # a server that is away does not stop the work
            if self.artifact is None:
                key = _key(self.flow, step, "-progress")
                self.artifact = create_progress_artifact(100 * progress.done, key, text)
            else:
                update_progress_artifact(self.artifact, 100 * progress.done, text)
            if progress.scale != self.scale:
                self.scale = progress.scale
                prefect.get_run_logger().info(text)
                if progress.preview is not None:
                    _publish_scale(self.flow, step, progress.preview(), text)

    def finished(self, report: StepReport) -> None:
        """See `pipelines.observers.Observer`."""
        self.observer.finished(report)

    def finished_item(self, item: str, number: int, count: int, problem: str | None) -> None:
        """See `pipelines.observers.Observer`."""
        if problem is not None:
            with contextlib.suppress(Exception):
                prefect.get_run_logger().error(f"{item} failed: {problem}")
        self.observer.finished_item(item, number, count, problem)

    def noted(self, text: str) -> None:
        """See `pipelines.observers.Observer`."""
        with contextlib.suppress(Exception):
            prefect.get_run_logger().warning(text)
        self.observer.noted(text)


def run_with_prefect(run: Run, observer: Observer, out: Path) -> dict[str, Path]:
    """Run a flow as a Prefect flow run under the flow's own name; export name to file."""
    _require_server()
    _leave_console_alone()
    token = _given.set((run, observer))
    try:
        with temporary_settings({PREFECT_FLOWS_HEARTBEAT_FREQUENCY: None}):  # each flow would wait for it at exit
            exports = texloom_flow.with_options(name=run.flow.name)(
                flow=str(run.flow.path.resolve()),
                source={
                    name: given.pattern if isinstance(given, Each) else given
                    for name, given in run.flow.sources.items()
                },
                seed=run.flow.seeds[0],
                store=str(run.store.root),
                out=str(out),
            )
    finally:
        _given.reset(token)
    return {name: Path(path) for name, path in exports.items()}


@prefect.flow(name="texloom", validate_parameters=True, persist_result=False)
def texloom_flow(
    flow: str,
    source: dict[str, str] | None = None,
    set: dict[str, Any] | None = None,
    seed: int | None = None,
    store: str = "artifacts",
    out: str | None = None,
) -> dict[str, str]:
    """Run a flow file, every step a task. What a deployment calls; the options are those of ``texloom run``.

    Parameters
    ----------
    flow : a flow file, or the name of a flow that ships with texloom.
    source, set, seed : what differs from the file.
    store, out : folders of the artifacts and of this run's exports.
    """
    given = _given.get()
    if given is not None:
        run, observer = given
    else:
        params = {name: json.dumps(value) for name, value in (set or {}).items()}
        overrides = Overrides(source or {}, params, seed)
        run, observer = Run(load_flow(find_flow(flow), overrides), Store(Path(store))), Silent()
    observer.noted(f"flow run {prefect.runtime.flow_run.name}: {prefect.runtime.flow_run.ui_url}")
    folder = Path(out) if out else default_out(run.store, run.flow.name)
    recorder = Recorder(PrefectObserver(run.flow.name, observer))
    exports = run.execute(PrefectEngine(run.flow.name, run.store), recorder, folder)
    if given is None and recorder.problems:
        raise RuntimeError(summary_of(recorder.problems, len(run.items)))
    return {name: str(path) for name, path in exports.items()}


def _require_server() -> None:
    url = PREFECT_API_URL.value()
    if not url:
        raise InputError("--runner prefect: PREFECT_API_URL is not set; start `prefect server start` and set it")
    try:
        httpx.get(f"{url.rstrip('/')}/health", timeout=5).raise_for_status()
    except (httpx.HTTPError, httpx.InvalidURL) as error:
        reason = str(error).splitlines()[0] if str(error) else type(error).__name__
        raise InputError(
            f"--runner prefect: no Prefect server answers at PREFECT_API_URL={url} ({reason}); "
            "start one, or use --runner local"
        ) from None


def _leave_console_alone() -> None:
    """The command line prints its own lines; Prefect's go to the server alone."""
    for handler in list(logging.getLogger().handlers):
        if isinstance(handler, PrefectConsoleHandler):
            logging.getLogger().removeHandler(handler)


def _key(flow: str, step: str, what: str = "") -> str:
    """An artifact's key: small letters, digits and dashes."""
    return re.sub(r"[^a-z0-9]+", "-", f"{flow}-{step}{what}".lower())


def _publish_preview(flow: str, step: str, artifact: Artifact) -> None:
    """Show the result's picture in the UI, its image if it has one."""
    import PIL.Image

    previews = [artifact.folder / f"{output}.png" for output in ("image", *artifact.outputs)]
    path = next((path for path in previews if path.exists()), None)
    if path is not None:
        with contextlib.suppress(Exception), PIL.Image.open(path) as picture:
            _publish_picture(_key(flow, step), picture.convert("RGB"), f"{step}.{path.stem}")


def _publish_scale(flow: str, step: str, image: Image, text: str) -> None:
    import PIL.Image

    _publish_picture(_key(flow, step, "-scale"), PIL.Image.fromarray(eight_bits(image.color)), text)


def _publish_picture(key: str, picture: Any, text: str) -> None:
    picture.thumbnail((_PREVIEW_SIDE, _PREVIEW_SIDE))
    stream = io.BytesIO()
    picture.save(stream, "png")
    create_image_artifact(f"data:image/png;base64,{base64.b64encode(stream.getvalue()).decode()}", key, text)
