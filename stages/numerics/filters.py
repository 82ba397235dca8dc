"""Filters of planes, whose last bits are the same on every processor.

Those of OpenCV fuse products with sums on some processors.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import Literal, TypeAlias

import numpy as np

Border: TypeAlias = Literal["mirror", "repeat", "edge", "zero"]
"""what lies beyond the border: ..., 2, 1, 0, 1, 2, ..., or 1, 0, 0, 1, or 0, 0, 0, 1, or nothing"""

_PAD = {"mirror": "reflect", "repeat": "symmetric", "edge": "edge"}
_PIECES = 16  # of work that threads share


def gaussian_blur(
    pixels: np.ndarray, deviation: float, border: Border = "mirror", side: int | None = None
) -> np.ndarray:
    """Gaussian blur of (h, w) or (h, w, c), float32 or float64.

    Parameters
    ----------
    deviation : standard deviation, px.
    side : of the kernel, px, odd; 8 deviations if not given.
    """
    import cv2

    kernel = cv2.getGaussianKernel(side or round(8 * deviation + 1) | 1, deviation, cv2.CV_64F).ravel()
    return filtered(pixels, kernel, kernel, border)


def gradients(pixels: np.ndarray, beside: tuple[int, int, int] = (3, 10, 3)) -> tuple[np.ndarray, np.ndarray]:
    """Differences of neighbours down and across of (h, w) or (h, w, c), times the sum of the shares ``beside``."""
    smooth, difference = np.array(beside, np.float64), np.array([-1.0, 0.0, 1.0])
    return filtered(pixels, difference, smooth, "mirror"), filtered(pixels, smooth, difference, "mirror")


def filtered(pixels: np.ndarray, down: np.ndarray, across: np.ndarray, border: Border) -> np.ndarray:
    """Sums of ``across`` times neighbours in a row, and of ``down`` times these in a column; of the same type."""
    from texloom.stages.kernels.core.separable_filters import filter_rows
    from texloom.stages.kernels.core.threads import run_spans

    height, width = pixels.shape[:2]
    flat = np.ascontiguousarray(pixels).reshape(height, -1)
    channels = flat.shape[1] // width
    rows, columns = _beyond(height, down.size, border), _beyond(width, across.size, border)
    values = np.where(columns >= 0, columns * channels, -channels)[:, None] + np.arange(channels)
    out = np.empty_like(flat)
    given = (flat, down.astype(flat.dtype), across.astype(flat.dtype), rows, np.maximum(values, -1).ravel(), out)
    run_spans(filter_rows, given, height, min(_PIECES, max(1, flat.size >> 12)))
    return out.reshape(pixels.shape)


def padded(plane: np.ndarray, margin: int, modes: Iterable[str]) -> np.ndarray:
    """``plane``, (h, w), with ``margin`` px on each side, by the modes of `numpy.pad` down and across."""
    for axis, mode in enumerate(modes):
        beyond = [(margin, margin) if axis == one else (0, 0) for one in (0, 1)]
        plane = np.pad(plane, beyond, mode)  # type: ignore[call-overload]
    return plane


def _beyond(side: int, length: int, border: Border) -> np.ndarray:
    """Indices of pixels, from those before the first to those after the last that a filter reaches; -1 for none."""
    if border == "zero":
        return np.pad(np.arange(side), length // 2, constant_values=-1)
    return np.pad(np.arange(side), length // 2, mode=_PAD[border])  # type: ignore[call-overload, no-any-return]


def interpolated(pixels: np.ndarray, rows: np.ndarray, columns: np.ndarray) -> np.ndarray:
    """Values of float32 (h, w) or (h, w, c) between pixels, linearly; beyond the border those at it.

    Parameters
    ----------
    rows, columns : px, float32 or float64
    """
    height, width = pixels.shape[:2]
    rows, columns = np.clip(rows, 0, height - 1), np.clip(columns, 0, width - 1)
    top, left = np.floor(rows).astype(np.int64), np.floor(columns).astype(np.int64)
    below, right = np.minimum(top + 1, height - 1), np.minimum(left + 1, width - 1)
    shape = rows.shape + (1,) * (pixels.ndim - 2)
    down, across = ((at - first).astype(np.float32).reshape(shape) for at, first in ((rows, top), (columns, left)))
    upper = pixels[top, left] * (1 - across) + pixels[top, right] * across
    lower = pixels[below, left] * (1 - across) + pixels[below, right] * across
    return np.asarray(upper * (1 - down) + lower * down)
