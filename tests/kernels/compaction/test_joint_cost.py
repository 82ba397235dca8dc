import numpy as np

from tests.kernels.compaction import naive
from texloom.stages.kernels.compaction.joint_cost import weighted_differences


def test_weighted_differences_equal_twin(rng: np.random.Generator) -> None:
    planes, pixels = (rng.integers(-400, 400, (*shape, 2)).astype(np.float32) for shape in ((16, 18), (4, 5)))
    pieces = np.stack([rng.integers(0, side, (6, 4, 5)) for side in (16, 18)], axis=1).astype(np.int32)
    weights = rng.uniform(0, 1, (4, 5)) * (rng.random((4, 5)) < 0.6)
    pixels[weights == 0] = np.nan  # not read
    totals = np.empty(6)
    weighted_differences(planes, pieces, pixels, weights, totals)
    expected = [naive.weighted_difference(planes, piece, np.nan_to_num(pixels), weights) for piece in pieces]
    np.testing.assert_allclose(totals, expected, rtol=1e-12)
