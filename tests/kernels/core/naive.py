"""Slow readable twins of the kernels for resampling."""

import math

import numpy as np


def catmull_rom(x: float) -> float:
    """Keys' cubic convolution kernel with a = -1/2."""
    x = abs(x)
    if x < 1:
        return 1.5 * x**3 - 2.5 * x**2 + 1
    return -0.5 * x**3 + 2.5 * x**2 - 4 * x + 2 if x < 2 else 0.0


def sampled(pixels: np.ndarray, row: float, column: float) -> np.ndarray:
    """A picture's value between pixels, kept within those of the four nearest; its border goes on for ever."""
    height, width, _ = pixels.shape
    row, column = min(max(row, 0), height - 1), min(max(column, 0), width - 1)
    top, left = math.floor(row), math.floor(column)

    def at(y: int, x: int) -> np.ndarray:
        return pixels[min(max(y, 0), height - 1), min(max(x, 0), width - 1)].astype(np.float64)

    value = sum(
        catmull_rom(row - y) * catmull_rom(column - x) * at(y, x)
        for y in range(top - 1, top + 3)
        for x in range(left - 1, left + 3)
    )
    near = np.stack([at(top + i, left + j) for i in (0, 1) for j in (0, 1)])
    return np.clip(value, near.min(axis=0), near.max(axis=0))


def bilinear(plane: np.ndarray, row: float, column: float) -> np.ndarray:
    """A plane's value between its entries; beyond it that at its border."""
    height, width = plane.shape[:2]
    row, column = np.clip((row, column), 0, (height - 1, width - 1))
    top, left = min(int(row), height - 2), min(int(column), width - 2)
    near, far = plane[top : top + 2, left].astype(float), plane[top : top + 2, left + 1]
    upper, lower = (1 - (column - left)) * near + (column - left) * far
    return np.asarray((1 - (row - top)) * upper + (row - top) * lower)
