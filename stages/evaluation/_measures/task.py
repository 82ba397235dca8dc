"""What the measures of one result share."""

import dataclasses

import numpy as np

from texloom.stages.evaluation._measures.pictures import MeasuredPicture, UnmeasurableError
from texloom.stages.vocabulary.arrays import Correspondence, Mask
from texloom.stages.vocabulary.facts import Wraps

GIVEN = "part of the result was given, not made"

_MIN_COPIES = 0.5  # of the pixels, for an estimated source map to say more than what was copied


@dataclasses.dataclass(frozen=True)
class Task:
    """What measures read."""

    exemplar: MeasuredPicture
    result: MeasuredPicture
    shuffled: MeasuredPicture
    """the exemplar in squares of 2 px, in random order, as a bad result"""
    match: Correspondence | None
    copies: Mask | None
    """true at pixels that are copies of their sources, if ``match`` is estimated; None where it is known"""
    wraps: Wraps
    """of the result"""
    copied: float
    """area of a piece that counts as copied verbatim, as a share of the exemplar"""
    window: int
    """side of the windows whose contrast is measured, px"""

    @property
    def source_shape(self) -> tuple[int, int]:
        return self.exemplar.tone.shape[0], self.exemplar.tone.shape[1]

    @property
    def source_area(self) -> int:
        """Pixels of the exemplar that may be used."""
        valid = self.exemplar.valid
        return self.exemplar.tone.size if valid is None else int(valid.sum())

    def source_map(self) -> Correspondence:
        """`match`; `UnmeasurableError` where there is none, or few pixels are copies."""
        if self.match is None:
            raise UnmeasurableError("no source map was given")
        share = 1.0 if self.copies is None else float(self.copies.mean())
        if share < _MIN_COPIES:
            raise UnmeasurableError(f"only {share:.0%} of the pixels are copies of the exemplar's")
        return self.match

    def require_all_made(self) -> None:
        """`UnmeasurableError` where part of the result was given."""
        if self.result.made is not None:
            raise UnmeasurableError(GIVEN)


def sampling(task: Task, between_halves: float) -> float:
    """What the distance of a good result to its exemplar may be: that of two samples of the texture of their sizes.

    The difference of two samples falls with the root of their areas, and the exemplar's halves are samples too.
    """
    area = task.source_area
    return between_halves * float(np.sqrt((1 + area / task.result.tone.size) / 4))
