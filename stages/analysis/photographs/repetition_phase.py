"""The phase of a repeating texture."""

import numpy as np
from jaxtyping import Float64

from texloom.stages.analysis.regularity.lattice import valid_lightness
from texloom.stages.kernels.core.elementary_functions import complex_product
from texloom.stages.numerics.filters import gaussian_blur
from texloom.stages.numerics.matrices import inverse_of, matrix_product
from texloom.stages.vocabulary.arrays import Image
from texloom.stages.vocabulary.masks import valid_pixels

_BINS = 32  # of a repetition along each generator


def mean_repetition(image: Image, generators: Float64[np.ndarray, "2 2"]) -> Float64[np.ndarray, "m m"]:
    """Mean lightness in each bin of a repetition, relative to the mean of all."""

    valid = valid_pixels(image)
    shown = np.ones((image.height, image.width), bool) if valid is None else valid
    cycles = matrix_product(np.argwhere(shown), inverse_of(generators))
    row, column = (np.floor(cycles * _BINS).astype(np.int64) % _BINS).T
    lightness = valid_lightness(image)[shown].astype(np.float64)
    sums, counts = (
        np.bincount(row * _BINS + column, weights, _BINS**2).reshape(_BINS, _BINS)
        for weights in (lightness - lightness.mean(), np.ones_like(lightness))
    )
    wrapped = (np.pad(plane, _BINS, mode="wrap") for plane in (sums, counts))
    sums, counts = (gaussian_blur(plane, 1.0)[_BINS:-_BINS, _BINS:-_BINS] for plane in wrapped)
    return np.asarray(sums / np.maximum(counts, 1e-9))


def phase_offset(one: Float64[np.ndarray, "m m"], other: Float64[np.ndarray, "m m"]) -> Float64[np.ndarray, "2"]:
    """The offset in cycles at which a repetition is most like another: ``one`` there is ``other`` here plus it."""
    correlation = np.fft.irfft2(complex_product(np.conj(np.fft.rfft2(one)), np.fft.rfft2(other)), s=one.shape)
    return np.array(np.unravel_index(np.argmax(correlation), one.shape)) / _BINS
