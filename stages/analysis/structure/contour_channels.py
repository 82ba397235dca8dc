"""What a structured forest looks at: colours and gradients, as in OpenCV's ``StructuredEdgeDetection``."""

import numpy as np
from jaxtyping import Float32, UInt8

from texloom.stages.kernels.core.elementary_functions import cbrt
from texloom.stages.numerics.filters import filtered

CHANNELS = 13
"""CIELUV, then at two scales the gradient's size and its share in four directions"""
_DIRECTIONS = 4
_NORMALISED_OVER = 4  # px to each side, where the mean size of gradients is taken
_LEVELS = 1024  # of luminance
# RGB to XYZ, chromaticity of white, and the range that CIELUV is scaled from, as in the detector's definition
_XYZ = np.array(
    [[0.430574, 0.341550, 0.178325], [0.222015, 0.706655, 0.071330], [0.020183, 0.129553, 0.939180]], np.float32
)
_WHITE = np.float32(13) * np.array([0.197833, 0.468331], np.float32)
_LOW, _RANGE = np.array([-88, -134], np.float32) / np.float32(270), np.float32(270)
_STEEP = np.float32(np.sqrt(2) - 1)  # tangent of half of 45 degrees, the width of a direction


def channels_of(color: Float32[np.ndarray, "h w 3"]) -> Float32[np.ndarray, "h/2 w/2 13"]:
    """The channels of an sRGB picture in 0..1 of even sides, at half its resolution, before any smoothing.

    References
    ----------
    [Dollar2013]_ section 3.4.
    """
    luv = _luv(color)
    half = halved(luv)
    planes = list(half)
    for picture in (luv, half):
        size, direction = _gradient(picture)
        size /= triangle(size[..., None], _NORMALISED_OVER)[..., 0] + np.float32(0.01)
        shares = np.stack([size, *(size * (direction == k) for k in range(_DIRECTIONS))])
        planes += list(halved(shares) if picture is luv else shares)
    return np.stack(planes, axis=2)


def triangle(channels: Float32[np.ndarray, "h w c"], radius: int) -> Float32[np.ndarray, "h w c"]:
    """Every channel convolved with a triangle of ``radius`` px to each side."""
    weights = np.minimum(np.arange(1, 2 * radius + 2), np.arange(2 * radius + 1, 0, -1)).astype(np.float32)
    weights /= np.float32((radius + 1) ** 2)
    return filtered(channels, weights, weights, "mirror")


def halved(planes: Float32[np.ndarray, "c h w"]) -> Float32[np.ndarray, "c h/2 w/2"]:
    """Means of 2 x 2 values."""
    pairs = planes[:, ::2] + planes[:, 1::2]
    return np.asarray((pairs[..., ::2] + pairs[..., 1::2]) * np.float32(0.25))


def _luv(color: Float32[np.ndarray, "h w 3"]) -> Float32[np.ndarray, "3 h w"]:
    """CIELUV in about 0..1, its lightness in steps; the encoded colours are taken for linear ones."""
    red, green, blue = (np.ascontiguousarray(color[..., k]) for k in range(3))
    x, y, z = (row[0] * red + row[1] * green + row[2] * blue for row in _XYZ)
    levels = np.arange(_LEVELS) / _LEVELS
    slope = 29**3 / 27
    lightness = np.where(levels > 8 / slope, 116 * cbrt(levels) - 16, levels * slope).astype(np.float32) / _RANGE
    level = lightness[np.minimum((y * np.float32(_LEVELS)).astype(np.int32), _LEVELS - 1)]
    scale = np.float32(1) / (x + np.float32(15) * y + np.float32(3) * z + np.float32(1e-35))
    u = level * (np.float32(52) * x * scale - _WHITE[0]) - _LOW[0]
    v = level * (np.float32(117) * y * scale - _WHITE[1]) - _LOW[1]
    return np.stack([level, u, v])


def _gradient(picture: Float32[np.ndarray, "3 h w"]) -> tuple[Float32[np.ndarray, "h w"], UInt8[np.ndarray, "h w"]]:
    """Size of the gradient of the channel where it is largest, and to which multiple of 45 degrees it is near."""
    largest = dy = dx = np.zeros(picture.shape[1:], np.float32)
    for plane in picture:
        padded = np.pad(plane, 1, "symmetric")
        down, across = padded[2:, 1:-1] - padded[:-2, 1:-1], padded[1:-1, 2:] - padded[1:-1, :-2]
        squared = across * across + down * down
        larger = squared > largest
        largest = np.maximum(squared, largest)
        dy, dx = np.where(larger, down, dy), np.where(larger, across, dx)
    steep, flat = np.abs(dy), np.abs(dx)
    direction = np.where(np.signbit(dy) == np.signbit(dx), np.uint8(1), np.uint8(3))
    direction[steep < _STEEP * flat] = 0
    direction[(flat < _STEEP * steep) | (steep + flat < np.float32(1e-5))] = 2
    return np.sqrt(largest), direction
