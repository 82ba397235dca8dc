import numpy as np
import pytest

from tests.kernels.distortion import naive
from texloom.stages.kernels.distortion.patch_coverage import cover


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


@pytest.mark.parametrize("size", [(16, 16), (16, 80), (48, 64), (160, 96)])
def test_pixels_on_borders_of_cells_count_once(size: tuple[int, int]) -> None:
    rows, columns = np.meshgrid(np.linspace(3, 3 + size[0], 4), np.linspace(5, 5 + size[1], 4), indexing="ij")
    controls = np.stack([rows, columns, np.ones((4, 4))], axis=2)
    shape = size[0] + 10, size[1] + 12
    total, count, place = np.zeros((*shape, 4)), np.zeros(shape, np.int32), np.zeros((*shape, 2))
    cover(controls, controls, np.ones(2), 16, total, count, place, 0, shape[0])
    expected = np.zeros(shape, np.int32)
    expected[3 : 4 + size[0], 5 : 6 + size[1]] = 1
    np.testing.assert_array_equal(count, expected)
