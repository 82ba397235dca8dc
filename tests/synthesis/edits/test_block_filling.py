"""Blocks that cover a picture: in which order, whatever is counted for it."""

from __future__ import annotations

import numpy as np
import pytest

from tests.wraps import X
from texloom.stages.synthesis.edits.block_filling import BlockFilling
from texloom.stages.vocabulary.facts import NOWHERE, TORUS, Wraps


def counted(filled: np.ndarray, block: int, wrap: Wraps) -> np.ndarray:
    """Filled pixels of the block that has each pixel in its middle, by its definition."""
    margins = (block // 2, block - 1 - block // 2)
    padded = filled
    for axis, around in enumerate(wrap):
        sides = [margins if axis == one else (0, 0) for one in range(2)]
        padded = np.pad(padded, sides, mode="wrap" if around else "constant")
    return np.lib.stride_tricks.sliding_window_view(padded, (block, block)).sum((2, 3))


@pytest.mark.parametrize("block", [7, 8])
@pytest.mark.parametrize("shape", [(33, 40), (9, 40)])  # of the second, blocks meet themselves around the torus
@pytest.mark.parametrize("wrap", [NOWHERE, X, TORUS])
def test_filled_pixels_are_counted_around_every_pixel(
    wrap: Wraps, shape: tuple[int, int], block: int, rng: np.random.Generator
) -> None:
    features = rng.random((24, 30, 3)).astype(np.float32)
    keep = rng.random(shape) < 0.1
    match = rng.integers(0, 24, (*shape, 2)).astype(np.int32)
    filling = BlockFilling(features, match, keep, keep, np.ones((24, 30), bool), block, wrap)
    np.testing.assert_array_equal(filling.around, counted(keep, block, wrap))
    while not filling.filled.all():
        filling._lay(*filling._next())
        np.testing.assert_array_equal(filling.around, counted(filling.filled, block, wrap))
