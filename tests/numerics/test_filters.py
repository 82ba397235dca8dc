"""Filters beside OpenCV's."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from texloom.stages.numerics.filters import Border, gaussian_blur, gradients, interpolated

BORDERS: dict[Border, int] = {
    "mirror": cv2.BORDER_REFLECT_101,
    "repeat": cv2.BORDER_REFLECT,
    "edge": cv2.BORDER_REPLICATE,
    "zero": cv2.BORDER_CONSTANT,
}


@pytest.mark.parametrize("border", BORDERS)
@pytest.mark.parametrize("deviation", [0.8, 4.0])
@pytest.mark.parametrize("shape", [(61, 83), (7, 33, 3), (30, 5, 2), (40, 20, 1)])
def test_blur(shape: tuple[int, ...], deviation: float, border: Border, rng: np.random.Generator) -> None:
    pixels = rng.random(shape, np.float32)
    expected = cv2.GaussianBlur(pixels, (0, 0), deviation, borderType=BORDERS[border])
    found = gaussian_blur(pixels, deviation, border)
    assert found.dtype == np.float32
    np.testing.assert_allclose(found, expected.reshape(shape), atol=2e-6)


def test_gradients(rng: np.random.Generator) -> None:
    pixels = rng.random((20, 30, 3), np.float32)
    down, across = gradients(pixels)
    np.testing.assert_allclose(down, cv2.Scharr(pixels, -1, 0, 1), atol=1e-5)
    np.testing.assert_allclose(across, cv2.Scharr(pixels, -1, 1, 0), atol=1e-5)
    np.testing.assert_allclose(gradients(pixels, (1, 2, 1))[0], cv2.Sobel(pixels, -1, 0, 1), atol=1e-5)


def test_values_between_pixels() -> None:
    pixels = np.add.outer(np.arange(5, dtype=np.float32), 10 * np.arange(7, dtype=np.float32))
    rows, columns = np.array([[0.25, 4.0, -3.0, 9.0]]), np.array([[3.5, 6.0, -1.0, 2.0]])
    np.testing.assert_allclose(interpolated(pixels, rows, columns), [[35.25, 64, 0, 24]])
    np.testing.assert_allclose(interpolated(pixels[..., None], rows, columns)[..., 0], [[35.25, 64, 0, 24]])
