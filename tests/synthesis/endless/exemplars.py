"""Textures to make a plane of."""

from __future__ import annotations

import numpy as np

from tests.synthetic import smooth_noise
from texloom.stages.synthesis.endless.gaussian_texture import (
    GaussianTexture,
    GaussianTextureParams,
    gaussian_texture,
)
from texloom.stages.synthesis.endless.noise import Noise
from texloom.stages.vocabulary.arrays import Image
from texloom.stages.vocabulary.normals import NORMAL


def colors(height: int = 60, width: int = 75) -> Image:
    """A torus in colour whose values are far from Gaussian."""
    noise = smooth_noise((height, width, 3), 1.2, np.random.default_rng(5)).astype(np.float64)
    ramp = (noise - noise.min()) / np.ptp(noise)
    ramp[..., 1] = 0.7 * ramp[..., 0] + 0.3 * ramp[..., 1]
    return Image((ramp**3).astype(np.float32), ("R", "G", "B")).wrapping(True)


def material(height: int = 60, width: int = 75) -> Image:
    """The same with normals and roughness that belong to it."""
    color = colors(height, width).pixels
    relief = color.mean(axis=2)
    slopes = [np.roll(relief, 1, axis) - np.roll(relief, -1, axis) for axis in (1, 0)]
    vectors = np.stack([slopes[0], -slopes[1], np.full_like(relief, 0.3)], axis=2)
    vectors /= np.sqrt(np.square(vectors).sum(axis=2, keepdims=True))
    planes = np.concatenate([color, vectors, 1 - relief[..., None]], axis=2).astype(np.float32)
    return Image(planes, ("R", "G", "B", *NORMAL, "roughness")).wrapping(True)


def made(image: Image, **params: float) -> tuple[GaussianTexture, Noise]:
    texture = gaussian_texture(image, GaussianTextureParams(**params))
    return texture, Noise.of(
        (texture.first, texture.second, texture.third, texture.fourth), texture.inverse, texture.layout
    )


def places(
    side: int, scale: float = 1.0, top: float = -150.0, left: float = -211.0
) -> tuple[np.ndarray, np.ndarray]:
    """Rows and columns of a square of pixels, each ``scale`` px of the texture."""
    rows, columns = (one.astype(np.float32) * np.float32(scale) for one in np.mgrid[:side, :side])
    return rows + np.float32(top), columns + np.float32(left)
