"""Colour between linear light (Rec.709 primaries), sRGB and CIELAB (D65)."""

from __future__ import annotations

import functools

import numpy as np
from jaxtyping import Float32, UInt8

from texloom.stages.kernels.core.elementary_functions import power
from texloom.stages.numerics.matrices import inverse_of, matrix_product

_XYZ_FROM_LINEAR = np.array(
    [[0.412453, 0.357580, 0.180423], [0.212671, 0.715160, 0.072169], [0.019334, 0.119193, 0.950227]]
)
_WHITE = np.array([0.95047, 1.0, 1.08883])  # D65, 2 degree observer
_CACHED = 2**15  # pixels converted at once: what is made of them on the way fits into the processor's cache
_STRIP = 2**20  # values converted at once: numpy makes 8-byte indices of them


def lab_from_linear(color: Float32[np.ndarray, "h w 3"]) -> Float32[np.ndarray, "h w 3"]:
    """CIELAB (D65) of linear Rec.709 colour.

    L is 0..100 for 0..1 and above 100 for brighter light; negative light counts as 0.
    """
    from texloom.stages.kernels.core.cielab import fill_lab

    lab = np.empty(color.shape, np.result_type(color, np.float32))
    matrix = np.ascontiguousarray((_XYZ_FROM_LINEAR / _WHITE[:, None]).astype(np.float32).T, lab.dtype)
    fill_lab(np.ascontiguousarray(color, lab.dtype).reshape(-1, 3), matrix, lab.reshape(-1, 3))
    return lab


def linear_from_lab(lab: Float32[np.ndarray, "h w 3"]) -> Float32[np.ndarray, "h w 3"]:
    """Linear Rec.709 colour of CIELAB (D65); colours outside Rec.709 have negative channels."""
    lightness = (lab[..., 0] + 16) / 116
    f = np.stack([lightness + lab[..., 1] / 500, lightness, lightness - lab[..., 2] / 200], axis=-1)
    relative = np.where(f > 6 / 29, f * f * f, (f - np.float32(4 / 29)) * np.float32(108 / 841))
    matrix = inverse_of(_XYZ_FROM_LINEAR / _WHITE[:, None]).astype(np.float32)
    return np.asarray(matrix_product(relative, matrix.T), np.float32)


def linear_from_srgb(encoded: np.ndarray) -> np.ndarray:
    """Linear light of sRGB values in 0..1 (IEC 61966-2-1)."""
    return np.where(encoded <= 0.04045, encoded / 12.92, power((np.maximum(encoded, 0) + 0.055) / 1.055, 2.4))


def srgb_from_linear(linear: np.ndarray) -> np.ndarray:
    """SRGB values of linear light, which is clipped to 0..1."""
    lines = np.atleast_1d(linear)
    encoded = np.empty(lines.shape, np.result_type(linear, np.float32))
    rows = max(1, 3 * _CACHED // max(1, lines[:1].size))
    for top in range(0, len(lines), rows):
        clipped = np.clip(lines[top : top + rows], 0, 1)
        curved = 1.055 * power(clipped, 1 / 2.4) - 0.055
        encoded[top : top + rows] = np.where(clipped <= 0.0031308, clipped * 12.92, curved)
    return encoded.reshape(np.shape(linear))


def srgb_codes(linear: Float32[np.ndarray, "*n"]) -> UInt8[np.ndarray, "*n"]:
    """8-bit sRGB codes of linear light, which is clipped to 0..1; NaN is 0.

    They are those of `srgb_from_linear`, rounded.

    Examples
    --------
    >>> import numpy as np
    >>> srgb_codes(np.array([0, 0.18, 2], np.float32))
    array([  0, 118, 255], dtype=uint8)
    """
    from texloom.stages.kernels.core.colour_codes import find_codes

    codes = np.empty(linear.shape, np.uint8)
    values = np.ascontiguousarray(linear).reshape(-1)
    for first in range(0, values.size, _STRIP):
        strip = np.where(np.isnan(values[first : first + _STRIP]), np.float32(0), values[first : first + _STRIP])
        find_codes(strip.view(np.int32), *_code_tables(), codes.reshape(-1)[first : first + _STRIP])
    return codes


@functools.cache
def _code_tables() -> tuple[np.ndarray, np.ndarray]:
    """Bits of the least light of each code from 1 on, and the codes that these bits begin with."""
    from texloom.stages.kernels.core.colour_codes import SHIFT

    codes = np.arange(1, 256)
    below, reached = np.zeros(255, np.int32), np.full(255, np.float32(1).view(np.int32))
    while (reached - below > 1).any():
        middle = (below + reached) // 2
        is_reached = np.rint(srgb_from_linear(middle.view(np.float32)) * np.float32(255)) >= codes
        below, reached = np.where(is_reached, below, middle), np.where(is_reached, middle, reached)
    firsts = np.arange((int(reached[-1]) >> SHIFT) + 1) << SHIFT
    return reached, np.searchsorted(reached, firsts, side="right").astype(np.uint8)


def linear_from_codes(codes: np.ndarray, data_planes: int = 0) -> Float32[np.ndarray, "h w c"]:
    """Linear light of 8-bit or 16-bit sRGB codes.

    Parameters
    ----------
    codes : (h, w, c), uint8 or uint16.
    data_planes : number of last planes that are not colour, such as alpha or height; they are scaled to 0..1.
    """
    encoded = np.arange(np.iinfo(codes.dtype).max + 1) / np.iinfo(codes.dtype).max
    color_table, data_table = linear_from_srgb(encoded).astype(np.float32), encoded.astype(np.float32)
    pixels = np.empty(codes.shape, np.float32)
    colors = codes.shape[2] - data_planes
    rows = max(1, _STRIP // (codes.shape[1] * codes.shape[2]))
    for top in range(0, codes.shape[0], rows):
        strip = codes[top : top + rows]
        pixels[top : top + rows, :, :colors] = color_table[strip[..., :colors]]
        pixels[top : top + rows, :, colors:] = data_table[strip[..., colors:]]
    return pixels
