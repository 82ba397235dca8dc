"""The scales of a coarse-to-fine optimisation, and the iterations at one of them."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any, TypeAlias

from texloom.stages.arrays import Image
from texloom.stages.progress import Progress, report

Rounds: TypeAlias = Iterator[tuple[float, float, float]]
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
    rounds: Rounds,
    scale: Scale,
    scales: Sequence[Scale],
    tolerance: float,
    preview: Callable[[], Image],
    trial: tuple[int, int] = (0, 1),
) -> dict[str, Any]:
    """Iterate at one of ``scales`` and report each iteration.

    Parameters
    ----------
    tolerance : share of changed matches at which the scale ends.
    preview : returns an image of the current state.
    trial : number of this run at the scale, from 0, and how many there are.

    Returns
    -------
    the result's height and width, px; the number of iterations; energy, occurrence penalty and changed share after
    the last.
    """
    before = sum(other.cost for other in scales[: scale.level - 1])
    total = sum(other.cost for other in scales)
    energy, penalty, changed, iteration, ended = 0.0, 0.0, 1.0, 0, False
    while not ended:
        iteration += 1
        energy, penalty, changed = next(rounds)
        ended = iteration == scale.iterations or changed <= tolerance
        report(
            Progress(
                done=(before + scale.cost * (trial[0] + (1 if ended else iteration / scale.iterations)) / trial[1])
                / total,
                scale=scale.level,
                scales=len(scales),
                iteration=iteration,
                iterations=scale.iterations,
                energy=energy,
                preview=preview,
            )
        )
    height, width = scale.target
    return {
        "height": height, "width": width, "rounds": iteration,
        "energy": energy, "price": penalty, "changed": changed,
    }  # fmt: skip
