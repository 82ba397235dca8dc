"""How far the means of a guide at all places of an exemplar are from what is wanted."""

import numpy as np

from texloom.stages.kernels.core.compiled import compiled


@compiled
def add_guide_difference(means, squares, wanted, wanted_square, unit, errors, first, last):
    """Add the mean squared difference at every place, rows first..last.

    Parameters
    ----------
    means : (k, p, q) float64, of each plane of the guide over the block at every place
    squares : (p, q) float64, of the sum of the squares of its planes
    wanted, wanted_square : (k,) float64 and float64, the same of what is wanted
    unit : difference that counts as 1
    errors : (p, q) float32, added to
    """
    for y in range(first, last):
        for x in range(errors.shape[1]):
            difference = squares[y, x] + wanted_square
            for plane in range(means.shape[0]):
                difference -= 2 * means[plane, y, x] * wanted[plane]
            errors[y, x] += np.float32(max(difference, 0.0) / unit)
