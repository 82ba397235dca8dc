"""How often an exemplar shows its structure."""

import numpy as np

from texloom.stages.arrays import ScalarMap

_BLOCKS = 4  # a side, whose means are compared
_ELEMENT = 60.0  # integral ranges of the gradient magnitude in an element, about


def periods(generators: np.ndarray, shape: tuple[int, int]) -> float:
    """Number of periods that an image of ``shape`` shows, in the direction of fewest.

    Parameters
    ----------
    generators : of a lattice, (2, 2) px, or the step between courses, (1, 2) px.
    """
    lines = np.linalg.pinv(generators.astype(np.float64))  # pixel (row, column) @ this = cells
    return float((np.array(shape) @ np.abs(lines)).min())


def elements(gradients: ScalarMap) -> float:
    """Number of elements that an image of a random texture shows, roughly, from its gradient magnitude.

    The variance of a mean over an area, compared with that of single pixels, gives the area over which pixels are
    alike, the integral range. Elements of real textures have some sixty of these.

    References
    ----------
    [Lantuejoul1991]_. The number in an element is ours, from 44 photographs; it varies by a factor of two.
    """
    height, width = (side // _BLOCKS for side in gradients.shape)
    if not height or not width:
        return 0.0
    blocks = gradients[: height * _BLOCKS, : width * _BLOCKS].reshape(_BLOCKS, height, _BLOCKS, width)
    means = blocks.mean(axis=(1, 3), dtype=np.float64)
    variance = float(means.var(ddof=1))
    if variance <= 0:
        return 0.0
    return _BLOCKS**2 * float(gradients.var(dtype=np.float64)) / variance / _ELEMENT
