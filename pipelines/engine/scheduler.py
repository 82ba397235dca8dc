"""The scheduler: a run from its first step to its exports, on whatever executor its runner is.

A result that turns out to be broken is computed again, in another `texloom.pipelines.engine.attempt.Attempt`.
"""

from __future__ import annotations

import contextlib
import functools
import os
from collections import Counter
from collections.abc import Callable
from pathlib import Path

from texloom.pipelines.engine.attempt import Attempt
from texloom.pipelines.engine.events import HeldEvents, Listener, Note, RunStarted
from texloom.pipelines.engine.executors.choice import executor_of
from texloom.pipelines.engine.executors.executor import Executor
from texloom.pipelines.engine.run import Run
from texloom.pipelines.store.result_files import BrokenArtifactError
from texloom.pipelines.store.store import BrokenStoreError, Store
from texloom.stages.vocabulary.declare import InputError

MAX_RESTARTS = 5
"""how often a run is restarted because of one result that turns out to be broken"""


def execute(run: Run, listener: Listener, out: Path) -> dict[str, Path]:
    """Run what is not cached and write the exports into the folder ``out``; export name to file.

    With a Prefect server at ``PREFECT_API_URL`` this is a flow run there, whatever the runner. See `compute`.
    """
    held = HeldEvents(listener)
    held(_run_started(run))
    try:
        if os.environ.get("PREFECT_API_URL"):
            from texloom.pipelines.engine.prefect.flow_run import execute_as_flow_run

            exports = execute_as_flow_run(run, held, out)
        else:
            exports = compute(run, held, out)
    except InputError:
        raise
    except BaseException:
        held.release()
        raise
    held.release()
    return exports


def compute(
    run: Run, listener: Listener, out: Path, start: Callable[[Run], Executor] = executor_of
) -> dict[str, Path]:
    """`execute` on an executor, without a server.

    Over a set, the exports of an item go into a folder of its name. What fails there is reported to the listener
    and stops neither other items nor those steps of its own that do not depend on it.

    A task that is lost with its worker is submitted again, from the second time on when no other one is in flight;
    what is lost again and again has failed. When a result turns out to be broken, its record is removed and the run
    restarted.

    Parameters
    ----------
    start : makes the executor when the first task is submitted; by default that of the flow's runner.

    Raises
    ------
    StepFailedError : a stage raised an exception.
    InputError : a stage or source refused what it was given, or there are no workers or no server.
    BrokenStoreError : a result is broken each time that it has been computed again.
    """
    executor = functools.cache(functools.partial(start, run))
    restarts: Counter[str] = Counter()
    at_once = True
    try:
        while True:
            try:
                with run.store.used_by_run() as lease:
                    exports = Attempt(run, executor, listener, out).exports()
                    if lease.is_taken:
                        _tidy(run.store, listener)
                at_once = False
                return exports
            except BrokenArtifactError as error:
                restarts[error.key] += 1
                if restarts[error.key] > MAX_RESTARTS:
                    raise BrokenStoreError(
                        f"{error}, again and again, though it was computed {MAX_RESTARTS} times; "
                        f"is the disk of --store {run.store.root} sound, and does no other program write there?"
                    ) from None
                listener(Note(f"{error}; computing it again"))
    finally:
        if executor.cache_info().currsize:
            executor().stop(at_once)


def _tidy(store: Store, listener: Listener) -> None:
    """Remove what killed runs have left, and keep the store within its limit."""
    from texloom.pipelines.store import housekeeping

    with contextlib.suppress(OSError):
        housekeeping.tidy(store)
        housekeeping.keep_limit(store, measure=False)
        problem = housekeeping.foreign_limit(store)
        if problem is not None:
            listener(Note(problem))


def _run_started(run: Run) -> RunStarted:
    flow = run.flow
    step, _, param = flow.params.get("size", ("",))[0].partition(".")
    size = getattr(flow.steps[step].params, param, None) if step in flow.steps else None
    return RunStarted(
        flow=flow.name,
        sources=run.source_references(),
        size=size if isinstance(size, tuple) else None,
        seeds=flow.seeds,
        store=run.store.root,
        steps=tuple(flow.steps),
        items=len(run.items),
    )
