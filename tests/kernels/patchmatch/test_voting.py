"""The voting kernels against their twins."""

from __future__ import annotations

import numpy as np
import pytest

from tests.kernels.patchmatch import naive
from texloom.stages.kernels.patchmatch.voting import Votes, histogram_vote, round_votes
from texloom.stages.synthesis._patchmatch.vote import mean_vote, vote_pixels, window

KINDS = [(1, 3), (3, 3), (4, 4), (5, 5)]
"""patch size and channels"""


def random_vote(size: int, channels: int, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """A correspondence of 6 x 7 patches and an exemplar of (h, w, c) int16."""
    places = (5, 6)
    exemplar = rng.integers(-4000, 4001, (5 + size - 1, 6 + size - 1, channels)).astype(np.int16)
    return np.stack([rng.integers(0, n, (6, 7)) for n in places]).astype(np.int32), exemplar


@pytest.mark.parametrize("wrap", [False, True])
@pytest.mark.parametrize("sigma", [None, 1.3])
@pytest.mark.parametrize(("size", "channels"), KINDS)
def test_mean_vote_equals_exact_fractions(
    size: int, channels: int, sigma: float | None, wrap: bool, rng: np.random.Generator
) -> None:
    match, exemplar = random_vote(size, channels, rng)
    weights = window(size, sigma)
    expected = naive.mean_vote(match, exemplar, weights, wrap)
    whole = naive.rounded(expected)
    if wrap:
        whole = np.pad(whole, ((0, size - 1), (0, size - 1), (0, 0)), mode="wrap")
    target = mean_vote(match, exemplar.reshape(exemplar.shape[0], -1), channels, weights, wrap)
    np.testing.assert_array_equal(target, whole.reshape(whole.shape[0], -1))

    pixels = vote_pixels(match, exemplar.astype(np.float32), weights, wrap)
    np.testing.assert_allclose(pixels, expected.astype(np.float64), rtol=1e-5, atol=0.01)


def test_votes_are_rounded_half_up() -> None:
    sums = np.array([[-6, -5, -4, -3, -2, -1, 0, 1, 2, 3, 4, 5, 6]], np.int32)
    target = np.empty((1, 13), np.int16)
    round_votes(sums, np.full(13, 2), np.ones(1, np.int64), 1, target, 0, 1)
    assert target[0].tolist() == [-3, -2, -2, -1, -1, 0, 0, 1, 1, 2, 2, 3, 3]


@pytest.mark.parametrize("wrap", [False, True])
@pytest.mark.parametrize(("size", "channels"), KINDS)
def test_histogram_vote_equals_twin(size: int, channels: int, wrap: bool, rng: np.random.Generator) -> None:
    match, exemplar = random_vote(size, channels, rng)
    bins = rng.integers(0, 10, exemplar.shape).astype(np.uint8)
    excess = np.maximum(0, rng.normal(0, 20, (channels, 10))).astype(np.float32)
    extra = 0 if wrap else size - 1
    height, width = 6 + extra, 7 + extra
    pixels = rng.permutation(height * width)[: height * width // 2]
    target = np.full((height, width * channels), 32000, np.int16)
    flat = (array.reshape(array.shape[0], -1) for array in (exemplar, bins))
    votes = Votes(*match, next(flat), channels, size, wrap)
    histogram_vote(votes, next(flat), excess, pixels, width, target)
    planes = target.reshape(height, width, channels)
    for y, x in np.ndindex(height, width):
        if y * width + x in pixels:
            expected = naive.histogram_vote(match, exemplar, bins, excess, size, wrap, y, x)
            assert np.abs(planes[y, x] - expected).max() <= 0.51  # rounded, from single precision
        else:
            assert (planes[y, x] == 32000).all()
