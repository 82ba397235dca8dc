"""The screened Poisson equation on a rectangle or torus."""

import numpy as np
from jaxtyping import Float32


def screened_poisson(excess: Float32[np.ndarray, "H W"], reach: float, wrap: bool) -> Float32[np.ndarray, "H W"]:
    """The plane c with (1 / reach^2 - Laplacian) c = -``excess``; its gradient is 0 at borders unless it wraps.

    [Bhat2008]_, by Fourier transforms, or cosine transforms unless it wraps.

    Parameters
    ----------
    excess : divergence of the gradients that are to be added, outflow minus inflow.
    reach : distance over which values are changed, px.
    """
    from scipy import fft

    down, across = (2 - 2 * np.cos(np.pi * np.arange(side) * (1 + wrap) / side) for side in excess.shape)
    if wrap:
        across = across[: excess.shape[1] // 2 + 1]
    spectrum = fft.rfft2(excess) if wrap else fft.dctn(excess, type=2)
    for row, frequency in enumerate(down):  # in place, for large results
        spectrum[row] /= -(reach**-2 + frequency + across).astype(np.float32)
    solution = fft.irfft2(spectrum, s=excess.shape) if wrap else fft.idctn(spectrum, type=2)
    return np.asarray(solution, np.float32)
