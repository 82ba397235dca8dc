from __future__ import annotations

import numpy as np
import pytest

from tests.kernels.patchmatch import naive
from tests.wraps import WRAPS, sides
from texloom.stages.synthesis.optimisation.vote import mean_vote, pad_torus, vote_pixels, window
from texloom.stages.vocabulary.facts import NOWHERE, TORUS, Wraps


@pytest.mark.parametrize("size", [3, 4, 10, 32])
def test_all_votes_are_alike_without_a_width(size: int) -> None:
    assert window(size).tolist() == [1] * size


@pytest.mark.parametrize("size", range(3, 33))
@pytest.mark.parametrize("sigma", [0.3, 1.3, 4.0, 100.0])
def test_votes_fall_off_evenly_and_fit_their_sums(size: int, sigma: float) -> None:
    weights = window(size, sigma)
    np.testing.assert_array_equal(weights, weights[::-1])
    assert weights.min() >= 1
    assert (np.diff(weights[: (size + 1) // 2]) >= 0).all()
    assert int(weights.sum()) ** 2 * 300 * 16 < 2**31  # strongest features, see `_features`


def test_weights_are_a_gaussian() -> None:
    weights = window(10, 1.3) / window(10, 1.3).max()
    expected = np.exp(-((np.arange(10) - 4.5) ** 2) / (2 * 1.3**2))
    np.testing.assert_allclose(weights, expected / expected.max(), atol=0.02)


@pytest.mark.parametrize("wrap", WRAPS)
@pytest.mark.parametrize(("size", "sigma"), [(3, None), (4, 1.3), (5, 2.0)])
def test_pixels_equal_twin(size: int, sigma: float | None, wrap: Wraps, rng: np.random.Generator) -> None:
    """Any number of planes, of any size."""
    pixels = (rng.normal(size=(9 + size, 8 + size, 5)) * [1, 10, 1000, 1e-3, 1e6]).astype(np.float32)
    match = np.stack([rng.integers(0, n + 1, (7, 6)) for n in (9, 8)]).astype(np.int32)
    weights = window(size, sigma)
    voted = vote_pixels(match, pixels, weights, wrap)
    expected = np.empty(voted.shape)
    for y, x in np.ndindex(voted.shape[:2]):
        ballot = naive.votes(match, size, wrap, y, x)
        share = np.array([weights[i] * weights[j] for i, j, _, _ in ballot], float)
        values = np.array([pixels[row, column] for _, _, row, column in ballot], float)
        expected[y, x] = share @ values / share.sum()
    assert voted.shape == (*sides((7, 6), size - 1, wrap), 5)
    np.testing.assert_allclose(voted / [1, 10, 1000, 1e-3, 1e6], expected / [1, 10, 1000, 1e-3, 1e6], atol=1e-5)


@pytest.mark.parametrize("wrap", WRAPS)
def test_channels_do_not_mix(wrap: Wraps, rng: np.random.Generator) -> None:
    """Voting planes together or one by one is the same, bit for bit."""
    pixels = rng.random((14, 15, 4), np.float32)
    match = np.stack([rng.integers(0, n, (12, 11)) for n in (10, 11)]).astype(np.int32)
    together = vote_pixels(match, pixels, window(5, 1.3), wrap)
    for plane in range(4):
        alone = vote_pixels(match, np.ascontiguousarray(pixels[..., plane : plane + 1]), window(5, 1.3), wrap)
        np.testing.assert_array_equal(together[..., plane], alone[..., 0])


def test_a_narrow_window_keeps_more_detail(rng: np.random.Generator) -> None:
    pixels = rng.random((40, 40, 1), np.float32)
    match = np.stack([rng.integers(0, 31, (30, 30)) for _ in "rc"]).astype(np.int32)
    spreads = [vote_pixels(match, pixels, window(10, sigma), NOWHERE).std() for sigma in (None, 3.0, 1.3, 0.6)]
    assert spreads == sorted(spreads)


@pytest.mark.parametrize("shape", [(5, 7), (12, 9)])
@pytest.mark.parametrize("wrap", WRAPS)
def test_what_wraps_is_padded_by_what_lies_beyond(
    shape: tuple[int, int], wrap: Wraps, rng: np.random.Generator
) -> None:
    target = rng.integers(0, 99, (shape[0], shape[1], 2)).astype(np.int16)
    size = (shape[0] + 3 * wrap.down, shape[1] + 3 * wrap.across)
    padded = pad_torus(target.reshape(shape[0], -1), 2, 4, wrap).reshape(*size, 2)
    row, column = np.indices(size)
    np.testing.assert_array_equal(padded, target[row % shape[0], column % shape[1]])


def test_a_torus_has_no_place_of_its_own(rng: np.random.Generator) -> None:
    """Turning the correspondence around turns the vote around."""
    exemplar = rng.integers(-900, 900, (14, 13)).astype(np.int16)
    match = np.stack([rng.integers(0, n, (12, 11)) for n in (11, 10)]).astype(np.int32)
    voted = mean_vote(match, exemplar, 1, 4, TORUS)[:12, :11]
    turned = mean_vote(np.ascontiguousarray(np.roll(match, (5, 3), (1, 2))), exemplar, 1, 4, TORUS)[:12, :11]
    np.testing.assert_array_equal(turned, np.roll(voted, (5, 3), (0, 1)))
