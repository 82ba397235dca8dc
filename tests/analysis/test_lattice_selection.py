from __future__ import annotations

import numpy as np
import pytest

from tests.synthetic import difference, smooth_noise, tiled
from texloom.stages.analysis.lattice import Lattice
from texloom.stages.analysis.lattice_selection import LatticeSelectionParams, lattice_selection, most_confident

SQUARE, DOUBLE = (np.diag(sides).astype(np.float32) for sides in ((20.0, 20.0), (20.0, 40.0)))
NONE = np.zeros((0, 2), np.float32)

Given = tuple[np.ndarray, float, float]


def measured(best: np.ndarray, confidence: float, significance: float) -> Lattice:
    return Lattice(NONE, best, confidence, significance, 1.0)


@pytest.mark.parametrize(
    ("first", "second", "chosen"),
    [
        ((SQUARE, 0.6, 9.0), (DOUBLE, 0.5, 9.0), "features"),
        ((SQUARE, 0.5, 9.0), (DOUBLE, 0.6, 9.0), "autocorrelation"),
        ((DOUBLE, 0.6, 9.0), (SQUARE, 0.59, 9.0), "autocorrelation"),
        ((SQUARE, 0.59, 9.0), (DOUBLE, 0.6, 9.0), "features"),
        ((NONE, 0.0, 0.0), (SQUARE, 0.6, 9.0), "autocorrelation"),
        ((NONE, 0.0, 0.0), (NONE, 0.0, 0.0), "none"),
        # neither is sure, so the significant one, if there is one
        ((SQUARE, 0.3, 5.0), (DOUBLE, 0.2, 5.0), "none"),
        ((SQUARE, 0.3, 6.0), (DOUBLE, 0.2, 7.0), "autocorrelation"),
        ((SQUARE, 0.3, 6.0), (DOUBLE, 0.5, 2.5), "autocorrelation"),
        ((SQUARE, 0.3, 6.0), (DOUBLE, 0.5, 1.0), "features"),
        # of too few points to tell: only features that match are believed
        ((SQUARE, 0.5, -1.0), (DOUBLE, 0.1, -1.0), "features"),
        ((DOUBLE, 0.1, -1.0), (SQUARE, 0.5, -1.0), "none"),
        # of enough points, but no better than between them
        ((SQUARE, 0.5, 0.0), (DOUBLE, 0.1, 0.0), "none"),
        ((SQUARE, 0.4, 0.0), (DOUBLE, 0.5, 1.0), "none"),
    ],
)
def test_the_surer_lattice_is_taken(first: Given, second: Given, chosen: str) -> None:
    result = most_confident(
        {"features": measured(*first), "autocorrelation": measured(*second)}, LatticeSelectionParams()
    )
    assert result.chosen == chosen
    expected = {"features": first[0], "autocorrelation": second[0], "none": NONE}[chosen]
    np.testing.assert_array_equal(result.generators, expected)
    assert len(result.best) == (0 if not len(first[0]) + len(second[0]) else 2)
    if len(result.best):
        source = first if result.best is first[0] else second
        assert (result.confidence, result.significance) == source[1:]


def test_autocorrelation_finds_what_features_do_not(rng: np.random.Generator) -> None:
    exemplar, generators = tiled(smooth_noise((24, 30, 3), 4.0, rng), 0, (160, 170))
    nothing = np.zeros((161, 171), np.float32)
    result = lattice_selection(exemplar, nothing, LatticeSelectionParams())
    assert result.chosen == "autocorrelation"
    assert difference(result.generators, generators) < 0.5


def test_noise_has_none(rng: np.random.Generator) -> None:
    exemplar, _ = tiled(rng.random((160, 170, 3)), 0, (160, 170))
    result = lattice_selection(exemplar, np.zeros((161, 171), np.float32), LatticeSelectionParams())
    assert (result.chosen, len(result.generators)) == ("none", 0)
