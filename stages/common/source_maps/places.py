"""The places of a result that a person should look at."""

import dataclasses

import numpy as np

from texloom.stages.vocabulary.arrays import ScalarMap
from texloom.stages.vocabulary.scratch import bands, empty


@dataclasses.dataclass(frozen=True)
class Place:
    """A pixel of a result, and how bad its neighbourhood is."""

    row: int
    column: int
    value: float


def worst_places(badness: ScalarMap, count: int, separation: int) -> list[Place]:
    """The largest positive values, in falling order, more than ``separation`` px apart.

    Parameters
    ----------
    badness : larger is worse; NaN where unknown. Where neighbours have the same value, the middle of them is taken.
    """
    left = empty(badness.shape, np.float32)
    for band in bands(len(left), badness, left):
        left[band] = np.nan_to_num(badness[band], nan=0.0, posinf=float(np.finfo(np.float32).max), neginf=0.0)
    places = []
    for _ in range(count):
        row = int(np.concatenate([left[band].max(axis=1) for band in bands(len(left), left)]).argmax())
        column = int(left[row].argmax())
        if left[row, column] <= 0:
            break
        near = (
            slice(max(0, row - separation), row + separation + 1),
            slice(max(0, column - separation), column + separation + 1),
        )
        same = np.argwhere(left[near] == left[row, column]).mean(axis=0)
        middle = round(near[0].start + same[0]), round(near[1].start + same[1])
        places.append(Place(*middle, float(left[row, column])))
        left[near] = 0
    return places
