"""Densities of offsets."""

import numpy as np

from texloom.stages.numerics.filters import gaussian_blur
from texloom.stages.vocabulary.arrays import ScalarMap

_SIGMA = 3.0  # px of an exemplar of 512 px
_MIN_SIGMA = 1.7  # px


def offset_deviation(shorter: int) -> float:
    """Standard deviation of an offset in an exemplar with this shorter side, px."""
    return max(_MIN_SIGMA, _SIGMA * shorter / 512)


def smoothed(density: ScalarMap, shorter: int) -> ScalarMap:
    """A density blurred by the deviation of an offset, scaled to a maximum of 1."""

    sigma = offset_deviation(shorter)
    side = 2 * int(np.ceil(3 * sigma)) + 1
    blurred = gaussian_blur(density, sigma, "zero", side)
    return np.asarray(blurred / blurred.max())
