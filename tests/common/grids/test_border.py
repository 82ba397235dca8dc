import numpy as np

from tests.synthetic import identity
from texloom.stages.common.grids.border import Border


def test_every_pixel_is_the_middle_of_a_patch() -> None:
    """Of even and odd sides."""
    plane = np.arange(7 * 9, dtype=np.float32).reshape(7, 9)
    for size in (1, 4, 5):
        border = Border(size)
        wide = border.around(plane)
        patches = np.lib.stride_tricks.sliding_window_view(wide, (size, size))
        np.testing.assert_array_equal(patches[..., size // 2, size // 2], plane)
        np.testing.assert_array_equal(border.inside(wide, 7, 9), plane)
        mirrored = np.pad(plane, (border.before, size - 1 - border.before), mode="symmetric")
        np.testing.assert_array_equal(wide, mirrored)


def test_sources_name_the_same_pixels() -> None:
    plane = np.random.default_rng(1).random((7, 9, 3), dtype=np.float32)
    border, match = Border(5), identity((7, 9))
    moved = border.moved(match)
    np.testing.assert_array_equal(border.around(plane)[moved[..., 0], moved[..., 1]], plane)
    border.move_back(moved)
    np.testing.assert_array_equal(moved, match)
