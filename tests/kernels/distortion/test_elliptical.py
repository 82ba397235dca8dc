import numpy as np
import pytest

from tests.kernels.distortion import naive
from texloom.stages.kernels.distortion.elliptical import sample_ellipses

FRONTAL = np.array([1.0, 0.0, 0.0, 1.0])


def sampled(
    pixels: np.ndarray, places: np.ndarray, feet: np.ndarray, usable: np.ndarray | None = None
) -> np.ndarray:
    out = np.empty((len(places), pixels.shape[2]), np.float32)
    mask = np.ones(pixels.shape[:2], bool) if usable is None else usable
    sample_ellipses(pixels, mask, places.astype(np.float64), np.ascontiguousarray(feet, np.float64), out)
    return out


def test_footprints_of_all_shapes() -> None:
    rng = np.random.default_rng(1)
    pixels = rng.random((24, 30, 2)).astype(np.float32)
    usable = rng.random((24, 30)) > 0.2
    places = rng.uniform([-1, -1], [25, 31], (60, 2))
    feet = rng.normal(size=(60, 4)) * rng.choice([0.2, 1, 3], (60, 1))
    wanted = [
        naive.ellipse_mean(pixels, usable, place, foot.reshape(2, 2))
        for place, foot in zip(places, feet, strict=True)
    ]
    np.testing.assert_allclose(sampled(pixels, places, feet, usable), wanted, atol=1e-3)


@pytest.mark.parametrize("scale", [0.2, 1.0])
def test_pixels_are_interpolated(scale: float) -> None:
    pixels = np.random.default_rng(2).random((12, 14, 3)).astype(np.float32)
    places = np.stack(np.indices((12, 14)), axis=2).reshape(-1, 2)
    feet = np.tile(scale * FRONTAL, (len(places), 1))
    np.testing.assert_allclose(sampled(pixels, places, feet), pixels.reshape(-1, 3), atol=1e-6)


def test_what_is_even_stays() -> None:
    pixels = np.full((20, 20, 1), 0.3, np.float32)
    rng = np.random.default_rng(3)
    out = sampled(pixels, rng.uniform(0, 19, (50, 2)), rng.normal(size=(50, 4)) * 3)
    np.testing.assert_allclose(out, 0.3, rtol=1e-6)


def test_pixels_that_are_not_usable_have_no_influence() -> None:
    pixels = np.random.default_rng(4).random((20, 20, 1)).astype(np.float32)
    usable = np.ones((20, 20), bool)
    usable[:, 10:] = False
    other = np.where(usable[..., None], pixels, np.float32(9))
    places = np.random.default_rng(5).uniform([2, 2], [17, 9], (40, 2))
    feet = np.tile(2 * FRONTAL, (40, 1))
    np.testing.assert_array_equal(sampled(pixels, places, feet, usable), sampled(other, places, feet, usable))
