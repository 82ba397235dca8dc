"""Corners of tiles: places of the exemplar that are shown as they are wherever tiles meet."""

import numpy as np
from jaxtyping import Bool, Int64

from texloom.stages.common.similarity.neighbourhoods import Rectangles
from texloom.stages.numerics.filters import gaussian_blur
from texloom.stages.vocabulary.arrays import Image
from texloom.stages.vocabulary.color import lab_from_linear
from texloom.stages.vocabulary.masks import count_excluded, fill_excluded, valid_pixels


def plain_places(
    image: Image, rectangles: Rectangles | None, count: int, reach: int
) -> Int64[np.ndarray, "n 2"] | None:
    """Pixels below and right of ``count`` corners, where what lies within ``reach`` px of them is least special.

    This is where its slow colours deviate least from the mean: what corners show returns in every tile. Where there
    are several exemplars, in ``rectangles``, each has a corner; in one they lie apart, where there is room.

    Returns
    -------
    None where an exemplar does not contain a square so large without masked pixels.
    """
    whole = np.array([[0, 0, image.height, image.width]])
    color, valid = fill_excluded(image).color, valid_pixels(image)
    found = np.zeros((0, 2), np.int64)
    for row, column, height, width in (whole if rectangles is None else rectangles).tolist():
        if min(height, width) < 2 * reach:
            return None
        own = np.s_[row : row + height, column : column + width]
        lab = gaussian_blur(lab_from_linear(np.ascontiguousarray(color[own])), reach / 8)
        deviation = ((lab - lab.mean(axis=(0, 1), dtype=np.float64)) ** 2).sum(axis=2)
        around = gaussian_blur(deviation, reach / 2)[reach : height - reach + 1, reach : width - reach + 1]
        if valid is not None:
            around[count_excluded(valid[own], 2 * reach, 2 * reach) > 0] = np.inf
        places = _least(around, count if rectangles is None else 1, 2 * reach)
        if places is None:
            return None
        found = np.concatenate([found, places + np.array([row + reach, column + reach])])
    return found


def _least(costs: np.ndarray, count: int, apart: int) -> Int64[np.ndarray, "n 2"] | None:
    """Places of least costs, ``apart`` px from each other where possible; None where all costs are infinite."""
    found = list[tuple[int, int]]()
    near: Bool[np.ndarray, "h w"] = np.zeros(costs.shape, bool)
    while len(found) < count:
        open_costs = np.where(near, np.inf, costs)
        if not np.isfinite(open_costs).any():
            open_costs = costs
        if not np.isfinite(open_costs).any():
            return None
        row, column = divmod(int(np.argmin(open_costs)), costs.shape[1])
        found.append((row, column))
        near[max(0, row - apart) : row + apart, max(0, column - apart) : column + apart] = True
    return np.array(found, np.int64)
