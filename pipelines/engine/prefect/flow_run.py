"""Engines: who runs a flow's steps. All keep the same records, so what one has computed the others find cached.

`LocalEngine` needs no server: Prefect's transactions, records and locks in this process. `PrefectEngine` makes
every step a task of a Prefect flow run, with progress and pictures for the UI. `TaskWorkers` hands steps to the
workers of Prefect's task runners, without a server.
"""

from __future__ import annotations

import base64
import contextlib
import contextvars
import dataclasses
import functools
import io
import json
import logging
import multiprocessing
import multiprocessing.connection
import os
import re
import signal
import threading
import time
from collections.abc import Callable, Iterator
from concurrent.futures.process import BrokenProcessPool
from pathlib import Path
from typing import Any

import httpx

from texloom.pipelines.engine import worker
from texloom.pipelines.engine.events import Observer, Recorder, Silent, StepReport, describe_progress, summary_of
from texloom.pipelines.engine.keys import KeyParts
from texloom.pipelines.engine.prefect import records
from texloom.pipelines.engine.run import Run
from texloom.pipelines.engine.task import Order
from texloom.pipelines.engine.worker import Outcome
from texloom.pipelines.flow.loader import find_flow, load_flow
from texloom.pipelines.flow.model import Each, Overrides, Step
from texloom.pipelines.flow.model import Runner as Choice
from texloom.pipelines.store.preview import eight_bits
from texloom.pipelines.store.record import record_name
from texloom.pipelines.store.store import Artifact, BrokenArtifactError, Store
from texloom.stages.arrays import Image
from texloom.stages.declare import InputError
from texloom.stages.kernels.core.threads import thread_count
from texloom.stages.progress import Listener, Progress

# after records, which says that nothing is to be sent anywhere
import prefect  # isort: skip
from prefect.logging.handlers import PrefectConsoleHandler  # isort: skip
from prefect.artifacts import create_image_artifact, create_progress_artifact, update_progress_artifact  # isort: skip
from prefect.cache_policies import NO_CACHE  # isort: skip
from prefect.events.clients import NullEventsClient  # isort: skip
from prefect.events.worker import EventsWorker  # isort: skip
from prefect.settings import (  # isort: skip
    PREFECT_API_URL,
    PREFECT_CLIENT_SERVER_VERSION_CHECK_ENABLED,
    PREFECT_FLOWS_HEARTBEAT_FREQUENCY,
    PREFECT_LOGGING_TO_API_ENABLED,
    temporary_settings,
)
from prefect.task_runners import ProcessPoolTaskRunner, ThreadPoolTaskRunner  # isort: skip
from prefect.transactions import IsolationLevel, transaction  # isort: skip

_PREVIEW_SIDE = 512  # px of pictures in the UI
_SECONDS = 2.0  # between two reports to the server
_NO_SERVER = {
    PREFECT_API_URL: "http://no-server.invalid/api",  # or Prefect would start one; nothing is asked of it
    PREFECT_LOGGING_TO_API_ENABLED: False,
    PREFECT_CLIENT_SERVER_VERSION_CHECK_ENABLED: False,
}
_QUIET = {"PREFECT_LOGGING_LEVEL": "CRITICAL", "PREFECT_LOGGING_ROOT_LEVEL": "CRITICAL"}
_DASK_SECONDS = 10.0  # to wait for a scheduler, and for its first worker
_listeners: dict[str, Listener] = {}  # by key, of steps that threads of this process compute
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
        """See `texloom.pipelines.engine.run.Engine`."""
        return self.keep(name, parts, work)

    def keep(self, name: str, parts: KeyParts, work: Callable[[], Artifact]) -> Artifact:
        """The artifact of a key, from the store or from ``work``, which nobody else is at then."""
        key = record_name(parts.stage, parts.key)
        broken = None
        with transaction(key=key, store=self.records, isolation_level=IsolationLevel.SERIALIZABLE) as current:
            if current.is_committed():
                try:
                    artifact = self.store.check_record(_content(current.read()), parts.stage, parts.key)
                except BrokenArtifactError as error:  # not raised here, or the transaction would keep its lock
                    self.store.forget(parts.stage, parts.key)
                    broken = _broken(name, parts, error)
            else:
                artifact = work()
                current.stage(artifact.record)
        if broken is not None:
            raise broken
        if not current.is_committed():
            raise OSError(f"the record of {name} could not be written to {self.store.records}")
        return artifact


class PrefectEngine:
    """Every step a task of the flow run that is at work."""

    shows_cached = True

    def __init__(self, flow: str, store: Store):
        self.flow = flow
        self.store = store
        self.locks = records.FileLocks(store)
        self.states: dict[str, Any] = {}

    def ensure(
        self, step: Step, name: str, parts: KeyParts, upstream: list[str], work: Callable[[], Artifact]
    ) -> Artifact:
        """See `texloom.pipelines.engine.run.Engine`."""

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
            result_serializer=records.ArtifactSerializer(),
            persist_result=True,
            cache_result_in_memory=False,
        )(compute)
        # set here, as a task takes only blocks that a server knows; a mere path would be read by Prefect itself
        task.result_storage = records.folder(self.store)
        state = task(
            record_name(parts.stage, parts.key),
            return_state=True,
            wait_for=[self.states[other] for other in upstream if other in self.states],
        )
        self.states[name] = state
        record = state.result()
        try:
            return self.store.check_record(record, parts.stage, parts.key)
        except BrokenArtifactError as error:
            self.store.forget(parts.stage, parts.key)
            raise _broken(name, parts, error) from None


def _content(found: Any) -> Any:
    """What a record of Prefect's says."""
    return None if found is None else found.result


def _broken(name: str, parts: KeyParts, error: BrokenArtifactError) -> BrokenArtifactError:
    return BrokenArtifactError(f"{name}: the stored result is broken ({error})", parts.key)


class PrefectObserver:
    """Passes on what it is told, and tells the server."""

    def __init__(self, flow: str, observer: Observer):
        self.flow = flow
        self.observer = observer
        self.artifact: Any = None
        self.last = 0.0
        self.scale = -1

    def started(self, step: str) -> None:
        """See `texloom.pipelines.engine.events.Observer`."""
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
        """See `texloom.pipelines.engine.events.Observer`."""
        self.observer.finished(report)

    def finished_item(self, item: str, number: int, count: int, problem: str | None) -> None:
        """See `texloom.pipelines.engine.events.Observer`."""
        if problem is not None:
            with contextlib.suppress(Exception):
                prefect.get_run_logger().error(f"{item} failed: {problem}")
        self.observer.finished_item(item, number, count, problem)

    def noted(self, text: str) -> None:
        """See `texloom.pipelines.engine.events.Observer`."""
        with contextlib.suppress(Exception):
            prefect.get_run_logger().warning(text)
        self.observer.noted(text)


class TaskWorkers:
    """`texloom.pipelines.engine.scheduler.Workers` of one of Prefect's task runners. Nothing is asked of a server.

    Several steps may be computed at a time by threads of this process, by processes of this machine, or by a Dask
    cluster, whose machines must see the store under the same path.
    """

    def __init__(self, choice: Choice, store: Store):
        """Nobody is called yet."""
        self.choice = choice
        self.store = store
        self.workers = choice.workers or _usual_workers()
        self.runner: Any = None
        self.broken = False
        self.hosts: dict[str, int] = {}
        """machine to how many steps share it, of a cluster at an address"""
        self.stack = contextlib.ExitStack()
        self.children: set[int] = set()

    def slots(self) -> int:
        """See `texloom.pipelines.engine.scheduler.Workers`."""
        if self.choice.address is None:
            return self.workers
        self._start()
        return max(1, sum(map(int, self.runner.client.nthreads().values())))

    def submit(
        self,
        order: Order,
        threads: int,
        heard: Callable[[Progress], None],
        done: Callable[[Outcome], None],
    ) -> None:
        """See `texloom.pipelines.engine.scheduler.Workers`."""
        if self.broken:
            self._leave()
        self._start()
        task = worker.Task(order.to_json(), str(self.store.root), self.store.identity(), self.hosts or threads)
        if self.choice.name == "threads":
            _listeners[order.parts.key] = heard
        named = _carry.with_options(name=order.step, task_run_name=order.label, result_storage=self.store.records)
        future = self.runner.submit(named, {"key": order.parts.key, "task": dataclasses.asdict(task)})
        future.add_done_callback(lambda future: done(self._outcome(future, order)))

    def stop(self, at_once: bool) -> None:
        """See `texloom.pipelines.engine.scheduler.Workers`."""
        if at_once and self.runner is not None:
            for key in list(_listeners):
                _listeners[key] = _give_up
            for child in multiprocessing.active_children():
                if child.pid not in self.children and self.choice.name == "processes":
                    child.kill()
        self._leave()

    def _outcome(self, future: Any, order: Order) -> Outcome:
        _listeners.pop(order.parts.key, None)
        try:
            return Outcome(**future.result())
        except BrokenProcessPool:
            self.broken = True
            return Outcome("lost", problem="its worker was killed")
        except BaseException as error:
            if type(error).__name__ == "KilledWorker":
                return Outcome("failed", problem="its workers were killed, one after the other")
            return Outcome("failed", problem=repr(error))

    def _start(self) -> None:
        if self.runner is not None:
            return
        self.children = {child.pid or 0 for child in multiprocessing.active_children()}
        stack = self.stack
        stack.enter_context(temporary_settings(_NO_SERVER))
        stack.enter_context(_environment(_QUIET))
        stack.enter_context(_without_server())
        _leave_console_alone()
        runner: Any
        if self.choice.name == "threads":
            runner = ThreadPoolTaskRunner(max_workers=self.workers)
        elif self.choice.name == "processes":
            runner = ProcessPoolTaskRunner(max_workers=self.workers, initializer=_settle_in)
        else:
            runner = self._dask()
        self.runner = stack.enter_context(runner)
        if self.choice.name == "dask":
            try:
                self._greet()
            except BaseException:
                self._leave()
                raise

    def _leave(self) -> None:
        self.runner, self.broken = None, False
        self.stack.close()

    def _dask(self) -> Any:
        from prefect_dask.task_runners import DaskTaskRunner

        if self.choice.address is not None:
            return DaskTaskRunner(address=self.choice.address, client_kwargs={"timeout": _DASK_SECONDS})
        return DaskTaskRunner(
            cluster_kwargs={
                "n_workers": self.workers,
                "threads_per_worker": 1,
                "dashboard_address": None,
                "silence_logs": logging.CRITICAL,
            }
        )

    def _greet(self) -> None:
        """Prepare the workers of a cluster; look whether those at an address can work for this run."""
        from distributed import WorkerPlugin

        class WithoutServer(WorkerPlugin):  # type: ignore[misc]
            name = f"texloom-{os.getpid()}"

            def setup(self, worker: Any) -> None:  # noqa: ARG002
                EventsWorker.set_client_override(NullEventsClient)

            def teardown(self, worker: Any) -> None:  # noqa: ARG002
                EventsWorker.set_client_override(None)

        where = f"--runner dask: {self.choice.address or 'a cluster on this machine'}"
        try:
            client = self.runner.client
            client.wait_for_workers(1, timeout=_DASK_SECONDS)
        except OSError as error:
            reason = str(error).splitlines()[0] if str(error) else type(error).__name__
            raise InputError(f"{where}: no scheduler with workers answers ({reason})") from None
        if self.choice.address is None:
            client.register_plugin(WithoutServer())
            return
        with self.store.lock(worker.PROBE):
            look = functools.partial(
                worker.look_around, str(self.store.root), self.store.identity(), worker.program_version()
            )
            places = client.run(look, on_error="return")
        for address, place in places.items():
            problem = f"{place!r}" if isinstance(place, BaseException) else place.problem
            if problem:
                host = address if isinstance(place, BaseException) else f"{address} ({place.host})"
                raise InputError(f"{where}: worker {host}: {problem}")
        client.register_plugin(WithoutServer())
        self.stack.callback(client.unregister_worker_plugin, WithoutServer.name)
        for address, threads in client.nthreads().items():
            host = places[address].host if address in places else ""
            self.hosts[host] = self.hosts.get(host, 0) + threads


@prefect.task(name="step", persist_result=False, cache_policy=NO_CACHE, retries=0)
def _carry(key: str, task: dict[str, Any]) -> dict[str, Any]:
    """What a worker runs; plain data in and out."""

    def ensure(store: Store) -> worker.Ensure:
        return LocalEngine(store).keep

    # In a context of its own, as a transaction inside the task's would wait for that one to be committed.
    outcome = contextvars.Context().run(worker.carry_out, worker.Task(**task), ensure, _listeners.get(key))
    return dataclasses.asdict(outcome)


def _give_up(_: Progress) -> None:
    raise KeyboardInterrupt


def _usual_workers() -> int:
    """Half of the processors, and the other half for the threads of the steps; both where there are but two."""
    threads = thread_count()
    return max(min(threads, 2), threads // 2)


def _settle_in() -> None:
    """Begin as a process that computes steps: end with the one that started it, however that ends."""
    EventsWorker.set_client_override(NullEventsClient)
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # the run hears it too, and decides
    parent = multiprocessing.parent_process()

    def follow() -> None:
        if parent is not None:
            multiprocessing.connection.wait([parent.sentinel])
            os._exit(1)

    threading.Thread(target=follow, daemon=True).start()


@contextlib.contextmanager
def _without_server() -> Iterator[None]:
    """Keep Prefect from sending events about task runs."""
    EventsWorker.set_client_override(NullEventsClient)
    try:
        yield
    finally:
        EventsWorker.set_client_override(None)


@contextlib.contextmanager
def _environment(variables: dict[str, str]) -> Iterator[None]:
    """Set environment variables for the processes that are started meanwhile."""
    before = {name: os.environ.get(name) for name in variables}
    os.environ.update(variables)
    try:
        yield
    finally:
        for name, value in before.items():
            os.environ.pop(name, None)
            if value is not None:
                os.environ[name] = value


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
    folder = Path(out) if out else run.default_out()
    if given is None:
        run.check_out(folder)
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
