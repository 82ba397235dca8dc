from __future__ import annotations

import numpy as np

from texloom.stages.kernels.relief.sky_view import fill_sky_view


def naive(heights: np.ndarray, places: np.ndarray, distances: np.ndarray, margin: int) -> np.ndarray:
    """As `fill_sky_view`, point by point."""

    def between(row: float, column: float) -> float:
        top, left = int(np.floor(row)), int(np.floor(column))
        p, q = row - top, column - left
        corners = heights[top : top + 2, left : left + 2].astype(float)
        return float(np.array([1 - p, p]) @ corners @ np.array([1 - q, q]))

    shape = [side - 2 * margin for side in heights.shape]
    out = np.zeros(shape)
    for y, x in np.ndindex(*shape):
        row, column = y + margin, x + margin
        for direction in places:
            slopes = [
                (between(row + down, column + across) - heights[row, column]) / distance
                for (down, across), distance in zip(direction, distances, strict=True)
            ]
            out[y, x] += 1 / (1 + max(0.0, *slopes) ** 2) / len(places)
    return out


def test_equals_its_twin(rng: np.random.Generator) -> None:
    distances, angles, margin = np.array([1.0, 2.0, 3.0]), 2 * np.pi * np.arange(5) / 5, 4
    places = np.stack([np.sin(angles), np.cos(angles)], axis=1)[:, None] * distances[:, None]
    heights = rng.uniform(0, 4, (6 + 2 * margin, 9 + 2 * margin)).astype(np.float32)
    out = np.full((6, 9), np.nan, np.float32)
    fill_sky_view(heights, places, distances, margin, out, 0, 4)
    fill_sky_view(heights, places, distances, margin, out, 4, 6)
    np.testing.assert_allclose(out, naive(heights, places, distances, margin), rtol=1e-5)
