"""A grid of triangles on the plane: which three hexagonal tiles meet at a point, and what each of them shows."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float32, Int64

from texloom.stages.common.grids.wang import hashed

SHARE = 1 / (2 * 3**0.5)
"""distance of two neighbouring tiles as a share of the texture's shorter side, see [DeliotHeitz2019]_"""

_DOWN = np.float32(2 / 3**0.5)
_ACROSS = np.float32(1 / 3**0.5)


def tiles_at(
    rows: Float32[np.ndarray, "*points"], columns: Float32[np.ndarray, "*points"], spacing: float
) -> tuple[Int64[np.ndarray, "3 2 *points"], Float32[np.ndarray, "3 *points"]]:
    """The tiles that cover points of the plane, and their weights.

    Parameters
    ----------
    rows, columns : px; whole numbers are centres of pixels.
    spacing : between the centres of neighbouring tiles, px.

    Returns
    -------
    number of each of the three tiles along the two axes of the grid, and barycentric weights, which add up to 1.

    References
    ----------
    [HeitzNeyret2018]_ section 3, [DeliotHeitz2019]_ listing 1.2: the grid of simplex noise.

    Examples
    --------
    >>> import numpy as np
    >>> origin = np.zeros(1, np.float32)
    >>> tiles_at(origin, origin, 64.0)[1].ravel()
    array([1., 0., 0.], dtype=float32)
    """
    scale = np.float32(1 / spacing)
    second = rows * scale * _DOWN
    first = columns * scale - rows * scale * _ACROSS
    base = np.stack([np.floor(first), np.floor(second)])
    u, v = first - base[0], second - base[1]
    upper = u + v > 1  # the triangle beyond the diagonal
    far = upper.astype(np.int64)
    cell = base.astype(np.int64)
    one, none = np.ones_like(far), np.zeros_like(far)
    vertices = np.stack([cell + far, cell + np.stack([one, none]), cell + np.stack([none, one])])
    weights = np.stack([np.abs(1 - u - v), np.where(upper, 1 - v, u), np.where(upper, 1 - u, v)])
    return vertices, weights


def sharpened(weights: Float32[np.ndarray, "3 *points"], sharpness: float) -> Float32[np.ndarray, "3 *points"]:
    """Weights to the power of ``sharpness``, which add up to 1 again.

    References
    ----------
    [Burley2019]_: zones in which tiles are blended become narrower.
    """
    if sharpness == 1:
        return weights
    from texloom.stages.kernels.core.elementary_functions import power

    raised = np.asarray(power(weights, sharpness), np.float32)
    return np.asarray(raised / raised.sum(axis=0))


def shifts_of(
    vertices: Int64[np.ndarray, "3 2 *points"], size: tuple[int, int]
) -> Int64[np.ndarray, "2 3 *points"]:
    """Rows and columns by which a texture of ``size`` is shifted in each tile; whole px, so that it stays sharp."""
    bits = hashed(vertices[:, 1], vertices[:, 0], 0)
    return np.stack([(bits >> 16) * size[0] >> 16, (bits & 0xFFFF) * size[1] >> 16])
