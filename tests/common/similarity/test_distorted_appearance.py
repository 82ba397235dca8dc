"""One level of a distorted exemplar."""

from __future__ import annotations

import numpy as np
import pytest

from tests.synthetic import smooth_noise
from texloom.stages.common.similarity import distorted_appearance


def test_others_of_many_places_are_found_at_every_second(
    rng: np.random.Generator, monkeypatch: pytest.MonkeyPatch
) -> None:
    """What they are compared by stays the same; those that follow are alike too."""
    planes = smooth_noise((72, 80, 3), 3.0, rng).astype(np.float32)
    known = np.ones(planes.shape[:2], bool)
    jacobian = np.zeros((*known.shape, 4), np.float32)
    jacobian[..., [0, 3]] = 1
    results = []
    for many in (2**18, 0):
        monkeypatch.setattr(distorted_appearance, "_MAX_DENSE", many)
        appearance, candidates = np.zeros((*known.shape, 8), np.int16), np.zeros((*known.shape, 2), np.int32)
        result = distorted_appearance.analyse(planes, known, known, 0, jacobian, 6, None, appearance, candidates)
        assert result is not None
        results.append((appearance, result[0], candidates))
    (appearance, basis, every), (same, same_basis, second) = results
    np.testing.assert_array_equal(appearance, same)
    np.testing.assert_array_equal(basis, same_basis)
    middle = np.s_[8:-8, 8:-8]
    np.testing.assert_array_equal(every[..., 0][middle], second[..., 0][middle])
    flat = appearance.reshape(-1, 8).astype(np.float64)
    chance = rng.integers(0, known.size, known.shape)
    of_every, of_second, by_chance = (
        float(((appearance - flat[others]) ** 2)[middle].sum())
        for others in (every[..., 1], second[..., 1], chance)
    )
    assert of_every != of_second
    assert max(of_every, of_second) < 0.3 * by_chance
    assert of_second < 1.5 * of_every
