from __future__ import annotations

import numpy as np
import pytest

from tests.synthetic import masked, picture, smooth_noise
from texloom.stages.common.grids import working_size
from texloom.stages.common.grids.pyramid import resize
from texloom.stages.common.grids.working_size import Halvings, in_full, reduction, square_means, working_image


@pytest.mark.parametrize(
    ("height", "width", "step"),
    [(1, 1, 1), (1024, 1536, 1), (1025, 1536, 2), (2048, 2048, 2), (3024, 4032, 3), (6048, 8064, 6)],
)
def test_pictures_are_reduced_by_whole_pixels_beyond_a_number(height: int, width: int, step: int) -> None:
    assert reduction(height, width) == step


def test_means_are_over_whole_squares(rng: np.random.Generator) -> None:
    planes = rng.random((7, 11, 2)).astype(np.float32)
    expected = [[planes[3 * i : 3 * i + 3, 3 * j : 3 * j + 3].mean((0, 1)) for j in range(3)] for i in range(2)]
    np.testing.assert_allclose(square_means(planes, 3), expected, rtol=1e-5)


def test_small_pictures_stay() -> None:
    image = picture(np.zeros((20, 30, 3)))
    assert working_image(image) == (image, 1)


def test_excluded_pixels_have_no_influence(monkeypatch: pytest.MonkeyPatch, rng: np.random.Generator) -> None:
    monkeypatch.setattr(working_size, "MOST_PIXELS", 100)
    usable = np.ones((20, 20), bool)
    usable[:4, :6] = usable[9, 9] = False
    pixels = picture(rng.random((20, 20, 3)))
    one, step = working_image(masked(pixels, usable, 0.0))
    other, _ = working_image(masked(pixels, usable, 9.0))
    assert step == 2
    np.testing.assert_array_equal(one.pixels, other.pixels)
    excluded = one.pixels[..., -1] < 0.5
    assert excluded[:2, :3].all()
    assert excluded.sum() == 6


def test_planes_return_to_their_places(rng: np.random.Generator) -> None:
    row, column = np.indices((14, 17), np.float32)
    plane = in_full(square_means(row + 10 * column, 3), 3, 14, 17)
    assert plane.shape == (14, 17)
    np.testing.assert_allclose(plane[1:11, 1:14], (row + 10 * column)[1:11, 1:14], rtol=1e-5)


def test_large_planes_are_halved_before_they_are_resampled(
    monkeypatch: pytest.MonkeyPatch, rng: np.random.Generator
) -> None:
    planes = smooth_noise((240, 320, 2), 12.0, rng).astype(np.float32)
    expected = resize(planes, 24, 32)
    np.testing.assert_array_equal(Halvings(planes).resized(24, 32), expected)
    monkeypatch.setattr(working_size, "MOST_PIXELS", 1000)
    halved = Halvings(planes)
    np.testing.assert_array_equal(halved.resized(120, 160), resize(planes, 120, 160))
    np.testing.assert_allclose(halved.resized(24, 32), expected, atol=0.01 * float(np.ptp(planes)))
