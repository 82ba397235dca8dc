"""Levels of detail of a texture that continues across its borders, and its values at any place, filtered."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence

import numpy as np
from jaxtyping import Float32

_BAND = 2**18  # points that are computed at once


def bands_of(rows: Float32[np.ndarray, "H W"], columns: np.ndarray) -> Iterator[tuple[np.ndarray, np.ndarray]]:
    """Places, some rows of them at once, so that what is computed of them needs little memory."""
    step = max(1, _BAND // rows.shape[1])
    for top in range(0, len(rows), step):
        yield rows[top : top + step], columns[top : top + step]


def in_bands(
    part: Callable[[np.ndarray, np.ndarray], np.ndarray], rows: Float32[np.ndarray, "H W"], columns: np.ndarray
) -> np.ndarray:
    """The values of ``part`` at places, by `bands_of` them."""
    return np.concatenate([part(*band) for band in bands_of(rows, columns)])


def pyramid_of(planes: Float32[np.ndarray, "h w n"]) -> list[Float32[np.ndarray, "_ _ n"]]:
    """All levels of detail down to a single pixel."""
    levels = [planes]
    while max(levels[-1].shape[:2]) > 1:
        levels.append(halved(levels[-1]))
    return levels


def halved(planes: Float32[np.ndarray, "h w n"]) -> Float32[np.ndarray, "k m n"]:
    """Half the size, rounded down, by averages over the area of each pixel."""
    for axis in (0, 1):
        size = planes.shape[axis]
        half = max(1, size // 2)
        if size == 2 * half:
            shape = (*planes.shape[:axis], half, 2, *planes.shape[axis + 1 :])
            planes = planes.reshape(shape).mean(axis=axis + 1, dtype=np.float64).astype(np.float32)
        elif size > 1:
            moved = np.moveaxis(planes, axis, 0).astype(np.float64)
            sums = np.concatenate([np.zeros_like(moved[:1]), np.cumsum(moved, axis=0)])
            edges = np.arange(half + 1) * size / half
            whole = np.minimum(edges.astype(np.int64), size - 1)
            part = (edges - whole).reshape(-1, *[1] * (moved.ndim - 1))
            at = sums[whole] + part * moved[whole]
            planes = np.moveaxis(np.diff(at, axis=0) * (half / size), 0, axis).astype(np.float32)
    return planes


def texels(
    pyramid: Sequence[Float32[np.ndarray, "_ _ n"]],
    rows: Float32[np.ndarray, "H W"],
    columns: Float32[np.ndarray, "H W"],
    level: float,
) -> Float32[np.ndarray, "H W n"]:
    """Values at places of the plane, px of the largest level, bilinear and between two levels linear."""
    level = min(max(level, 0.0), len(pyramid) - 1.0)
    lower = int(level)
    between = np.float32(level - lower)
    value = _bilinear(pyramid[lower], rows, columns, pyramid[0].shape[:2])
    if between == 0:
        return value
    upper = _bilinear(pyramid[lower + 1], rows, columns, pyramid[0].shape[:2])
    return np.asarray(value + between * (upper - value))


def _bilinear(planes: np.ndarray, rows: np.ndarray, columns: np.ndarray, size: tuple[int, int]) -> np.ndarray:
    """A torus that stands for a texture of ``size``, at places of that texture's pixels."""
    height, width = planes.shape[:2]
    half = np.float32(0.5)
    y = (rows + half) * np.float32(height / size[0]) - half
    x = (columns + half) * np.float32(width / size[1]) - half
    top, left = np.floor(y), np.floor(x)
    t, s = (y - top)[..., None], (x - left)[..., None]
    up, near = top.astype(np.int64) % height, left.astype(np.int64) % width
    if not t.any() and not s.any():
        return np.asarray(planes[up, near])
    low, far = (up + 1) % height, (near + 1) % width
    upper = planes[up, near] + s * (planes[up, far] - planes[up, near])
    lower = planes[low, near] + s * (planes[low, far] - planes[low, near])
    return np.asarray(upper + t * (lower - upper))
