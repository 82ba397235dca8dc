import numpy as np

from texloom.stages.kernels.compaction.coverage import missing_sums


def test_missing_sums_equal_those_of_a_minimum(rng: np.random.Generator) -> None:
    distances, missing = rng.uniform(0, 9, (7, 5)), rng.uniform(0, 9, 7)
    missing[2] = np.inf
    totals = np.full(5, np.nan)
    missing_sums(distances, missing, totals)
    np.testing.assert_allclose(totals, np.minimum(distances, missing[:, None]).sum(axis=0), rtol=1e-12)
