"""An exemplar of three materials with its labels, and a target."""

from __future__ import annotations

import numpy as np

from tests.synthetic import blobs, picture
from texloom.stages.vocabulary.arrays import Image

COLORS = np.array([[255, 40, 40], [40, 200, 40], [40, 60, 255]], np.uint8)


def labelled(labels: np.ndarray, rng: np.random.Generator) -> Image:
    """Materials of different colours and grains, by label."""
    tints = np.array([[1.0, 0.5, 0.3], [0.3, 0.8, 0.3], [0.6, 0.6, 0.9]])
    grains = np.stack(
        [blobs((*labels.shape, 1), rng, sigma)[..., None] * tints[i] for i, sigma in enumerate((1.5, 2.5, 4))]
    )
    return picture(np.take_along_axis(grains, labels[None, ..., None], axis=0)[0])


def painted(labels: np.ndarray, noise: float = 0.0, rng: np.random.Generator | None = None) -> Image:
    """A label picture, with noise in 8-bit steps."""
    codes = COLORS[labels].astype(float)
    if rng is not None:
        codes += rng.normal(scale=noise, size=codes.shape)
    return Image.of(np.clip(np.rint(codes), 0, 255).astype(np.uint8))


def bands(shape: tuple[int, int]) -> np.ndarray:
    """Labels of an exemplar: two broad bands, and a rare third one."""
    row = np.arange(shape[0])[:, None] / shape[0]
    return np.broadcast_to(np.where(row < 0.44, 0, np.where(row < 0.82, 1, 2)), shape)


def disc(shape: tuple[int, int]) -> np.ndarray:
    """Labels of a target: mostly the rare one, a disc of the second, a corner of the first."""
    row, column = np.indices(shape)
    labels = np.full(shape, 2)
    labels[np.hypot(row - shape[0] / 2, column - shape[1] / 2) < 0.3 * min(shape)] = 1
    labels[: shape[0] // 4, : shape[1] // 3] = 0
    return labels
