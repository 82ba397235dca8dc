"""Scales of a pyramid: their number and sizes, and resampling."""

import math

import numpy as np
from jaxtyping import Bool, Float32

MAX_ROW_VALUES = 368
"""maximum number of values in a patch's row, all channels, for exact distances"""


def scale_sizes(height: int, width: int, coarsest: int, ratio: float) -> list[float]:
    """Factors of the scales, coarsest first and 1 last, evenly spaced in the logarithm.

    The shorter side is at least ``coarsest`` px at the first scale, and neighbours differ by at least ``ratio``
    ([Kaspar2015]_ section 3; even steps as in the authors' code).
    """
    shorter = min(height, width)
    count = max(1, math.floor(math.log(shorter / coarsest) / math.log(ratio)) + 1) if shorter > coarsest else 1
    if count == 1:
        return [1.0]
    first = coarsest / shorter
    return [first ** ((count - 1 - index) / (count - 1)) for index in range(count)]


def scaled(size: int, factor: float) -> int:
    """A side of ``size`` px at the scale of ``factor``."""
    return max(1, round(size * factor))


def halved_size(shape: tuple[int, int], times: int) -> tuple[int, int]:
    """Height and width after ``times`` halvings, rounded up, px."""
    return -(-shape[0] // 2**times), -(-shape[1] // 2**times)


def resize(
    planes: Float32[np.ndarray, "h w c"], height: int, width: int, bilinear: bool = False
) -> Float32[np.ndarray, "H W c"]:
    """Resample by a filter of the coarser pixel grid, without aliasing.

    Parameters
    ----------
    bilinear : use a triangle filter, which never exceeds the range of the values, instead of a Lanczos filter.
    """
    from PIL import Image as Pillow

    if planes.shape[:2] == (height, width):
        return planes
    if planes.shape[2] == 0:
        return np.zeros((height, width, 0), np.float32)
    kernel = Pillow.Resampling.BILINEAR if bilinear else Pillow.Resampling.LANCZOS
    result = np.empty((height, width, planes.shape[2]), np.float32)
    for number, plane in enumerate(np.moveaxis(planes, 2, 0)):
        result[..., number] = Pillow.fromarray(np.ascontiguousarray(plane)).resize((width, height), kernel)
    return result


def resized_mask(mask: Bool[np.ndarray, "h w"], height: int, width: int) -> Bool[np.ndarray, "H W"]:
    """A mask at another size: true where more than half is."""
    return np.asarray(resize(mask[..., None].astype(np.float32), height, width, bilinear=True)[..., 0] > 0.5)


def reduced(planes: Float32[np.ndarray, "h w c"], side: int) -> Float32[np.ndarray, "H W c"]:
    """Reduced to a longer side of at most ``side`` px."""
    factor = min(1.0, side / max(planes.shape[:2]))
    return resize(planes, scaled(planes.shape[0], factor), scaled(planes.shape[1], factor), bilinear=True)
