"""Gradients that an exemplar provides between neighbours of a result, by their sources."""

from collections.abc import Callable

import numpy as np
from jaxtyping import Bool, Float32

from texloom.stages.vocabulary.arrays import Mask


def source_gradients(
    own: Callable[[np.ndarray, np.ndarray], Float32[np.ndarray, "*n c"]],
    shape: tuple[int, ...],
    first: np.ndarray,
    second: np.ndarray,
    usable: Mask | None,
    axis: int,
) -> tuple[Float32[np.ndarray, "*n c"], Bool[np.ndarray, "*n"]]:
    """The exemplar's gradient between neighbours with sources ``first`` and ``second``, and where there is one.

    It is the mean of that from the first one's source to the pixel beside it, and that to the second one's source
    from the pixel before it; both are equal where the sources are neighbours.

    Parameters
    ----------
    own : values of the exemplar, whose height and width are the ``shape``, at rows and columns.
    first, second : (*n, 2) rows and columns, px.
    usable : the pixels that count; None for all.
    axis : in which they are neighbours.
    """
    total: np.ndarray | np.float32 = np.float32(0)
    count = np.zeros(first.shape[:-1], np.float32)
    for source, sign in ((first, 1), (second, -1)):
        row, column = source[..., 0].astype(np.int32), source[..., 1].astype(np.int32)
        beside = [row + sign * (axis == 0), column + sign * (axis == 1)]
        inside = (beside[axis] >= 0) & (beside[axis] < shape[axis])
        beside[axis] = np.clip(beside[axis], 0, shape[axis] - 1)
        if usable is not None:
            inside &= usable[beside[0], beside[1]] & usable[row, column]
        gradient = sign * (own(beside[0], beside[1]) - own(row, column))
        total = total + np.where(inside[..., None], gradient, np.float32(0))
        count += inside
    return np.asarray(total / np.maximum(count, 1)[..., None]), count > 0
