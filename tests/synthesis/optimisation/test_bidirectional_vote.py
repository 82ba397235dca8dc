"""The vote of bidirectional similarity against its formula, term by term."""

import numpy as np
import pytest

from tests.wraps import WRAPS, sides
from texloom.stages.synthesis.optimisation.bidirectional_vote import bidirectional_vote
from texloom.stages.synthesis.optimisation.vote import vote_pixels, window
from texloom.stages.vocabulary.facts import NOWHERE, Wraps

PATCHES, PLACES, SIZE, CHANNELS = (9, 7), (6, 8), 4, 3
"""target patches, exemplar patches, side of a patch"""


def direct(
    match: np.ndarray,
    reverse: np.ndarray,
    pixels: np.ndarray,
    weights: np.ndarray,
    completeness: float,
    allowed: np.ndarray | None,
    wrap: Wraps,
) -> np.ndarray:
    """Simakov et al.: every patch of either kind adds its pixels, by the weight of its term over its number."""
    height, width = sides(PATCHES, SIZE - 1, wrap)
    sums, total = np.zeros((height, width, CHANNELS)), np.zeros((height, width, 1))
    pairs = [((1 - completeness) / match[0].size, at, tuple(match[:, *at])) for at in np.ndindex(match.shape[1:])]
    voters = [place for place in np.ndindex(PLACES) if allowed is None or allowed[place]]
    pairs += [(completeness / len(voters), tuple(reverse[:, *place]), place) for place in voters]
    for weight, at, place in pairs:
        for i, j in np.ndindex(SIZE, SIZE):
            to = (at[0] + i) % height, (at[1] + j) % width
            own = weight * weights[i] * weights[j]
            sums[to] += own * pixels[place[0] + i, place[1] + j]
            total[to] += own
    return sums / total


def vote(
    rng: np.random.Generator, wrap: Wraps, completeness: float, sigma: float | None, masked: bool
) -> tuple[np.ndarray, np.ndarray]:
    """What is made, and what is expected."""
    match = np.stack([rng.integers(0, count, PATCHES) for count in PLACES]).astype(np.int32)
    reverse = np.stack([rng.integers(0, count, PLACES) for count in PATCHES]).astype(np.int32)
    pixels = rng.random((PLACES[0] + SIZE - 1, PLACES[1] + SIZE - 1, CHANNELS), np.float32)
    allowed = rng.random(PLACES) < 0.5 if masked else None
    weights = window(SIZE, sigma)
    made = bidirectional_vote(match, reverse, pixels, weights, completeness, allowed, wrap)
    return made, direct(match, reverse, pixels, weights, completeness, allowed, wrap)


@pytest.mark.parametrize("wrap", WRAPS)
@pytest.mark.parametrize(("sigma", "masked"), [(None, False), (1.0, True)])
@pytest.mark.parametrize("completeness", [0.0, 0.3, 0.5])
def test_a_vote_is_the_mean_of_both_terms(
    rng: np.random.Generator, wrap: Wraps, completeness: float, sigma: float | None, masked: bool
) -> None:
    made, expected = vote(rng, wrap, completeness, sigma, masked)
    np.testing.assert_allclose(made, expected, rtol=1e-5)


def test_the_vote_minimises_the_dissimilarity(rng: np.random.Generator) -> None:
    """No small change lowers the weighted sum of both terms."""
    match = np.stack([rng.integers(0, count, PATCHES) for count in PLACES]).astype(np.int32)
    reverse = np.stack([rng.integers(0, count, PLACES) for count in PATCHES]).astype(np.int32)
    pixels = rng.random((PLACES[0] + SIZE - 1, PLACES[1] + SIZE - 1, CHANNELS), np.float32)

    def dissimilarity(target: np.ndarray) -> float:
        def between(at: tuple[int, ...], place: tuple[int, ...]) -> float:
            own = target[at[0] : at[0] + SIZE, at[1] : at[1] + SIZE]
            other = pixels[place[0] : place[0] + SIZE, place[1] : place[1] + SIZE]
            return float(((own - other) ** 2).sum())

        coherence = np.mean([between(at, tuple(match[:, *at])) for at in np.ndindex(PATCHES)])
        completeness = np.mean([between(tuple(reverse[:, *place]), place) for place in np.ndindex(PLACES)])
        return float(0.5 * coherence + 0.5 * completeness)

    best = bidirectional_vote(match, reverse, pixels, window(SIZE), 0.5, None, NOWHERE).astype(np.float64)
    least = dissimilarity(best)
    for _ in range(20):
        assert dissimilarity(best + rng.normal(0, 0.01, best.shape)) > least


def test_without_completeness_it_is_the_plain_vote(rng: np.random.Generator) -> None:
    match = np.stack([rng.integers(0, count, PATCHES) for count in PLACES]).astype(np.int32)
    reverse = np.zeros((2, *PLACES), np.int32)
    pixels = rng.random((PLACES[0] + SIZE - 1, PLACES[1] + SIZE - 1, CHANNELS), np.float32)
    made = bidirectional_vote(match, reverse, pixels, window(SIZE), 0.0, None, NOWHERE)
    np.testing.assert_array_equal(made, vote_pixels(match, pixels, window(SIZE), NOWHERE))
