"""The spectrum of a template's squared differences from all places of an exemplar."""

import numpy as np

from texloom.stages.kernels.core.compiled import compiled

_TWICE = np.float32(2)


@compiled
def template_spectrum(template, exemplar, first, last):
    """Sum the products of conjugates of a template's spectra with an exemplar's, rows first..last.

    Parameters
    ----------
    template : (c + 1, h, 2 w) float32, real and imaginary part in turn: of its channels, then of where it is
        compared; this becomes the sum
    exemplar : the same of its channels, then of the sum of their squares; channels count -2 times
    """
    channels = template.shape[0] - 1
    for y in range(first, last):
        for x in range(0, template.shape[2], 2):
            a, b = template[channels, y, x], template[channels, y, x + 1]
            c, d = exemplar[channels, y, x], exemplar[channels, y, x + 1]
            real, imaginary = a * c + b * d, a * d - b * c
            for channel in range(channels):
                a, b = template[channel, y, x], template[channel, y, x + 1]
                c, d = exemplar[channel, y, x], exemplar[channel, y, x + 1]
                real -= _TWICE * (a * c + b * d)
                imaginary -= _TWICE * (a * d - b * c)
            template[channels, y, x], template[channels, y, x + 1] = real, imaginary
