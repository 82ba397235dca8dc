"""The choice between results of the coarse scales, of which one is continued."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from texloom.stages.common.regularity.excess_repetition import repetition
from texloom.stages.vocabulary.arrays import Image
from texloom.stages.vocabulary.color import lab_from_linear

_QUANTILES = np.linspace(0.005, 0.995, 100)
_LEAST_REPETITION = 0.05  # that is visible
_LEAST_DISTANCE = 0.01  # of colours that differ, as a share of their deviation
_LEAST_ENERGY = 0.001  # CIELAB units squared


def best_start(exemplar: Image, results: Sequence[Image], records: Sequence[Mapping[str, Any]]) -> int:
    """Number of the result of least repetition, distance of its colours to the exemplar's, energy and penalty.

    Each tells of the finished result: of its repetition, distribution of patches, coherence and completeness. Their
    product is compared, so that all count alike.

    Parameters
    ----------
    records : of the scale, for each result; see `improve`.
    """
    own = lab_from_linear(exemplar.color)
    spread = max(float(own.std(axis=(0, 1)).mean()), 1e-3)
    costs = []
    for result, record in zip(results, records, strict=True):
        lab = lab_from_linear(result.color)
        apart = np.abs(_quantiles(lab) - _quantiles(own)).mean() / spread
        repeated, _ = repetition(own[..., 0], lab[..., 0], cells=False)  # with them, results were no better
        penalised = (record["energy"] + _LEAST_ENERGY) * (record["price"] + _LEAST_ENERGY)
        costs.append(round((repeated + _LEAST_REPETITION) * float(apart + _LEAST_DISTANCE) * penalised, 6))
    return int(np.argmin(costs))


def _quantiles(lab: np.ndarray) -> np.ndarray:
    return np.asarray(np.quantile(lab.reshape(-1, 3), _QUANTILES, axis=0))
