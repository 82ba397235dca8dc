"""The scales of a coarse-to-fine optimisation, and the rounds at one of them."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any, TypeAlias

from texloom.stages.arrays import Image
from texloom.stages.progress import Progress, report

Rounds: TypeAlias = Iterator[tuple[float, float, float]]
"""improvements without end; after each the energy and, of it, the occurrence penalty, CIELAB units squared a pixel,
and the share of what has changed"""


@dataclass(frozen=True)
class Scale:
    """Sizes and effort at one scale."""

    level: int
    """from 1, the coarsest"""
    factor: float
    """sides by those at full size"""
    exemplar: tuple[int, int]
    """height and width, px"""
    places: tuple[int, int]
    """exemplar patches down and across"""
    target: tuple[int, int]
    """height and width of the result, px"""
    patches: tuple[int, int]
    """target patches down and across"""
    iterations: int
    """rounds at most"""

    @property
    def cost(self) -> float:
        """Work, relative to that at other scales."""
        return float(self.iterations * self.patches[0] * self.patches[1])


def improve(
    rounds: Rounds, scale: Scale, scales: Sequence[Scale], tolerance: float, preview: Callable[[], Image]
) -> dict[str, Any]:
    """Go through the rounds at one of ``scales`` and report each.

    Parameters
    ----------
    tolerance : the share of what has changed in a round after which no other is made.
    preview : makes a picture of the state so far.

    Returns
    -------
    the result's height and width, px; the rounds made; energy, occurrence penalty and changed share after the last.
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
                done=(before + scale.cost * (1 if ended else iteration / scale.iterations)) / total,
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
