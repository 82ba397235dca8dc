"""The screened Poisson equation on a rectangle, cylinder or torus."""

from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
from jaxtyping import Float32

from texloom.stages.kernels.core.elementary_functions import cos
from texloom.stages.kernels.core.loading import loaded
from texloom.stages.vocabulary.arrays import Mask
from texloom.stages.vocabulary.facts import Wraps

_ROWS = 256  # of a result processed at once
_TOLERANCE = 1e-4  # norm of the residual at which the solver ends, relative to the right-hand side


def screened_poisson(excess: Float32[np.ndarray, "H W"], reach: float, wrap: Wraps) -> Float32[np.ndarray, "H W"]:
    """The plane c with (1 / reach^2 - Laplacian) c = -``excess``; its gradient is 0 at borders that do not wrap.

    [Bhat2008]_, by Fourier transforms along axes that wrap, and cosine transforms along others.

    Parameters
    ----------
    excess : divergence of the gradients that are to be added, outflow minus inflow.
    reach : distance over which values are changed, px.
    """
    return divided_by_frequency(excess, wrap, lambda squared: -(reach**-2 + squared))


def divided_by_frequency(
    plane: Float32[np.ndarray, "H W"], wrap: Wraps, divisor: Callable[[np.ndarray], np.ndarray]
) -> Float32[np.ndarray, "H W"]:
    """``plane`` with each of its waves divided by a function of its squared frequency, (radians / px)^2.

    The waves are those of Fourier transforms along axes that wrap, and of cosine transforms along others. Squared
    frequencies are the eigenvalues of the negative Laplacian of neighbouring pixels, 0 for the mean.
    """
    fft = loaded("scipy.fft")
    down, across = (
        2 - 2 * cos(np.pi * np.arange(side) * (1 + around) / side)
        for side, around in zip(plane.shape, wrap, strict=True)
    )
    around = 1 if wrap.across else 0  # of one axis that wraps; a real transform has half of its frequencies
    if wrap.both:
        spectrum = fft.rfft2(plane)
    elif wrap:
        spectrum = fft.rfft(fft.dct(plane, type=2, axis=1 - around), axis=around)
    else:
        spectrum = fft.dctn(plane, type=2)
    across = across[: spectrum.shape[1]]
    for row, frequency in enumerate(down[: len(spectrum)]):  # in place, for large results
        spectrum[row] /= divisor(frequency + across).astype(np.float32)
    if wrap.both:
        solution = fft.irfft2(spectrum, s=plane.shape)
    elif wrap:
        solution = fft.idct(fft.irfft(spectrum, plane.shape[around], axis=around), type=2, axis=1 - around)
    else:
        solution = fft.idctn(spectrum, type=2)
    return np.asarray(solution, np.float32)


def neighbours(height: int, axis: int, wrap: Wraps) -> Iterator[tuple[Any, Any]]:
    """Indices of pixels and of their neighbours below or to the right, some rows at a time."""
    for top in range(0, height, _ROWS):
        bottom = min(top + _ROWS, height)
        if axis == 1:
            rows = slice(top, bottom)
            yield (rows, slice(None, -1)), (rows, slice(1, None))
            if wrap.across:
                yield (rows, slice(-1, None)), (rows, slice(0, 1))
        else:
            last = min(bottom, height - 1)
            yield slice(top, last), slice(top + 1, last + 1)
            if wrap.down and bottom == height:
                yield slice(-1, None), slice(0, 1)


def screened_poisson_beside(
    excess: Float32[np.ndarray, "H W"], reach: float, wrap: Wraps, unknown: Mask
) -> Float32[np.ndarray, "H W"]:
    """The solution of `screened_poisson` where ``unknown`` is true, and 0 elsewhere."""
    sparse = loaded("scipy.sparse")
    numbers = np.full(excess.shape, -1, np.int64)
    numbers[unknown] = np.arange(unknown.sum())
    diagonal = np.full(excess.shape, reach**-2)
    pairs = []
    for axis in (0, 1):
        for first, second in neighbours(excess.shape[0], axis, wrap):
            diagonal[first] += 1
            diagonal[second] += 1
            both = unknown[first] & unknown[second]
            pairs.append((numbers[first][both], numbers[second][both]))
    row, column = (np.concatenate(ends) for ends in zip(*pairs, strict=True))
    size = int(unknown.sum())
    links = sparse.coo_array((np.full(row.size, -1.0), (row, column)), (size, size)).tocsr()
    matrix = links + links.T + sparse.diags_array(diagonal[unknown])
    solution = np.zeros(excess.shape, np.float32)
    solution[unknown] = _conjugate_gradients(matrix, -excess[unknown].astype(np.float64))
    return solution


def _conjugate_gradients(matrix: Any, right: np.ndarray) -> np.ndarray:
    """Solve a symmetric, positive definite system.

    SciPy's solver uses BLAS, whose number of threads changes the last bits.
    """
    solution, residual = np.zeros_like(right), right.copy()
    direction, squared = residual.copy(), float((residual * residual).sum())
    limit = _TOLERANCE**2 * squared
    while squared > limit:
        product = matrix @ direction
        step = squared / float((direction * product).sum())
        solution += step * direction
        residual -= step * product
        before, squared = squared, float((residual * residual).sum())
        direction = residual + squared / before * direction
    return solution
