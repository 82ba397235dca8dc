from __future__ import annotations

import numpy as np
import pytest

from texloom.stages.synthesis.stitching.cuts import Strips
from texloom.stages.synthesis.stitching.patchwork import (
    PatchworkParams,
    chessboard,
    dilation_order,
    feather,
    patch_and_overlap,
)


@pytest.mark.parametrize(
    ("shape", "expected"),
    [
        ((192, 256), ((32, 32), 7)),
        ((512, 600), ((128, 128), 26)),
        ((2000, 1023), ((128, 128), 26)),
        ((46, 46), ((32, 32), 7)),
        ((16, 99), ((8, 8), 3)),
    ],
)
def test_patches_suit_their_exemplar(shape: tuple[int, int], expected: tuple[tuple[int, int], int]) -> None:
    assert patch_and_overlap(shape, PatchworkParams()) == expected


def test_the_feather_falls_evenly_with_the_steps_from_the_cell() -> None:
    weights = feather(chessboard((7, 8), Strips(top=3, left=0, bottom=0, right=3)), 3)
    np.testing.assert_allclose(weights[3:, :5], 1)
    np.testing.assert_allclose(weights[:3, 0], [0.25, 0.5, 0.75])
    np.testing.assert_allclose(weights[5, 5:], [0.75, 0.5, 0.25])
    np.testing.assert_allclose(np.diag(weights[:3, 7:4:-1]), [0.25, 0.5, 0.75])
    assert weights[2, 7] == weights[0, 5] == np.float32(0.25)


def test_a_wide_overlap_is_blended_around_its_middle() -> None:
    line = feather(chessboard((1, 60), Strips(left=40)), 40)[0]
    np.testing.assert_array_equal(line[40:], 1)
    np.testing.assert_array_equal(line[:12], 0)
    np.testing.assert_array_equal(line[28:40], 1)
    np.testing.assert_allclose(np.diff(line[12:28]), 1 / 16)
    assert line[19] < 0.5 < line[20]


def test_rejected_pixels_are_in_the_order_of_dilation() -> None:
    kept = np.zeros((5, 6), bool)
    kept[:, :2] = True
    rejected = ~kept
    rejected[2, 3] = False  # neither kept nor rejected: dilation goes around it
    order = dilation_order(kept, rejected)
    assert len(order) == rejected.sum() == len(np.unique(order, axis=0))
    assert rejected[tuple(order.T)].all()
    assert order[:5].tolist() == [[row, 2] for row in range(5)]
    assert order[5:9].tolist() == [[row, 3] for row in (0, 1, 3, 4)]
    assert order[-1].tolist() == [2, 5]


def test_pixels_that_dilation_does_not_reach_are_last() -> None:
    kept, rejected = np.zeros((2, 3, 6), bool)
    kept[1, 0] = rejected[1, 1] = rejected[0, 5] = rejected[1, 5] = True
    assert dilation_order(kept, rejected).tolist() == [[1, 1], [0, 5], [1, 5]]
    assert dilation_order(kept, np.zeros_like(rejected)).shape == (0, 2)
