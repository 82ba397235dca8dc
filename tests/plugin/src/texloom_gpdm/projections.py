"""Projections of all patches of a picture on random directions."""

from __future__ import annotations

import numpy as np
from scipy.ndimage import correlate


def directions(rng: np.random.Generator, count: int, side: int, channels: int) -> np.ndarray:
    """Unit vectors in the space of patches, (count, side, side, channels)."""
    vectors = rng.normal(size=(count, side, side, channels)).astype(np.float32)
    return vectors / np.sqrt((vectors**2).sum(axis=(1, 2, 3), keepdims=True))


def projected(pixels: np.ndarray, direction: np.ndarray, mode: str) -> np.ndarray:
    """The scalar product of a direction with the patch around every pixel, (h, w)."""
    planes = (correlate(pixels[..., c], direction[..., c], mode=mode) for c in range(pixels.shape[2]))
    return np.sum(list(planes), axis=0)


def spread(values: np.ndarray, direction: np.ndarray, mode: str) -> np.ndarray:
    """The transpose of `projected`, (h, w, c)."""
    flipped = direction[::-1, ::-1]
    return np.stack([correlate(values, flipped[..., c], mode=mode) for c in range(direction.shape[2])], axis=2)
