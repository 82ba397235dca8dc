import numpy as np

from tests.kernels.core import naive
from texloom.stages.kernels.core.resample import enlarge, sample


def read(pixels: np.ndarray, places: np.ndarray) -> np.ndarray:
    out = np.full((len(places), pixels.shape[2]), np.nan, np.float32)
    sample(np.ascontiguousarray(pixels, np.float32), np.ascontiguousarray(places, np.float64), out)
    return out


def test_equals_twin(rng: np.random.Generator) -> None:
    pixels = rng.random((7, 9, 3)).astype(np.float32)
    places = rng.uniform(-3, 12, (200, 2))
    places[:20] = np.rint(places[:20])
    expected = [naive.sampled(pixels, *place) for place in places]
    np.testing.assert_allclose(read(pixels, places), expected, atol=1e-6)


def test_pixels_are_copied_exactly(rng: np.random.Generator) -> None:
    pixels = rng.random((6, 5, 2)).astype(np.float32)
    places = np.argwhere(np.ones((6, 5))).astype(float)
    np.testing.assert_array_equal(read(pixels, places).reshape(6, 5, 2), pixels)


def test_even_slopes_are_kept_and_edges_do_not_overshoot() -> None:
    row, column = np.indices((12, 12))
    slope = (3.0 * row - 2.0 * column)[..., None]
    places = np.random.default_rng(1).uniform(1, 10, (50, 2))
    np.testing.assert_allclose(read(slope, places)[:, 0], places @ [3, -2], atol=1e-5)
    edge = (column >= 6).astype(float)[..., None]
    values = read(edge, places)
    assert values.min() == 0
    assert values.max() == 1


def test_a_grid_is_enlarged_to_samples_between_its_pixels(rng: np.random.Generator) -> None:
    for shape, every in (((5, 7), 2), ((4, 3), 4), ((1, 2), 8)):
        grid = rng.random((*shape, 3)).astype(np.float32)
        out = np.empty((shape[0] * every - 1, shape[1] * every, 3), np.float32)
        for row in range(shape[0]):
            enlarge(grid, every, out, row, row + 1)
        places = np.moveaxis(np.indices(out.shape[:2]) / every, 0, 2).reshape(-1, 2)
        np.testing.assert_array_equal(out.reshape(-1, 3), read(grid, places))
