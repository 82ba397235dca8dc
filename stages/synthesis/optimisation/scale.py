"""The scales of a coarse-to-fine optimisation, and the iterations at one of them."""

from collections.abc import Callable, Generator, Sequence
from contextvars import copy_context
from dataclasses import dataclass
from threading import Lock
from typing import Any, TypeAlias

from texloom.stages.kernels.core.threads import run_all, sharing
from texloom.stages.vocabulary.arrays import Image
from texloom.stages.vocabulary.progress import Progress, report

_SMALL = 2**16  # px of a result, which keep no more than one thread busy

Rounds: TypeAlias = Generator[tuple[float, float, float], None, None]
"""endless iterations; after each the energy and the occurrence penalty in it, CIELAB units squared per pixel, and
the share of changed matches"""


@dataclass(frozen=True)
class Scale:
    """Sizes and effort at one scale."""

    level: int
    """from 1, the coarsest"""
    factor: float
    """of sides, relative to full size"""
    exemplar: tuple[int, int]
    """height and width, px"""
    places: tuple[int, int]
    """exemplar patches down and across"""
    target: tuple[int, int]
    """height and width of the result, px"""
    patches: tuple[int, int]
    """target patches down and across"""
    iterations: int
    """maximum number"""

    @property
    def cost(self) -> float:
        """Relative amount of work."""
        return float(self.iterations * self.patches[0] * self.patches[1])


def improve_all(
    runs: Sequence[Rounds],
    scale: Scale,
    scales: Sequence[Scale],
    tolerance: float,
    previews: Sequence[Callable[[], Image]],
) -> list[dict[str, Any]]:
    """Iterate each of several results at one of ``scales`` and report the iterations.

    At a small scale each has a thread of its own; at others they follow one another on all threads.

    Parameters
    ----------
    tolerance : share of changed matches at which the scale ends.
    previews : return an image of the current state of each.

    Returns
    -------
    for each its height and width, px; the number of iterations; energy, occurrence penalty and changed share
    after the last.
    """
    before = sum(other.cost for other in scales[: scale.level - 1])
    total = sum(other.cost for other in scales)
    height, width = scale.target
    at_once = len(runs) if height * width <= _SMALL else 1
    chains = [_Chain(rounds, scale, tolerance) for rounds in runs]
    for first in range(0, len(runs), at_once):
        active = list(range(first, min(first + at_once, len(runs))))
        while active:
            _iterate([chains[number] for number in active])
            shown = active[0]
            active = [number for number in active if not chains[number].ended]
            done = sum(1.0 if chain.ended else chain.iteration / scale.iterations for chain in chains)
            report(
                Progress(
                    done=(before + scale.cost * done / len(runs)) / total,
                    scale=scale.level,
                    scales=len(scales),
                    iteration=chains[shown].iteration,
                    iterations=scale.iterations,
                    energy=chains[shown].outcome[0],
                    preview=previews[shown],
                )
            )
    records = []
    for chain in chains:
        energy, penalty, changed = chain.outcome
        records.append(
            {
                "height": height, "width": width, "rounds": chain.iteration,
                "energy": energy, "price": penalty, "changed": changed,
            }
        )  # fmt: skip
    return records


class _Chain:
    """The iterations of one result at a scale."""

    def __init__(self, rounds: Rounds, scale: Scale, tolerance: float):
        self.iteration = 0
        self.outcome = (0.0, 0.0, 0.0)
        self.ended = False
        self._rounds, self._scale, self._tolerance = rounds, scale, tolerance
        self._lock = Lock()

    def iterate(self) -> None:
        """The next iteration, if there is one."""
        with self._lock:
            if self.ended:
                return
            self.outcome = next(self._rounds)
            self.iteration += 1
            self.ended = self.iteration == self._scale.iterations or self.outcome[2] <= self._tolerance
            if self.ended:
                self._rounds.close()  # frees what the iterations need


def _iterate(chains: Sequence[_Chain]) -> None:
    """The next iteration of one; the next two of each of several, side by side."""
    if len(chains) == 1:
        chains[0].iterate()
        return
    # Two, since three results keep two threads busy for three turns of two iterations, but for two of one.
    run_all(lambda context, chain: context.run(_alone, chain), [(copy_context(), chain) for chain in [*chains] * 2])


def _alone(chain: _Chain) -> None:
    with sharing(1):
        chain.iterate()
