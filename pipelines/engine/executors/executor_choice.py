"""Which executor a runner is, and how many workers share a machine: as many as its cores and its memory allow.

A step on one thread wastes nothing, so that small items are computed side by side on one thread each. Of large ones
fewer fit into the memory; these share the cores.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping

from texloom.pipelines.engine.executors.executor import Executor
from texloom.pipelines.engine.footprint import pixels_of_steps
from texloom.pipelines.engine.run import Run
from texloom.pipelines.memory import memory_limit
from texloom.stages.common.grids.working_size import reduction
from texloom.stages.kernels.core.threads import thread_count

_WORKER = 300 * 10**6  # bytes: libraries and kernels
_PIXEL = 300  # bytes of a result's pixel, while a step computes it


def _inline(run: Run) -> Executor:
    from texloom.pipelines.engine.executors.inline import InlineExecutor

    # Items follow one another, each with all that there is; so do the steps of a large picture.
    if run.items or thread_count() == 1 or _takes_large(run):
        return InlineExecutor(run.store)
    return InlineExecutor(run.store, min(2, _workers(run)))


def _takes_large(run: Run) -> bool:
    """Whether a source is analysed at reduced size, as steps take much memory, unless the user wants more."""
    sources = [source for scope in run.sample_scopes() for source in scope.sources.values()]
    large = any(reduction(source.height, source.width) > 1 for source in sources if source.kind == "picture")
    return large and not run.flow.runner.workers


def _threads(run: Run) -> Executor:
    from texloom.pipelines.engine.executors.inline import InlineExecutor

    return InlineExecutor(run.store, _workers(run), on_threads=True)


def _processes(run: Run) -> Executor:
    from texloom.pipelines.engine.executors.process_executor import ProcessExecutor

    return ProcessExecutor(run.store, _workers(run))


def _dask(run: Run) -> Executor:
    from texloom.pipelines.engine.executors.dask_cluster import DaskExecutor

    return DaskExecutor(run, _workers(run))


def _workers(run: Run) -> int:
    return run.flow.runner.workers or worker_count(run)


_EXECUTORS: Mapping[str, Callable[[Run], Executor]] = {
    "local": _inline, "threads": _threads, "processes": _processes, "dask": _dask,
}  # fmt: skip


def executor_of(run: Run) -> Executor:
    """The executor of the flow's runner; its workers are not started yet."""
    return _EXECUTORS[run.flow.runner.name](run)


def worker_count(run: Run) -> int:
    """How many steps to compute at a time, by what is known of the sizes when the first one begins.

    At least a half of the cores, as the steps of an item may not depend on each other, unless the memory is less.
    """
    threads = thread_count()
    scopes = run.sample_scopes()
    sources = [source.height * source.width for scope in scopes for source in scope.sources.values()]
    pixels = max([0, *sources, *pixels_of_steps(run.flow.steps, scopes).values()])
    wanted = min(threads, max(len(run.items), threads // 2, 2))
    return max(1, min(wanted, memory_limit() // (_WORKER + _PIXEL * pixels)))
