"""Windows of 5x5 samples of a flat texture, as products with a basis."""

import numpy as np

from texloom.stages.kernels.core.compiled import compiled

_SIDE = 5  # samples of a window along each direction


@compiled
def project_windows(planes, step, middle, basis, out, first, last):
    """Fill rows ``first`` to ``last`` of ``out`` with the components of the window around each pixel.

    Sums have one order for all pixels and processors.

    Parameters
    ----------
    planes : (c, h + 4 step, w + 4 step) float32, two steps wider on every side than the texture
    step : int, px between samples
    middle : (8,) float32, components of the mean window, which are subtracted
    basis : (25 c, 8) float32, samples row by row, their channels side by side
    out : (h, w, 8) float32, output
    """
    width, channels = out.shape[1], planes.shape[0]
    total = np.empty((middle.size, width), np.float32)
    for y in range(first, last):
        for k in range(middle.size):
            total[k, :] = -middle[k]
        for sample in range(_SIDE * _SIDE):
            row, left = y + sample // _SIDE * step, sample % _SIDE * step
            for channel in range(channels):
                line = planes[channel, row, left : left + width]
                for k in range(middle.size):
                    factor, sums = basis[sample * channels + channel, k], total[k]
                    for x in range(width):
                        sums[x] += factor * line[x]
        for k in range(middle.size):
            for x in range(width):
                out[y, x, k] = total[k, x]
