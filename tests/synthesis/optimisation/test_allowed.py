"""Which patches masks leave."""

from __future__ import annotations

import numpy as np
import pytest

from texloom.stages.synthesis.optimisation.allowed import Allowed, shrunk


@pytest.mark.parametrize(("share", "expected"), [(0.5, [True, True, False]), (1.0, [True, False, False])])
def test_coarse_pixels_count_their_cover(share: float, expected: list[bool]) -> None:
    mask = np.array([[1, 1, 1, 0, 0, 0], [1, 1, 0, 1, 1, 0]], bool)
    assert shrunk(mask, 1, 3, share)[0].tolist() == expected
    assert shrunk(mask, 2, 6, share) is mask


def test_allowed_patches_hold_no_masked_pixel(rng: np.random.Generator) -> None:
    usable = rng.random((30, 26)) < 0.97
    allowed = Allowed(usable, 30, 26, 4)
    for row, column in np.ndindex(allowed.places.shape):
        assert allowed.places[row, column] == usable[row : row + 4, column : column + 4].all()
    assert allowed.share == allowed.places.mean()
    match = np.indices(allowed.places.shape).astype(np.int32)
    moved = allowed.moved(match)
    assert allowed.places[tuple(moved)].all()
    stays = allowed.places
    np.testing.assert_array_equal(moved[:, stays], match[:, stays])
