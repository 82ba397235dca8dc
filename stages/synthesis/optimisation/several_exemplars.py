"""Several exemplars in one picture, each of which gives its share of a result."""

import dataclasses
from collections.abc import Sequence

import numpy as np
from jaxtyping import Float32, Float64, Int32

from texloom.stages.common.grids.border import Border
from texloom.stages.common.similarity.neighbourhoods import Rectangles, numbers_in
from texloom.stages.kernels.core.elementary_functions import log
from texloom.stages.synthesis.optimisation.block_sides import MIN_BLOCK
from texloom.stages.vocabulary.arrays import Mask, ScalarMap

_BLOCKS_OF_EACH = 8  # on average, so that the shares can be met
_RISE = 0.25  # of the mean distance, by which a penalty rises where an exemplar's use is e times what is wanted
_LEAST = 0.1  # of the wanted share, below which a penalty rises no faster
_MAX_PENALTY = 400.0  # CIELAB units squared


def largest_block(rectangles: Rectangles, size: Sequence[int]) -> int:
    """Largest side of a block, px, that fits into each exemplar, and of which a result of ``size`` has enough."""
    enough = int(np.sqrt(size[0] * size[1] / (_BLOCKS_OF_EACH * len(rectangles))))
    return max(MIN_BLOCK, min(enough, int(rectangles[:, 2:].min()) // 3))


@dataclasses.dataclass(frozen=True)
class SeveralExemplars:
    """Which exemplar each pixel of the picture belongs to, and how much each is to give."""

    numbers: Int32[np.ndarray, "h w"]
    """of the exemplar, from 1; 0 for pixels between them and for those that may not be copied"""
    wanted: Float64[np.ndarray, "exemplars"]
    """share of the result's pixels"""

    @classmethod
    def of(
        cls, rectangles: Rectangles, usable: Mask | None, share: ScalarMap | None, shape: Sequence[int]
    ) -> "SeveralExemplars":
        """Those in ``rectangles`` of a picture of ``shape``.

        Parameters
        ----------
        usable : pixels of the picture that may be copied; none for all.
        share : wanted use of each pixel, relative to even use, above 0; none for even use.
        """
        numbers = numbers_in(rectangles, *shape)
        if usable is not None:
            numbers[~usable] = 0
        use = np.bincount(numbers.ravel(), None if share is None else share.ravel(), len(rectangles) + 1)[1:]
        return cls(numbers, use / use.sum())

    def around(self, border: Border) -> "SeveralExemplars":
        """Those of a picture that is continued beyond its border."""
        return dataclasses.replace(self, numbers=border.around(self.numbers))

    def at(self, sides: Sequence[int], patch_size: int, places: Sequence[int]) -> "Balance":
        """The balance between patches of the picture reduced to ``sides``; all are height and width, px."""
        rows, columns = (
            (np.arange(patch_size // 2, patch_size // 2 + count) + 0.5) * whole / side
            for count, whole, side in zip(places, self.numbers.shape, sides, strict=True)
        )
        return Balance(self.numbers[np.ix_(rows.astype(int), columns.astype(int))], self.wanted)


class Turns:
    """Exemplars take turns at random, those the more often that have given less than their share."""

    def __init__(self, exemplars: SeveralExemplars):
        self.exemplars = exemplars
        self.given = np.zeros(len(exemplars.wanted))

    def take(self, area: int, rng: np.random.Generator) -> Mask:
        """The pixels of the exemplar that gives the next block, of ``area`` px."""
        missing = np.maximum(self.exemplars.wanted * (self.given.sum() + area) - self.given, 0)
        number = int(rng.choice(len(missing), p=missing / missing.sum()))
        self.given[number] += area
        return np.asarray(self.exemplars.numbers == number + 1)


class Balance:
    """A penalty for each exemplar, which rises while a result has more of it than is wanted, and falls else.

    Without it the exemplar whose patches match their neighbours best, such as the smoothest, takes over.
    """

    def __init__(self, numbers: Int32[np.ndarray, "p q"], wanted: np.ndarray):
        self.numbers = numbers
        self.wanted = wanted
        self.penalties = np.zeros(len(wanted) + 1)
        """CIELAB units squared, of pixels between exemplars and of each exemplar"""

    def adjust(self, counts: Int32[np.ndarray, "p q"], distance: float) -> None:
        """Adjust the penalties to how often each patch is a match.

        ``distance`` is how much patches differ from their matches on average, CIELAB units squared.
        """
        used = np.bincount(self.numbers.ravel(), counts.ravel(), len(self.penalties))[1:]
        excess = log(np.maximum(used / used.sum() / self.wanted, _LEAST))
        raised = self.penalties[1:] + _RISE * distance * excess
        self.penalties[1:] = np.clip(raised - raised.min(), 0, _MAX_PENALTY)

    def charge(self, penalty: Float32[np.ndarray, "p q"], unit: int) -> None:
        """Add what each patch costs to ``penalty``: whole numbers, ``unit`` parts of CIELAB units squared."""
        penalty += np.rint(self.penalties * unit).astype(np.float32)[self.numbers]
