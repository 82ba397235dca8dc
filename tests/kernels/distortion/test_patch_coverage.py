from collections.abc import Iterator

import numpy as np
import pytest

import texloom
from tests.kernels.distortion import naive
from tests.photographs import unit_square
from texloom.stages.kernels.distortion.patch_coverage import cover
from texloom.stages.vocabulary.declare import InputError


def test_pixels_of_a_curved_patch() -> None:
    shape = (24, 30)
    rows, columns = np.meshgrid(np.linspace(3, 20, 4), np.linspace(4, 25, 4), indexing="ij")
    weights = 1 + 0.2 * np.random.default_rng(5).random((4, 4))
    controls = np.stack([(rows + 0.15 * columns) * weights, (columns - 0.1 * rows) * weights, weights], axis=2)
    controls[1:3, 1:3, :2] += 0.8
    total, count, place = np.zeros((*shape, 4)), np.zeros(shape, np.int32), np.zeros((*shape, 2))
    for span in ((0, 9), (9, 24)):
        cover(controls, controls, np.ones(2), 4, total, count, place, *span)
    near, wanted = naive.cover(controls, shape, 151)
    assert count.max() == 1  # parts of a patch share no pixel
    inside = (count == 1) & near
    assert np.count_nonzero(inside) > 0.9 * np.count_nonzero(near) > 200
    np.testing.assert_allclose(place[inside], wanted[inside], atol=0.012)
    assert not (count[~near] == 1).any()


def covered(corners: np.ndarray, shape: tuple[int, int], cells: int = 16) -> np.ndarray:
    """How many cells of the plane through the corners count each pixel."""
    points, weights = texloom.control_points(corners)
    controls = np.concatenate([points * weights[..., None], weights[..., None]], axis=2)
    total, count, place = np.zeros((*shape, 4)), np.zeros(shape, np.int32), np.zeros((*shape, 2))
    cover(controls, controls, np.ones(2), cells, total, count, place, 0, shape[0])
    return count


def quads(kind: str) -> Iterator[np.ndarray]:
    """Corners whose cells' borders run through pixels, and any others."""
    rng = np.random.default_rng(len(kind))
    for _ in range(150):
        top, left = rng.integers(-10, 20, 2)
        height, width = rng.integers(10, 60, 2) if kind == "any sides" else 16 * rng.integers(1, 5, 2)
        corners = np.array([[top, left], [top, left + width], [top + height, left + width], [top + height, left]])
        if kind == "trapezoids":
            corners[2:, 1] += np.array([1, -1]) * rng.integers(0, 60)
        elif kind == "random":
            corners = corners + rng.uniform(-25, 25, (4, 2))
        yield corners.astype(np.float64)


@pytest.mark.parametrize("kind", ["whole cells", "any sides", "trapezoids", "random"])
def test_a_plane_has_no_holes(kind: str) -> None:
    """Every pixel of a quad counts once, also on borders of cells, and no other."""
    shape, tested = (80, 90), 0
    for corners in quads(kind):
        try:
            count = covered(corners, shape)
        except InputError:  # crossed, or in no perspective
            continue
        u, v = np.moveaxis(unit_square(corners, *np.indices(shape)), 2, 0)
        depth = np.minimum.reduce([u, 1 - u, v, 1 - v])
        np.testing.assert_array_equal(count[depth > 1e-5], 1)
        assert count[depth < -1e-5].sum() == 0
        if kind != "random":
            np.testing.assert_array_equal(count[np.abs(depth) <= 1e-5], 1)
        tested += 1
    assert tested > 80
