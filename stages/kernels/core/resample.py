"""Resampling: bilinear, and by cubic convolution (Catmull-Rom)."""

import numpy as np

from texloom.stages.kernels.core.compiled import compiled, inner
from texloom.stages.kernels.core.threads import run_all, spans

_PIECES = 64  # of work that threads share


@compiled
def _weights(t):
    """Weights of four pixels in a row for a position ``t`` px after the second, 0 <= t < 1."""
    square, cube = t * t, t * t * t
    return (
        0.5 * (-t + 2.0 * square - cube),
        0.5 * (2.0 - 5.0 * square + 3.0 * cube),
        0.5 * (t + 4.0 * square - 3.0 * cube),
        0.5 * (cube - square),
    )


@inner
def add_sample(pixels, row, column, share, out):
    """Add to ``out``, (c,), ``share`` times the picture's value at a place; beyond the picture that at its border.

    The value is kept within those of the four nearest pixels: cubics overshoot at edges.
    """
    height, width, channels = pixels.shape
    row, column = min(max(row, 0.0), height - 1.0), min(max(column, 0.0), width - 1.0)
    top, left = np.int64(row), np.int64(column)
    down, across = _weights(row - top), _weights(column - left)
    bottom, right = min(top + 1, height - 1), min(left + 1, width - 1)
    for channel in range(channels):
        value = 0.0
        for k in range(4):
            y = min(max(top + k - 1, 0), height - 1)
            line = 0.0
            for m in range(4):
                x = min(max(left + m - 1, 0), width - 1)
                line += across[m] * pixels[y, x, channel]
            value += down[k] * line
        one, two = pixels[top, left, channel], pixels[top, right, channel]
        three, four = pixels[bottom, left, channel], pixels[bottom, right, channel]
        low, high = min(one, two, three, four), max(one, two, three, four)
        out[channel] += share * min(max(value, low), high)


@compiled
def bilinear(plane, row, column):
    """A plane's value between its entries; beyond it that at its border."""
    height, width = plane.shape
    row, column = min(max(row, 0.0), height - 1.0), min(max(column, 0.0), width - 1.0)
    top, left = min(np.int64(row), height - 2), min(np.int64(column), width - 2)
    s, t = row - top, column - left
    upper = (1.0 - t) * plane[top, left] + t * plane[top, left + 1]
    lower = (1.0 - t) * plane[top + 1, left] + t * plane[top + 1, left + 1]
    return (1.0 - s) * upper + s * lower


@compiled
def sample(pixels, places, out):
    """Fill ``out`` with the picture's values at ``places``.

    Parameters
    ----------
    pixels : (h, w, c) float32 or float64
    places : (n, 2) float64, px, row before column
    out : (n, c), of the same type
    """
    for index in range(places.shape[0]):
        out[index] = 0.0
        add_sample(pixels, places[index, 0], places[index, 1], 1.0, out[index])


def sampled(pixels: np.ndarray, places: np.ndarray) -> np.ndarray:
    """The picture's values at places, on all threads.

    Parameters
    ----------
    pixels : (h, w, c) float32 or float64
    places : (..., 2) float64, px, row before column

    Returns
    -------
    (..., c) of the type of ``pixels``.
    """
    flat = places.reshape(-1, 2)
    values = np.empty((len(flat), pixels.shape[2]), pixels.dtype)
    run_all(sample, [(pixels, flat[a:b], values[a:b]) for a, b in spans(len(flat), _PIECES)])
    return values.reshape(*places.shape[:-1], -1)


@compiled
def enlarge(grid, every, out, first, last):
    """Fill the rows of ``out`` from the ``first`` to the ``last`` row of a grid with the values between its own.

    The values are those of `add_sample`.

    Parameters
    ----------
    grid : (ceil(h / every), ceil(w / every), c) float32, of every ``every``-th pixel of every ``every``-th row
    every : px
    out : (h, w, c) float32, output
    """
    height, width, channels = grid.shape
    lines = np.empty((4, out.shape[1], channels))
    weights = np.empty((every, 4))
    for k in range(every):
        weights[k, 0], weights[k, 1], weights[k, 2], weights[k, 3] = _weights(k / every)
    for top in range(first, last):
        for k in range(4):
            line = grid[min(max(top + k - 1, 0), height - 1)]
            for x in range(out.shape[1]):
                left = x // every
                across = weights[x % every if left < width - 1 else 0]
                before, right = max(left - 1, 0), min(left + 1, width - 1)
                after = min(left + 2, width - 1)
                for c in range(channels):
                    value = across[0] * line[before, c] + across[1] * line[left, c]
                    lines[k, x, c] = value + across[2] * line[right, c] + across[3] * line[after, c]
        upper, lower = grid[top], grid[min(top + 1, height - 1)]
        for y in range(top * every, min((top + 1) * every, out.shape[0])):
            down = weights[y - top * every if top < height - 1 else 0]
            for x in range(out.shape[1]):
                left, right = x // every, min(x // every + 1, width - 1)
                for c in range(channels):
                    value = down[0] * lines[0, x, c] + down[1] * lines[1, x, c]
                    value = value + down[2] * lines[2, x, c] + down[3] * lines[3, x, c]
                    one, two, three, four = upper[left, c], upper[right, c], lower[left, c], lower[right, c]
                    low, high = min(one, two, three, four), max(one, two, three, four)
                    out[y, x, c] = min(max(value, low), high)
