"""The scales of a coarse-to-fine optimisation, and the iterations at one of them."""

from collections.abc import Callable, Generator, Sequence
from contextvars import copy_context
from dataclasses import dataclass
from typing import Any, TypeAlias

from texloom.stages.arrays import Image
from texloom.stages.kernels.core.threads import run_all, sharing
from texloom.stages.progress import Progress, report

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


def improve(
    rounds: Rounds, scale: Scale, scales: Sequence[Scale], tolerance: float, preview: Callable[[], Image]
) -> dict[str, Any]:
    """`improve_all` for one result."""
    return improve_all([rounds], scale, scales, tolerance, [preview])[0]


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
    records: list[dict[str, Any]] = [{}] * len(runs)
    for first in range(0, len(runs), at_once):
        active = list(range(first, min(first + at_once, len(runs))))
        iteration = 0
        while active:
            iteration += 1
            outcomes = _iterated([runs[number] for number in active])
            for number, (energy, penalty, changed) in zip(active, outcomes, strict=True):
                records[number] = {
                    "height": height, "width": width, "rounds": iteration,
                    "energy": energy, "price": penalty, "changed": changed,
                }  # fmt: skip
            shown = active[0]
            for number in list(active):
                if iteration == scale.iterations or records[number]["changed"] <= tolerance:
                    active.remove(number)
                    runs[number].close()  # frees what the iterations need
            ended = min(first + at_once, len(runs)) - len(active)
            share = (ended + len(active) * iteration / scale.iterations) / len(runs)
            report(
                Progress(
                    done=(before + scale.cost * share) / total,
                    scale=scale.level,
                    scales=len(scales),
                    iteration=iteration,
                    iterations=scale.iterations,
                    energy=records[shown]["energy"],
                    preview=previews[shown],
                )
            )
    return records


def _iterated(runs: Sequence[Rounds]) -> list[tuple[float, float, float]]:
    """The next iteration of each, side by side."""
    if len(runs) == 1:
        return [next(runs[0])]
    return run_all(lambda context, rounds: context.run(_alone, rounds), [(copy_context(), one) for one in runs])


def _alone(rounds: Rounds) -> tuple[float, float, float]:
    with sharing(1):
        return next(rounds)
