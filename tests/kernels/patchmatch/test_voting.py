"""The voting kernels against their twins, and properties of the votes that they make up."""

import numpy as np
import pytest

from tests.kernels.patchmatch import naive
from tests.kernels.patchmatch.conftest import CHANNELS, PLACES, SIZE, flat, outcomes
from tests.wraps import WRAPS, beyond, sides
from texloom.stages.common.similarity.neighbourhoods import fixed_point
from texloom.stages.kernels.patchmatch.voting import (
    Votes,
    find_runs,
    histogram_votes,
    round_votes,
    weighted_values,
)
from texloom.stages.synthesis.optimisation.vote import (
    HistogramVote,
    mean_vote,
    run_shares,
    vote_pixels,
    window,
)
from texloom.stages.vocabulary.facts import NOWHERE, TORUS, Wraps

KINDS = [(1, 3), (3, 3), (4, 4), (5, 5)]
"""patch size and channels"""


def random_vote(size: int, channels: int, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """A correspondence of 6 x 7 patches, with some runs, and an exemplar of (h, w, c) int16."""
    places = (5, 6)
    exemplar = rng.integers(-4000, 4001, (5 + size - 1, 6 + size - 1, channels)).astype(np.int16)
    match = np.stack([rng.integers(0, n, (6, 7)) for n in places]).astype(np.int32)
    match[:, 1:4, 2:6] = match[:, 1:4, :1]
    match[1, 1:4, 2:6] = np.arange(4)
    return match, exemplar


@pytest.mark.parametrize("wrap", WRAPS)
@pytest.mark.parametrize("sigma", [None, 1.3])
@pytest.mark.parametrize(("size", "channels"), KINDS)
def test_mean_vote_equals_exact_fractions(
    size: int, channels: int, sigma: float | None, wrap: Wraps, rng: np.random.Generator
) -> None:
    match, exemplar = random_vote(size, channels, rng)
    weights = window(size, sigma)
    expected = naive.mean_vote(match, exemplar, weights, wrap)
    if sigma is None:
        whole = naive.rounded(expected)
        whole = np.pad(whole, [*beyond(size - 1, wrap), (0, 0)], mode="wrap")
        target = mean_vote(match, flat(exemplar), channels, size, wrap)
        np.testing.assert_array_equal(target, whole.reshape(whole.shape[0], -1))

    pixels = vote_pixels(match, exemplar.astype(np.float32), weights, wrap)
    np.testing.assert_allclose(pixels, expected.astype(np.float64), rtol=1e-5, atol=0.01)


@pytest.mark.parametrize("wrap", WRAPS)
def test_runs_of_patches_vote_as_each_by_itself(wrap: Wraps, rng: np.random.Generator) -> None:
    """Runs of all lengths, some longer than those that are added at once, and one above the other."""
    exemplar = rng.integers(-4000, 4001, (20, 150, 2)).astype(np.int16)
    lengths = [1, 2, 3, 5, 4, 100, 1, 7]
    line = np.concatenate([np.arange(length) + rng.integers(0, 40) for length in lengths])
    match = np.stack([np.full((9, line.size), 3), np.tile(line, (9, 1))]).astype(np.int32)
    match[0, :3] += rng.integers(0, 5, (3, 1), np.int32)
    match[0, 3:] += np.arange(6, dtype=np.int32)[:, None]
    match[0, :, line.size // 2] += 1
    expected = vote_pixels(match, exemplar.astype(np.float32), window(SIZE), wrap)
    voted = mean_vote(match, flat(exemplar), 2, SIZE, wrap)
    voted = voted.reshape(voted.shape[0], -1, 2)[: expected.shape[0], : expected.shape[1]]
    np.testing.assert_allclose(voted, expected, atol=0.51)


@pytest.mark.parametrize("wrap", WRAPS)
@pytest.mark.parametrize("sigma", [None, 1.3])
def test_sums_do_not_depend_on_where_rows_are_cut(
    wrap: Wraps, sigma: float | None, rng: np.random.Generator, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Equal runs lie above one another across every cut, and overlap others that begin and end elsewhere."""
    pixels = rng.random((50, 60, 2), np.float32)
    match = np.indices((40, 40), np.int32)
    for _ in range(60):
        y, x = rng.integers(0, 36, 2)
        height, width = rng.integers(1, 16, 2)
        part = match[:, y : y + height, x : x + width]
        part[:] = np.indices(part.shape[1:]) + rng.integers(0, (30, 40))[:, None, None]
    voted = {}
    for rows in (2, 7, 100):
        monkeypatch.setattr("texloom.stages.vocabulary.scratch._MIN_ROWS", rows)
        voted[rows] = vote_pixels(match, pixels, window(SIZE, sigma), wrap)
    np.testing.assert_array_equal(voted[2], voted[100])
    np.testing.assert_array_equal(voted[7], voted[100])


def test_votes_are_rounded_half_up() -> None:
    sums = np.arange(-6, 7, dtype=np.float32)[None]
    target = np.empty((1, 13), np.int16)
    round_votes(sums, np.full(13, 2.0), np.ones(1), target, 0, 1)
    assert target[0].tolist() == [-3, -2, -2, -1, -1, 0, 0, 1, 1, 2, 2, 3, 3]


@pytest.mark.parametrize("weight", [1, 7, 100, 1024])
def test_rounding_is_exact(weight: int, rng: np.random.Generator) -> None:
    """Beside halves and whole numbers, up to the largest sums."""
    beside = weight // 2 * np.arange(3)[:, None] + np.arange(-1, 2)
    near = rng.integers(-4800, 4800, 500)[:, None] * weight + beside.ravel()
    sums = near.reshape(1, -1).astype(np.float32)
    target = np.zeros(sums.shape, np.int16)
    round_votes(sums, np.full(sums.size, float(weight)), np.ones(1), target, 0, 1)
    exact = (2 * sums.astype(np.int64) + weight) // (2 * weight)
    np.testing.assert_array_equal(target, exact)


@pytest.mark.parametrize("wrap", WRAPS)
@pytest.mark.parametrize(("size", "channels"), KINDS)
def test_histogram_vote_equals_twin(size: int, channels: int, wrap: Wraps, rng: np.random.Generator) -> None:
    match, exemplar = random_vote(size, channels, rng)
    bins = rng.integers(0, 10, exemplar.shape).astype(np.uint8)
    excess = np.maximum(0, rng.normal(0, 20, (channels, 10))).astype(np.float32)
    height, width = sides((6, 7), size - 1, wrap)
    rows = rng.permutation(height)[: height // 2]
    before = rng.integers(-4000, 4001, (height, width * channels)).astype(np.int16)
    target = before.copy()
    table = np.empty((exemplar.shape[0], exemplar.shape[1] * (channels + 1)), np.float32)
    filled, number = np.ones(exemplar.shape[:2], np.uint8), np.uint8(2)
    votes = Votes(*match, table, channels + 1, size, wrap)
    lows, widths = np.full(channels, -4000, np.float32), np.full(channels, 800, np.float32)
    change, shares = np.zeros((channels, 10), np.int64), run_shares(window(size), channels + 1)
    runs = find_runs(*match, size, wrap, len(shares), 0, height)
    weighted_values(
        flat(exemplar), flat(bins), excess, *runs, rows, size, filled, number, table, 0, exemplar.shape[0]
    )
    histogram_votes(
        votes, shares, *runs, lows, widths, rows, np.array([len(rows)]), target, change, np.zeros(change.shape),
        flat(exemplar), flat(bins), filled, True,
    )  # fmt: skip
    for c in range(channels):
        counts = [np.histogram(t[:, c::channels], 10, (-4000, 4000))[0] for t in (before, target)]
        np.testing.assert_array_equal(change[c], counts[1] - counts[0])
    planes = target.reshape(height, width, channels)
    for y, x in np.ndindex(height, width):
        if y in rows:
            expected = naive.histogram_vote(match, exemplar, bins, excess, size, wrap, y, x)
            assert np.abs(planes[y, x] - expected).max() <= 0.51  # rounded, from single precision
        else:
            assert (planes[y, x] == before.reshape(planes.shape)[y, x]).all()


@pytest.mark.parametrize("size", [1, 3, 4])
def test_values_are_weighted_of_pixels_that_patches_vote_for(size: int) -> None:
    match, exemplar = random_vote(size, 3, np.random.default_rng(size))
    expected = np.zeros(exemplar.shape[:2], bool)
    for row, column in match.reshape(2, -1).T:
        expected[row : row + size, column : column + size] = True
    height = match.shape[1] + size - 1
    runs = find_runs(*match, size, NOWHERE, 4, 0, height)
    filled, table = np.zeros(expected.shape, np.uint8), np.full(flat(np.zeros((*expected.shape, 4))).shape, np.nan)
    table, excess = table.astype(np.float32), np.zeros((3, 10), np.float32)
    bins, middle = np.zeros(flat(exemplar).shape, np.uint8), exemplar.shape[0] // 2
    for first, last in ((0, middle), (middle, exemplar.shape[0])):  # as two threads do
        weighted_values(
            flat(exemplar), bins, excess, *runs, np.arange(height), size, filled, np.uint8(1), table, first, last
        )
    np.testing.assert_array_equal(filled == 1, expected)
    table = table.reshape(*expected.shape, 4)
    np.testing.assert_array_equal(
        table[expected], np.pad(exemplar, [(0, 0), (0, 0), (0, 1)], constant_values=1)[expected]
    )
    assert np.isnan(table[~expected]).all()


@pytest.mark.parametrize("wrap", WRAPS)
def test_votes_are_the_same_for_any_number_of_threads(
    exemplar: np.ndarray, match: np.ndarray, wrap: Wraps, monkeypatch: pytest.MonkeyPatch
) -> None:
    features, light = flat(exemplar), np.exp(exemplar / 1000).astype(np.float32)
    target = mean_vote(match, features, CHANNELS, SIZE, wrap)
    vote = HistogramVote(features, SIZE, wrap, np.full(3, -100.0), np.full(3, 100.0))
    for step in (
        lambda: mean_vote(match, features, CHANNELS, SIZE, wrap),
        lambda: vote_pixels(match, light, window(SIZE, 1.3), wrap),
        lambda: vote(match, target, np.random.default_rng(1)),
    ):
        one, two = outcomes(monkeypatch, step)
        assert one.dtype == two.dtype
        np.testing.assert_array_equal(one, two)
    whole = vote(match, target, np.random.default_rng(1))
    monkeypatch.setattr("texloom.stages.synthesis.optimisation.vote._PIECE", 8)  # px
    np.testing.assert_array_equal(vote(match, target, np.random.default_rng(1)), whole)


@pytest.mark.parametrize("wrap", WRAPS)
@pytest.mark.parametrize("sigma", [None, 1.3])
def test_identity_votes_for_the_exemplar_itself(exemplar: np.ndarray, wrap: Wraps, sigma: float | None) -> None:
    if wrap.down:  # what wraps and its margin are their own exemplar
        exemplar = exemplar[: PLACES[0]]
    if wrap.across:
        exemplar = exemplar[:, : exemplar.shape[1] - SIZE + 1]
    whole = exemplar.shape[:2]
    exemplar = np.pad(exemplar, [*beyond(SIZE - 1, wrap), (0, 0)], mode="wrap")
    patches = (exemplar.shape[0] - SIZE + 1, exemplar.shape[1] - SIZE + 1)
    identity = np.indices(patches, np.int32)
    features, weights = flat(exemplar), window(SIZE, sigma)
    np.testing.assert_array_equal(mean_vote(identity, features, CHANNELS, SIZE, wrap), features)
    light = np.exp(exemplar / 1000).astype(np.float32)
    inside = light[: whole[0], : whole[1]]
    np.testing.assert_allclose(vote_pixels(identity, light, weights, wrap), inside, rtol=1e-5)
    vote = HistogramVote(features, SIZE, wrap, np.full(3, -100.0), np.full(3, 100.0))
    np.testing.assert_array_equal(vote(identity, np.zeros_like(features), np.random.default_rng(1)), features)


def histogram_difference(target: np.ndarray, exemplar: np.ndarray) -> float:
    """Share of pixels in the wrong bin, of 20 bins, summed over channels."""
    total = 0.0
    for c in range(CHANNELS):
        one, other = (np.histogram(p.reshape(-1, CHANNELS)[:, c], 20, (-1600, 1600))[0] for p in (target, exemplar))
        total += float(np.abs(one / one.sum() - other / other.sum()).sum()) / 2
    return total


@pytest.mark.parametrize("wrap", WRAPS)
def test_histogram_vote_is_nearer_to_the_exemplar_than_the_mean(wrap: Wraps, rng: np.random.Generator) -> None:
    exemplar = (np.kron(rng.random((12, 12, CHANNELS)) ** 2, np.ones((3, 3, 1))) * 3000 - 1500).astype(np.int16)
    places = (34, 34)
    match = np.stack([rng.integers(0, n, (40, 40)) for n in places]).astype(np.int32)
    mean = mean_vote(match, flat(exemplar), CHANNELS, SIZE, wrap)
    vote = HistogramVote(flat(exemplar), SIZE, wrap, np.full(3, -100.0), np.full(3, 100.0))
    before = mean.copy()
    voted = vote(match, mean, np.random.default_rng(1))
    assert voted.shape == mean.shape
    np.testing.assert_array_equal(mean, before)
    assert histogram_difference(voted, exemplar) < 0.8 * histogram_difference(mean, exemplar)


def test_histogram_vote_stops_avoiding_a_colour_once_it_is_rare(rng: np.random.Generator) -> None:
    """Half of the exemplar is black and the target is all black before the vote; half of it should stay so."""
    exemplar = np.zeros((30, 30, CHANNELS), np.int16)
    exemplar[:, 15:] = 1600
    exemplar += rng.integers(0, 16, exemplar.shape).astype(np.int16)
    match = rng.integers(0, 28, (2, 60, 60)).astype(np.int32)
    vote = HistogramVote(flat(exemplar), SIZE, TORUS, np.full(3, 0.0), np.full(3, 110.0))
    black = np.zeros((62, 62 * CHANNELS), np.int16)
    voted = vote(match, black, np.random.default_rng(1))[:60, : 60 * CHANNELS]
    assert 0.2 < (voted < 800).mean() < 0.8


@pytest.mark.parametrize("value", [1e9, -1e9])
def test_the_largest_features_survive_voting(value: float) -> None:
    features = fixed_point(np.full((40, 40, 1), value, np.float32))
    voted = mean_vote(np.indices((9, 9), np.int32), features, 1, 32, NOWHERE)
    np.testing.assert_array_equal(voted, features)


def test_histograms_count_usable_pixels_only(exemplar: np.ndarray, rng: np.random.Generator) -> None:
    usable = rng.random(exemplar.shape[:2]) < 0.8
    ranges = (np.full(CHANNELS, -300.0), np.full(CHANNELS, 300.0))
    found = HistogramVote(flat(exemplar), SIZE, NOWHERE, *ranges, usable)
    assert (found.histogram.sum(axis=1) == usable.sum()).all()
    other = np.where(usable[..., None], exemplar, 0).astype(np.int16)
    again = HistogramVote(flat(other), SIZE, NOWHERE, *ranges, usable)
    np.testing.assert_array_equal(again.histogram, found.histogram)
    everything = HistogramVote(flat(exemplar), SIZE, NOWHERE, *ranges)
    assert (everything.histogram.sum(axis=1) == usable.size).all()
