"""Short lines along a field of Jacobians, to look at."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float64

from texloom.stages.vocabulary.arrays import Jacobian, Mask

_POINTS = 9  # of a line
_LENGTH = 0.9  # of a line, as a share of the distance between lines


def streamlets(field: Jacobian, region: Mask, across: int) -> Float64[np.ndarray, "2 lines points 2"]:
    """Lines down and across the texture through the points of a square grid inside the region, px.

    Parameters
    ----------
    across : lines along the longer side.
    """
    height, width = region.shape
    distance = max(height, width) / across
    rows, columns = (np.arange(distance / 2, side, distance) for side in region.shape)
    seeds = np.stack(np.meshgrid(rows, columns, indexing="ij"), axis=-1).reshape(-1, 2)
    seeds = seeds[region[seeds[:, 0].astype(int), seeds[:, 1].astype(int)]]
    half = _POINTS // 2
    step = _LENGTH * distance / (2 * half)
    lines = np.empty((2, len(seeds), _POINTS, 2))
    for direction in range(2):
        lines[direction, :, half] = seeds
        for sign in (-1, 1):
            for number in range(half):
                at = lines[direction, :, half + sign * number]
                row, column = np.clip(np.rint(at), 0, (height - 1, width - 1)).astype(int).T
                along = field[row, column][:, direction::2].astype(np.float64)
                length = np.linalg.norm(along, axis=1, keepdims=True)
                lines[direction, :, half + sign * (number + 1)] = at + sign * step * along / np.maximum(
                    length, 1e-9
                )
    return lines
