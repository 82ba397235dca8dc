"""A trend along a path."""

import itertools
from collections.abc import Sequence

import numpy as np

from texloom.stages.common.grids.pyramid import resize
from texloom.stages.numerics.filters import gaussian_blur
from texloom.stages.vocabulary.arrays import ScalarMap
from texloom.stages.vocabulary.facts import Wraps

_SIDE = 256  # px of the longer side, at which distances are computed
_SMOOTH = 1 / 32  # of that: deviation by which steps between parts of the path are softened


def path_trend(size: tuple[int, int], path: Sequence[tuple[float, float]], wraps: Wraps) -> ScalarMap:
    """How far along a path each place's nearest point is, from 0 at its begin to 1 at its end.

    Parameters
    ----------
    path : its corners, (row, column), as shares of the sides; some may lie outside.
    wraps : axes across whose borders the path's copies are as near.
    """
    scale = min(1.0, _SIDE / max(size))
    height, width = (max(2, round(side * scale)) for side in size)
    rows, columns = (np.arange(height) + 0.5)[:, None], (np.arange(width) + 0.5)[None]
    corners = np.array(path, np.float64) * (height, width)
    steps = np.diff(corners, axis=0)
    lengths = np.hypot(*steps.T)
    begins = np.concatenate([[0.0], np.cumsum(lengths)])
    nearest, found = np.full((height, width), np.inf), np.zeros((height, width))
    copies = [(-1, 0, 1) if back else (0,) for back in wraps]
    for number in np.flatnonzero(lengths > 0):
        (down, across), length = steps[number] / lengths[number], lengths[number]
        for move in itertools.product(*copies):
            first = corners[number] + np.multiply(move, (height, width))
            y, x = rows - first[0], columns - first[1]
            along = np.clip(y * down + x * across, 0, length)
            away = np.square(y - along * down) + np.square(x - along * across)
            is_nearer = away < nearest
            nearest = np.where(is_nearer, away, nearest)
            found = np.where(is_nearer, begins[number] + along, found)
    shares = (found / begins[-1]).astype(np.float32)
    sigma = _SMOOTH * max(height, width)
    reach = 4 * round(sigma)
    around = [(min(reach, side) if back else 0,) * 2 for side, back in zip((height, width), wraps, strict=True)]
    smooth = gaussian_blur(np.pad(shares, around, mode="wrap"), sigma)
    smooth = smooth[around[0][0] : around[0][0] + height, around[1][0] : around[1][0] + width]
    return np.asarray(resize(np.ascontiguousarray(smooth)[..., None], *size, bilinear=True)[..., 0])
