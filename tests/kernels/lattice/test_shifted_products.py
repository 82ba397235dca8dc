from __future__ import annotations

import numpy as np

from texloom.stages.kernels.lattice.shifted_products import shifted_products


def test_products_are_of_the_same_pixels_at_all_shifts(rng: np.random.Generator) -> None:
    plane = rng.random((9, 12)).astype(np.float32)
    rows, down, right = np.array([0, 2, 5, 8]), np.arange(1, 4), np.arange(-3, 2)
    sums = np.ones((3, 5, 3))
    shifted_products(plane, rows, down, right, sums)
    for p, q in np.ndindex(3, 5):
        own, other = (
            [plane[row + d, 3 + s : 11 + s].astype(float) for row in (0, 2, 5)]
            for d, s in ((0, 0), (down[p], right[q]))
        )
        expected = [np.vdot(own, other), np.vdot(own, own), np.vdot(other, other)]
        np.testing.assert_allclose(sums[p, q], expected, rtol=1e-6)
