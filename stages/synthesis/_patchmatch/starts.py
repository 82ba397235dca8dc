"""The choice between results of the coarse scales, of which one is continued."""

from collections.abc import Sequence

import numpy as np

from texloom.stages.arrays import Image
from texloom.stages.color import lab_from_linear
from texloom.stages.common.repetition import repetition

_QUANTILES = np.linspace(0.005, 0.995, 100)
_LEAST_REPETITION = 0.05  # that is visible
_LEAST_DISTANCE = 0.01  # of colours that differ, as a share of their deviation


def best_start(exemplar: Image, results: Sequence[Image]) -> int:
    """Number of the result that repeats itself least and whose colours are most like the exemplar's.

    Both change little at finer scales. The product of both is compared, so that one counts as much as the other.
    """
    own = lab_from_linear(exemplar.color)
    spread = max(float(own.std(axis=(0, 1)).mean()), 1e-3)
    costs = []
    for result in results:
        lab = lab_from_linear(result.color)
        apart = np.abs(_quantiles(lab) - _quantiles(own)).mean() / spread
        repeated, _ = repetition(own[..., 0], lab[..., 0])
        costs.append(round((repeated + _LEAST_REPETITION) * float(apart + _LEAST_DISTANCE), 6))
    return int(np.argmin(costs))


def _quantiles(lab: np.ndarray) -> np.ndarray:
    return np.asarray(np.quantile(lab.reshape(-1, 3), _QUANTILES, axis=0))
