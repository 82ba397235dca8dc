"""Pixels of a distorted texture under the footprints of a result's pixels."""

import numpy as np
from jaxtyping import Float, Float32, Float64

from texloom.stages.common.geometry.jacobians import inverted
from texloom.stages.vocabulary.arrays import Mask

_PIECES = 64  # of work that threads share


def footprints(
    jacobian: Float[np.ndarray, "h w 4"], positions: Float64[np.ndarray, "n 2"], target: Float[np.ndarray, "n 4"]
) -> Float64[np.ndarray, "n 4"]:
    """Derivatives of exemplar positions by the result's pixels: the exemplar's Jacobians by the inverse of these.

    Parameters
    ----------
    jacobian : how the texture is distorted in the exemplar.
    positions : in the exemplar, px, one for each pixel of the result.
    target : how the texture is distorted at these pixels of the result.
    """
    row, column = (
        np.clip(np.rint(positions[:, axis]).astype(np.int64), 0, jacobian.shape[axis] - 1) for axis in (0, 1)
    )
    a, b, c, d = jacobian[row, column].astype(np.float64).T
    p, q, r, s = inverted(target[None].astype(np.float64))[0].T
    return np.stack([a * p + b * r, a * q + b * s, c * p + d * r, c * q + d * s], axis=1)


def resampled(
    pixels: Float32[np.ndarray, "h w c"],
    usable: Mask,
    positions: Float64[np.ndarray, "n 2"],
    feet: Float64[np.ndarray, "n 4"],
) -> Float32[np.ndarray, "n c"]:
    """Means of the exemplar's usable pixels under footprints, on all threads.

    Parameters
    ----------
    feet : see `footprints`.

    References
    ----------
    [Heckbert1989]_ elliptical weighted averages; here with Lanczos' kernel, which keeps the contrast of pixels that
    are not reduced.
    """
    from texloom.stages.kernels.core.threads import run_all, spans
    from texloom.stages.kernels.distortion.elliptical import sample_ellipses

    out = np.empty((len(positions), pixels.shape[2]), np.float32)
    pixels = np.ascontiguousarray(pixels)
    run_all(
        sample_ellipses,
        [(pixels, usable, positions[a:b], feet[a:b], out[a:b]) for a, b in spans(len(positions), _PIECES)],
    )
    return out
