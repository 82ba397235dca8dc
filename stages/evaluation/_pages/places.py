"""The places of a result that a person should look at."""

import dataclasses

import numpy as np

from texloom.stages.arrays import Correspondence, Image, ScalarMap
from texloom.stages.color import lab_from_linear


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
    left = np.nan_to_num(badness, nan=0.0, posinf=float(np.finfo(np.float32).max), neginf=0.0)
    places = []
    for _ in range(count):
        row, column = (int(index) for index in np.unravel_index(left.argmax(), left.shape))
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


def source_distance(exemplar: Image, image: Image, match: Correspondence, reach: int = 4) -> ScalarMap:
    """How far the surroundings of each pixel are from those of the exemplar pixel that it comes from.

    Root mean square distance in CIELAB units over eight pixels at a distance of ``reach`` px, smoothed; large where
    pieces that do not fit together meet.
    """
    import cv2

    theirs, ours = lab_from_linear(exemplar.color), lab_from_linear(image.color)
    sources, targets = match.astype(np.int64), np.moveaxis(np.indices(match.shape[:2]), 0, 2)
    total = np.zeros(match.shape[:2], np.float32)
    known = np.zeros(match.shape[:2], np.float32)
    for step in ((-1, -1), (-1, 0), (-1, 1), (0, -1), (0, 1), (1, -1), (1, 0), (1, 1)):
        source, target = sources + reach * np.array(step), targets + reach * np.array(step)
        inside = _inside(source, theirs) & _inside(target, ours)
        source, target = source[inside], target[inside]
        total[inside] += ((theirs[source[:, 0], source[:, 1]] - ours[target[:, 0], target[:, 1]]) ** 2).sum(axis=1)
        known += inside
    side = 2 * reach + 1
    return np.sqrt(cv2.blur(total / np.maximum(known, 1), (side, side)))


def _inside(places: np.ndarray, pixels: np.ndarray) -> np.ndarray:
    return np.asarray(((places >= 0) & (places < pixels.shape[:2])).all(axis=-1))
