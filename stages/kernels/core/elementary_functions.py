"""Elementary functions, whose last bits are the same on every processor and with every C library.

NumPy's have other last bits with AVX-512, with AVX2, and without. These take and return what NumPy's do, and are
correct within two units in the last place of 64 bits, `power` within 32. The rational functions are those of the
Cephes library.
"""

from __future__ import annotations

import functools
from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

_EXP = (
    (1.26177193074810590878e-4, 3.02994407707441961300e-2, 9.99999999999999999910e-1),
    (3.00198505138664455042e-6, 2.52448340349684104192e-3, 2.27265548208155028766e-1, 2.00000000000000000005e0),
)
_LOG = (
    (1.01875663804580931796e-4, 4.97494994976747001425e-1, 4.70579119878881725854e0, 1.44989225341610930846e1,
     1.79368678507819816313e1, 7.70838733755885391666e0),
    (1.0, 1.12873587189167450590e1, 4.52279145837532221105e1, 8.29875266912776603211e1, 7.11544750618563894466e1,
     2.31251620126765340583e1),
)  # fmt: skip
SIN = (1.58962301576546568060e-10, -2.50507477628578072866e-8, 2.75573136213857245213e-6,
        -1.98412698295895385996e-4, 8.33333333332211858878e-3, -1.66666666666666307295e-1)  # fmt: skip
COS = (-1.13585365213876817300e-11, 2.08757008419747316778e-9, -2.75573141792967388112e-7,
        2.48015872888517045348e-5, -1.38888888888730564116e-3, 4.16666666666665929218e-2)  # fmt: skip
_ATAN = (
    (-8.750608600031904122785e-1, -1.615753718733365076637e1, -7.500855792314704667340e1,
     -1.228866684490136173410e2, -6.485021904942025371773e1),
    (1.0, 2.485846490142306297962e1, 1.650270098316988542046e2, 4.328810604912902668951e2,
     4.853903996359136964868e2, 1.945506571482613964425e2),
)  # fmt: skip
THIRD_OF_BITS = 0x2A9F7893782DA1CE
"""added to a third of the bits of a positive number, its cubic root to some per cent"""
_LN2 = (6.93145751953125e-1, 1.42860682030941723212e-6)  # ln 2 in two parts
_STRIP = 2**18  # values of a large array that are computed at once, as each step needs memory of their size
QUARTER_PI = (7.85398125648498535156e-1, 3.77489470793079817668e-8, 2.69515142907905952645e-15)


def _polynomial(x: np.ndarray, factors: tuple[float, ...]) -> np.ndarray:
    """By Horner's rule; the factor of the highest power is first."""
    value = np.full_like(x, factors[0])
    for factor in factors[1:]:
        value *= x
        value += factor
    return value


def _like(value: np.ndarray, *given: ArrayLike) -> Any:
    """In 32 bits if all that was given is, as NumPy has it."""
    kind = np.result_type(*(np.asarray(one) if np.ndim(one) else one for one in given), np.float16)
    with np.errstate(over="ignore"):
        return value.astype(np.float32 if kind == np.float32 else np.float64, copy=False)[()]


def _in_strips(function: Callable[..., Any]) -> Callable[..., Any]:
    """The function of one value, which large arrays are given to in strips."""

    @functools.wraps(function)
    def stripped(x: ArrayLike, *others: Any) -> Any:
        if not isinstance(x, np.ndarray) or x.size <= _STRIP or not x.flags.c_contiguous:
            return function(x, *others)
        given, found = x.reshape(-1), np.empty(0)
        for first in range(0, x.size, _STRIP):
            strip = function(given[first : first + _STRIP], *others)
            found = found if first else np.empty(x.size, strip.dtype)
            found[first : first + _STRIP] = strip
        return found.reshape(x.shape)

    return stripped


@_in_strips
def exp(x: ArrayLike) -> Any:
    """e to the power of ``x``; 0 below -708, infinity above 709."""
    given = np.asarray(x, np.float64)
    values = np.where(np.isnan(given), 0.0, np.clip(given, -708.0, 709.0))
    twos = np.rint(values * 1.4426950408889634)
    rest = values - twos * _LN2[0] - twos * _LN2[1]
    square = rest * rest
    above = rest * _polynomial(square, _EXP[0])
    found = np.ldexp(1 + 2 * (above / (_polynomial(square, _EXP[1]) - above)), twos.astype(np.int32))
    found = np.where(given < -708.0, 0.0, np.where(given > 709.0, np.inf, found))
    return _like(np.where(np.isnan(given), np.nan, found), x)


@_in_strips
def log(x: ArrayLike) -> Any:
    """Natural logarithm; minus infinity of 0, NaN of negative numbers."""
    given = np.asarray(x, np.float64)
    regular = (given > 0) & (given < np.inf)
    share, twos = np.frexp(np.where(regular, given, 1.0))
    small = share < 0.70710678118654752440
    rest = np.where(small, 2 * share, share) - 1
    twos = (twos - small).astype(np.float64)
    square = rest * rest
    value = rest * (square * _polynomial(rest, _LOG[0]) / _polynomial(rest, _LOG[1]))
    value = value - twos * 2.121944400546905827679e-4 - 0.5 * square
    found = rest + value + twos * 0.693359375
    other = np.where(given == 0, -np.inf, np.where(given == np.inf, np.inf, np.nan))
    return _like(np.where(regular, found, other), x)


@_in_strips
def log2(x: ArrayLike) -> Any:
    """Logarithm to base 2, exact for powers of 2."""
    given = np.asarray(x, np.float64)
    share, twos = np.frexp(np.where((given > 0) & (given < np.inf), given, 1.0))
    found = np.where((given > 0) & (given < np.inf), log(2 * share) * 1.4426950408889634 + (twos - 1), log(given))
    return _like(found, x)


@_in_strips
def power(x: ArrayLike, exponent: float) -> Any:
    """``x``, 0 or more, to the power of a number above 0; ``x`` itself where it is less."""
    given = np.asarray(x, np.float64)
    return _like(np.where(given > 0, exp(exponent * log(np.where(given > 0, given, 1.0))), given), x)


@_in_strips
def cbrt(x: ArrayLike) -> Any:
    """Cubic root."""
    given = np.asarray(x, np.float64)
    size = np.abs(given)
    positive = np.where(size > 0, size, 1.0)
    bits = positive.view(np.int64) // 3 + THIRD_OF_BITS
    root = bits.view(np.float64)
    for _ in range(4):
        root = root - (root - positive / (root * root)) * (1 / 3)
    return _like(np.where(size > 0, np.copysign(root, given), given), x)


def _sin_cos(x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    eighths = np.floor(np.abs(x) * 1.2732395447351628)
    eighths += eighths % 2
    rest = ((np.abs(x) - eighths * QUARTER_PI[0]) - eighths * QUARTER_PI[1]) - eighths * QUARTER_PI[2]
    square = rest * rest
    sine = rest + rest * (square * _polynomial(square, SIN))
    cosine = 1 - 0.5 * square + square * square * _polynomial(square, COS)
    quarter = (eighths / 2) % 4
    swapped = quarter % 2 == 1
    first, second = np.where(swapped, cosine, sine), np.where(swapped, sine, cosine)
    return np.where((quarter >= 2) ^ (x < 0), -first, first), np.where(
        (quarter == 1) | (quarter == 2), -second, second
    )


@_in_strips
def sin(x: ArrayLike) -> Any:
    """Sine of an angle up to some millions."""
    return _like(_sin_cos(np.asarray(x, np.float64))[0], x)


@_in_strips
def cos(x: ArrayLike) -> Any:
    """Cosine of an angle up to some millions."""
    return _like(_sin_cos(np.asarray(x, np.float64))[1], x)


@_in_strips
def phasor(angle: ArrayLike) -> Any:
    """e to the power of i times ``angle``, complex of twice its bits."""
    sine, cosine = (_like(part, angle) for part in _sin_cos(np.asarray(angle, np.float64)))
    found = np.empty(np.shape(angle), np.result_type(sine, np.complex64))
    found.real, found.imag = cosine, sine
    return found


def arctan2(y: ArrayLike, x: ArrayLike) -> Any:
    """Angle of (x, y), -pi to pi; 0 of (0, 0)."""
    down, across = np.asarray(y, np.float64), np.asarray(x, np.float64)
    most, least = np.maximum(np.abs(down), np.abs(across)), np.minimum(np.abs(down), np.abs(across))
    share = least / np.where(most > 0, most, 1.0)
    steep = share > 0.41421356237309504880  # tan(pi / 8)
    share = np.where(steep, (share - 1) / (share + 1), share)
    square = share * share
    angle = share + share * (square * _polynomial(square, _ATAN[0]) / _polynomial(square, _ATAN[1]))
    angle = np.where(steep, np.pi / 4 + angle, angle)
    angle = np.where(np.abs(down) > np.abs(across), np.pi / 2 - angle, angle)
    angle = np.where(np.signbit(across), np.pi - angle, angle)
    return _like(np.copysign(angle, down), y, x)


def phase_of(z: np.ndarray) -> Any:
    """Angle of complex numbers, -pi to pi."""
    return arctan2(z.imag, z.real)


def complex_product(one: np.ndarray, other: np.ndarray) -> np.ndarray:
    """Product of complex arrays of one type, in the order of the textbook."""
    found = np.empty(np.broadcast_shapes(one.shape, other.shape), np.result_type(one, other))
    found.real = one.real * other.real - one.imag * other.imag
    found.imag = one.real * other.imag + one.imag * other.real
    return found


def squared_size(z: np.ndarray) -> np.ndarray:
    """Square of the absolute value of complex numbers."""
    return np.asarray(z.real * z.real + z.imag * z.imag)
