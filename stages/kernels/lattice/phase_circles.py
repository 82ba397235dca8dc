"""Positions in the cells of a lattice as points on circles."""

import numpy as np

from texloom.stages.kernels.core.compiled import compiled, inner
from texloom.stages.kernels.core.elementary_functions import COS, QUARTER_PI, SIN


@compiled
def fill_circles(rows, columns, cells, origin, points):
    """Fill ``points`` with the cosines and then the sines of an angle for each generator, whole turns a cell.

    Parameters
    ----------
    rows, columns : (h,), (w,) float64, px.
    cells : (2, k) float64, cells of each generator per px down and across.
    origin : (k,) float64, cells at pixel (0, 0).
    points : (h, w, 2 * k) float32, output.
    """
    count = origin.size
    for y in range(rows.size):
        for x in range(columns.size):
            for k in range(count):
                angle = 2 * np.pi * (rows[y] * cells[0, k] + columns[x] * cells[1, k] + origin[k])
                sine, cosine = _sin_cos(angle)
                points[y, x, k], points[y, x, count + k] = np.float32(cosine), np.float32(sine)


@inner
def _sin_cos(x):
    """As `texloom.stages.kernels.core.elementary_functions.phasor` has them, to the last bit."""
    eighths = np.floor(abs(x) * 1.2732395447351628)
    eighths += eighths - 2 * np.floor(eighths / 2)
    rest = ((abs(x) - eighths * QUARTER_PI[0]) - eighths * QUARTER_PI[1]) - eighths * QUARTER_PI[2]
    square = rest * rest
    above, beside = SIN[0], COS[0]
    for factor in SIN[1:]:
        above = above * square + factor
    for factor in COS[1:]:
        beside = beside * square + factor
    sine = rest + rest * (square * above)
    cosine = 1 - 0.5 * square + square * square * beside
    quarter = eighths / 2 - 4 * np.floor(eighths / 8)
    if quarter % 2 == 1:
        sine, cosine = cosine, sine
    return (-sine if (quarter >= 2) != (x < 0) else sine), (-cosine if 1 <= quarter <= 2 else cosine)
