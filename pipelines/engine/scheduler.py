"""The scheduler: a run from its first step to its exports, here or as a flow run of a Prefect server."""

from __future__ import annotations

import os
from pathlib import Path

from texloom.pipelines.engine.attempt import compute
from texloom.pipelines.engine.events import HeldEvents, Listener, RunStarted
from texloom.pipelines.engine.run import Run
from texloom.stages.vocabulary.declare import InputError


def execute(run: Run, listener: Listener, out: Path) -> dict[str, Path]:
    """Run what is not cached and write the exports into the folder ``out``; export name to file.

    With a Prefect server at ``PREFECT_API_URL`` this is a flow run there, whatever the runner. See
    `texloom.pipelines.engine.attempt.compute`.
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
