"""A straight gradient across a picture."""

import math

import numpy as np

from texloom.stages.kernels.core.elementary_functions import cos, sin
from texloom.stages.vocabulary.arrays import ScalarMap
from texloom.stages.vocabulary.facts import Wraps


def linear_gradient(size: tuple[int, int], angle: float, wraps: Wraps, margin: float = 0.0) -> ScalarMap:
    """From 0 to 1 across a picture; along axes that wrap from the middle to both borders.

    Parameters
    ----------
    angle : direction in which it grows, degrees from along a row towards growing rows.
    margin : share of the length at either end where it stays at 0 and 1.
    """
    down, across = float(sin(math.radians(angle))), float(cos(math.radians(angle)))
    rows, columns = (
        2 * np.abs(place) - 0.5 if back else place
        for place, back in zip(((np.arange(side) + 0.5) / side - 0.5 for side in size), wraps, strict=True)
    )
    along = (rows[:, None] * size[0] * down + columns * size[1] * across) / (
        abs(size[0] * down) + abs(size[1] * across)
    )
    return np.clip((along + 0.5 - margin) / (1 - 2 * margin), 0, 1).astype(np.float32)
