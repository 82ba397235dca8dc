"""How many workers share a machine: as many as its cores and its memory allow.

A step on one thread wastes nothing, so that small items are computed side by side on one thread each. Of large ones
fewer fit into the memory; these share the cores.
"""

from __future__ import annotations

from texloom.pipelines.engine.footprint import pixels_of_steps
from texloom.pipelines.engine.run import Run
from texloom.pipelines.memory import memory_limit
from texloom.stages.kernels.core.threads import thread_count

_WORKER = 300 * 10**6  # bytes: libraries and kernels
_PIXEL = 300  # bytes of a result's pixel, while a step computes it


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
