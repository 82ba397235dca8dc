"""Gradients that an exemplar provides between neighbours of a result, by their sources."""

import numpy as np
from jaxtyping import Bool, Float32

from texloom.stages.vocabulary.arrays import Mask, ScalarMap


def source_gradients(
    own: ScalarMap, first: np.ndarray, second: np.ndarray, usable: Mask | None, axis: int
) -> tuple[Float32[np.ndarray, "*n"], Bool[np.ndarray, "*n"]]:
    """The exemplar's gradient between neighbours with sources ``first`` and ``second``, and where there is one.

    It is the mean of that from the first one's source to the pixel beside it, and that to the second one's source
    from the pixel before it; both are equal where the sources are neighbours. Only pixels in ``usable`` count.
    """
    total = np.zeros(first.shape[:-1], np.float32)
    count = np.zeros(first.shape[:-1], np.float32)
    for source, sign in ((first, 1), (second, -1)):
        row, column = source[..., 0].astype(np.int32), source[..., 1].astype(np.int32)
        beside = [row + sign * (axis == 0), column + sign * (axis == 1)]
        inside = (beside[axis] >= 0) & (beside[axis] < own.shape[axis])
        beside[axis] = np.clip(beside[axis], 0, own.shape[axis] - 1)
        if usable is not None:
            inside &= usable[beside[0], beside[1]] & usable[row, column]
        total += np.where(inside, sign * (own[beside[0], beside[1]] - own[row, column]), np.float32(0))
        count += inside
    return total / np.maximum(count, 1), count > 0
