"""The standard normal distribution, whose last bits are the same on every processor."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

_CENTRE = (
    (59.109374720, 159.29113202, 50.434271938, 3.3871327179),
    (67.187563600, 78.757757664, 17.895169469, 1.0),
)
_TAIL = ((0.17023821103, 1.3067284816, 2.7568153900, 1.4234372777), (0.12021132975, 0.73700164250, 1.0))
_FAR = ((0.017337203997, 0.42868294337, 3.0812263860, 6.6579051150), (0.012258202635, 0.24197894225, 1.0))
_CUMULATIVE = (1.330274429, -1.821255978, 1.781477937, -0.356563782, 0.319381530, 0.0)
_SLOPE = 0.2316419


def normal_quantiles(shares: ArrayLike) -> np.ndarray:
    """The values below which these shares of a standard normal distribution lie, to 7 digits.

    Parameters
    ----------
    shares : between 0 and 1, both excluded.

    Returns
    -------
    float64 of the same shape.

    References
    ----------
    [Wichura1988]_, PPND7.

    Examples
    --------
    >>> normal_quantiles([0.5, 0.975]).round(4)
    array([0.  , 1.96])
    """
    from texloom.stages.kernels.core.elementary_functions import log

    p = np.asarray(shares, np.float64)
    q = p - 0.5
    r = 0.180625 - q * q
    centre = q * _ratio(r, _CENTRE)
    depth = np.sqrt(-log(np.minimum(p, 1 - p)))
    tail = np.where(depth <= 5, _ratio(depth - 1.6, _TAIL), _ratio(depth - 5, _FAR))
    return np.asarray(np.where(np.abs(q) <= 0.425, centre, np.copysign(tail, q)))


def normal_shares(values: ArrayLike) -> np.ndarray:
    """The shares of a standard normal distribution that lie below these values, to 7 digits.

    Returns
    -------
    float64 of the same shape.

    References
    ----------
    [AbramowitzStegun1964]_ 26.2.17.

    Examples
    --------
    >>> normal_shares([0.0, 1.96]).round(4)
    array([0.5  , 0.975])
    """
    from texloom.stages.kernels.core.elementary_functions import exp

    x = np.asarray(values, np.float64)
    t = 1 / (1 + _SLOPE * np.abs(x))
    above = exp(-x * x / 2) / np.sqrt(2 * np.pi) * _polynomial(t, _CUMULATIVE)
    return np.asarray(np.where(x < 0, above, 1 - above))


def _ratio(x: np.ndarray, factors: tuple[tuple[float, ...], tuple[float, ...]]) -> np.ndarray:
    return np.asarray(_polynomial(x, factors[0]) / _polynomial(x, factors[1]))


def _polynomial(x: np.ndarray, factors: tuple[float, ...]) -> np.ndarray:
    value = np.zeros_like(x)
    for factor in factors:
        value = np.asarray(value * x + factor)
    return value
