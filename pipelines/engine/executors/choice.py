"""Which executor a runner is."""

from __future__ import annotations

from collections.abc import Callable, Mapping

from texloom.pipelines.engine.executors.executor import Executor
from texloom.pipelines.engine.run import Run
from texloom.stages.kernels.core.threads import thread_count


def _inline(run: Run) -> Executor:
    from texloom.pipelines.engine.executors.inline import InlineExecutor

    if run.items or thread_count() == 1:  # items follow one another, each with all that there is
        return InlineExecutor(run.store)
    return InlineExecutor(run.store, min(2, _workers(run)))


def _threads(run: Run) -> Executor:
    from texloom.pipelines.engine.executors.inline import InlineExecutor

    return InlineExecutor(run.store, _workers(run), on_threads=True)


def _processes(run: Run) -> Executor:
    from texloom.pipelines.engine.executors.processes import ProcessExecutor

    return ProcessExecutor(run.store, _workers(run))


def _dask(run: Run) -> Executor:
    from texloom.pipelines.engine.executors.dask_cluster import DaskExecutor

    return DaskExecutor(run, _workers(run))


def _workers(run: Run) -> int:
    from texloom.pipelines.engine.executors.worker_count import worker_count

    return run.flow.runner.workers or worker_count(run)


_EXECUTORS: Mapping[str, Callable[[Run], Executor]] = {
    "local": _inline, "threads": _threads, "processes": _processes, "dask": _dask,
}  # fmt: skip


def executor_of(run: Run) -> Executor:
    """The executor of the flow's runner; its workers are not started yet."""
    return _EXECUTORS[run.flow.runner.name](run)
