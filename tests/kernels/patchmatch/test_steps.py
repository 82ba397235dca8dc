"""The search and voting steps that the kernels make up: properties, and one result for any number of threads."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from tests.kernels.patchmatch import naive
from texloom.stages.common.neighbourhoods import UNIT, fixed_point
from texloom.stages.kernels.patchmatch.search import PatchShape, Target, match_distances
from texloom.stages.synthesis._patchmatch.allowed import Allowed
from texloom.stages.synthesis._patchmatch.search import Effort, Search
from texloom.stages.synthesis._patchmatch.vote import HistogramVote, mean_vote, pad_torus, vote_pixels, window

SIZE, CHANNELS = 3, 3
PLACES, PATCHES = (30, 26), (80, 20)
"""rows enough for two strips of the search"""
EFFORT = Effort(sweeps=3, tries=3, fill_tries=2, tolerance=0.0)


def flat(pixels: np.ndarray) -> np.ndarray:
    return np.ascontiguousarray(pixels.reshape(pixels.shape[0], -1))


@pytest.fixture
def exemplar(rng: np.random.Generator) -> np.ndarray:
    """Smooth noise, so that some places are better than others: (h, w, c) int16."""
    pixels = rng.normal(0, 30, (PLACES[0] + SIZE - 1, PLACES[1] + SIZE - 1, CHANNELS)).cumsum(0).cumsum(1)
    return np.clip(pixels, -4000, 4000).astype(np.int16)


@pytest.fixture
def match(rng: np.random.Generator) -> np.ndarray:
    return np.stack([rng.integers(0, n, PATCHES) for n in PLACES]).astype(np.int32)


def search(exemplar: np.ndarray, wrap: bool, occurrence: float = 0.0) -> Search:
    return Search(flat(exemplar), CHANNELS, SIZE, PLACES, PATCHES, wrap, occurrence, 2.0)


def outcomes(monkeypatch: pytest.MonkeyPatch, step: Callable[[], np.ndarray]) -> tuple[np.ndarray, np.ndarray]:
    """What ``step`` gives with one thread and with two."""
    found = []
    for threads in "12":
        monkeypatch.setenv("TEXLOOM_THREADS", threads)
        found.append(step())
    return found[0], found[1]


@pytest.mark.parametrize("wrap", [False, True])
@pytest.mark.parametrize("occurrence", [0.0, 10.0])
def test_search_is_the_same_for_any_number_of_threads(
    exemplar: np.ndarray, match: np.ndarray, wrap: bool, occurrence: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    target = mean_vote(match, flat(exemplar), CHANNELS, window(SIZE), wrap)
    reports = []

    def step(seed: int = 1) -> np.ndarray:
        own = match.copy()
        reports.append(search(exemplar, wrap, occurrence).step(target, own, EFFORT, np.random.default_rng(seed)))
        return own

    one, two = outcomes(monkeypatch, step)
    np.testing.assert_array_equal(one, two)
    assert reports[0] == reports[1]
    assert (step(seed=2) != one).any()


@pytest.mark.parametrize("wrap", [False, True])
def test_votes_are_the_same_for_any_number_of_threads(
    exemplar: np.ndarray, match: np.ndarray, wrap: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    features, light = flat(exemplar), np.exp(exemplar / 1000).astype(np.float32)
    target = mean_vote(match, features, CHANNELS, window(SIZE), wrap)
    vote = HistogramVote(features, SIZE, wrap, np.full(3, -100.0), np.full(3, 100.0))
    for step in (
        lambda: mean_vote(match, features, CHANNELS, window(SIZE, 1.3), wrap),
        lambda: vote_pixels(match, light, window(SIZE, 1.3), wrap),
        lambda: vote(match, target, np.random.default_rng(1)),
    ):
        one, two = outcomes(monkeypatch, step)
        assert one.dtype == two.dtype
        np.testing.assert_array_equal(one, two)


@pytest.mark.parametrize("wrap", [False, True])
@pytest.mark.parametrize("sigma", [None, 1.3])
def test_identity_votes_for_the_exemplar_itself(exemplar: np.ndarray, wrap: bool, sigma: float | None) -> None:
    if wrap:  # a torus and its margin are their own exemplar
        exemplar = pad_torus(flat(exemplar)[: PLACES[0]], CHANNELS, SIZE).reshape(
            PLACES[0] + SIZE - 1, -1, CHANNELS
        )
    patches = (exemplar.shape[0] - SIZE + 1, exemplar.shape[1] - SIZE + 1)
    identity = np.indices(patches, np.int32)
    features, weights = flat(exemplar), window(SIZE, sigma)
    np.testing.assert_array_equal(mean_vote(identity, features, CHANNELS, weights, wrap), features)
    light = np.exp(exemplar / 1000).astype(np.float32)
    inside = light[: patches[0], : patches[1]] if wrap else light
    np.testing.assert_allclose(vote_pixels(identity, light, weights, wrap), inside, rtol=1e-5)
    vote = HistogramVote(features, SIZE, wrap, np.full(3, -100.0), np.full(3, 100.0))
    np.testing.assert_array_equal(vote(identity, np.zeros_like(features), np.random.default_rng(1)), features)


@pytest.mark.parametrize("wrap", [False, True])
def test_search_without_penalty_never_makes_the_target_worse(
    exemplar: np.ndarray, match: np.ndarray, wrap: bool
) -> None:
    target = mean_vote(match, flat(exemplar), CHANNELS, window(SIZE), wrap)
    keys, before = np.random.default_rng(1), naive.distances(target, flat(exemplar), match, CHANNELS, SIZE)
    for _ in range(3):
        energy, *_, changed = search(exemplar, wrap).step(target, match, EFFORT, keys)
        after = naive.distances(target, flat(exemplar), match, CHANNELS, SIZE)
        assert (after <= before).all()
        # mean squared difference a pixel, CIELAB units
        assert energy == pytest.approx(after.mean() / (SIZE * UNIT) ** 2)
        assert 0 <= changed <= EFFORT.sweeps
        before = after


def test_energy_counts_the_occurrence_once(exemplar: np.ndarray) -> None:
    """Even use of the exemplar costs the weight of the term, where the target matches exactly."""
    identity = np.indices(PLACES, np.int32)
    step = Search(flat(exemplar), CHANNELS, SIZE, PLACES, PLACES, False, 5.0, 2.0).step
    nothing = Effort(sweeps=1, tries=0, fill_tries=0, tolerance=1.0)
    energy, *_, changed = step(flat(exemplar), identity, nothing, np.random.default_rng(1))
    assert changed == 0
    covered = naive.occurrence_map(identity, SIZE, PLACES)
    even = PLACES[0] * PLACES[1] * SIZE**2 / covered.size
    uses = [covered[r : r + SIZE, c : c + SIZE].mean() for r, c in np.ndindex(PLACES)]
    assert energy == pytest.approx(5.0 * np.mean(uses) / even, rel=1e-3)


def test_a_match_moves_only_for_more_than_its_own_penalty(exemplar: np.ndarray, match: np.ndarray) -> None:
    """A new use makes a patch more expensive by ``penalty_per_use``; less gain would draw patches to and fro."""
    match = np.ascontiguousarray(match[:, :40])  # one strip, so that one price map holds for the sweep
    target = mean_vote(match, flat(exemplar), CHANNELS, window(SIZE), True)
    step = Search(flat(exemplar), CHANNELS, SIZE, PLACES, (40, 20), True, 1000.0, 2.0)
    penalty = naive.occurrence_penalty(match, SIZE, PLACES, step.penalty_per_use)

    def cost() -> np.ndarray:
        return naive.distances(target, flat(exemplar), match, CHANNELS, SIZE) + penalty[tuple(match)]

    before, old = cost(), match.copy()
    step.step(target, match, Effort(sweeps=1, tries=4, fill_tries=4, tolerance=0.0), np.random.default_rng(1))
    moved = (match != old).any(axis=0)
    assert moved.sum() > 50
    gain = (before - cost())[moved]
    assert gain.min() > round(step.penalty_per_use)
    assert (gain < 2 * step.penalty_per_use).any()  # so the own penalty decided


def test_the_penalty_spreads_the_matches(exemplar: np.ndarray, match: np.ndarray) -> None:
    spread = []
    for occurrence in (0.0, 20.0):
        own, keys = match.copy(), np.random.default_rng(1)
        target = mean_vote(own, flat(exemplar), CHANNELS, window(SIZE), True)
        for _ in range(3):
            search(exemplar, True, occurrence).step(target, own, EFFORT, keys)
            target = mean_vote(own, flat(exemplar), CHANNELS, window(SIZE), True)
        spread.append(naive.occurrence_map(own, SIZE, PLACES).std())
    assert spread[1] < 0.7 * spread[0]


def test_little_used_places_are_drawn_by_what_they_lack(exemplar: np.ndarray, match: np.ndarray) -> None:
    match[0] //= 2  # the lower half is unused
    probe = search(exemplar, False, 10.0)
    probe._set_penalties(*match)
    rows, columns = probe._little_used()
    drawn = np.zeros(PLACES)
    np.add.at(drawn, (rows, columns), 1)
    lack = np.maximum(0, probe.even_penalty - probe.penalty)
    np.testing.assert_allclose(drawn / drawn.sum(), lack / lack.sum(), atol=2 / rows.size)
    assert drawn[PLACES[0] // 2 + SIZE :].sum() > drawn[: PLACES[0] // 2].sum()


def histogram_difference(target: np.ndarray, exemplar: np.ndarray) -> float:
    """Share of pixels in the wrong bin, of 20 bins, summed over channels."""
    total = 0.0
    for c in range(CHANNELS):
        one, other = (np.histogram(p.reshape(-1, CHANNELS)[:, c], 20, (-1600, 1600))[0] for p in (target, exemplar))
        total += float(np.abs(one / one.sum() - other / other.sum()).sum()) / 2
    return total


@pytest.mark.parametrize("wrap", [False, True])
def test_histogram_vote_is_nearer_to_the_exemplar_than_the_mean(wrap: bool, rng: np.random.Generator) -> None:
    exemplar = (np.kron(rng.random((12, 12, CHANNELS)) ** 2, np.ones((3, 3, 1))) * 3000 - 1500).astype(np.int16)
    places = (34, 34)
    match = np.stack([rng.integers(0, n, (40, 40)) for n in places]).astype(np.int32)
    mean = mean_vote(match, flat(exemplar), CHANNELS, window(SIZE), wrap)
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
    vote = HistogramVote(flat(exemplar), SIZE, True, np.full(3, 0.0), np.full(3, 110.0))
    black = np.zeros((62, 62 * CHANNELS), np.int16)
    voted = vote(match, black, np.random.default_rng(1))[:60, : 60 * CHANNELS]
    assert 0.2 < (voted < 800).mean() < 0.8


@pytest.mark.parametrize(("size", "channels"), [(11, 4), (32, 8)])
def test_the_most_different_features_have_the_right_distance(size: int, channels: int) -> None:
    white, black = (fixed_point(np.full((size, size, channels), v, np.float32)) for v in (1e9, -1e9))
    origin = np.zeros((2, 1, 1), np.int32)
    found = np.empty((1, 1), np.int64)
    match_distances(PatchShape.of(size, channels), Target(white, *origin, found), black, 0, 1)
    assert found[0, 0] == naive.patch_distance(white, black, channels, size, (0, 0), (0, 0))


@pytest.mark.parametrize("sigma", [None, 0.3, 1.3, 10.0, 1000.0])
@pytest.mark.parametrize("value", [1e9, -1e9])
def test_the_largest_features_survive_voting(sigma: float | None, value: float) -> None:
    features = fixed_point(np.full((40, 40, 1), value, np.float32))
    voted = mean_vote(np.indices((9, 9), np.int32), features, 1, window(32, sigma), False)
    np.testing.assert_array_equal(voted, features)


@pytest.mark.parametrize("wrap", [False, True])
@pytest.mark.parametrize("occurrence", [0.0, 10.0])
def test_what_is_not_allowed_is_never_taken(
    exemplar: np.ndarray, wrap: bool, occurrence: float, rng: np.random.Generator
) -> None:
    """Though it would fit exactly: the target is made of places that are not allowed."""
    usable = rng.random((PLACES[0] + SIZE - 1, PLACES[1] + SIZE - 1)) < 0.95
    allowed = Allowed(usable, *usable.shape, SIZE)
    forbidden = np.argwhere(~allowed.places)
    wanted = forbidden[rng.integers(0, len(forbidden), PATCHES)].transpose(2, 0, 1).astype(np.int32)
    target = mean_vote(np.ascontiguousarray(wanted), flat(exemplar), CHANNELS, window(SIZE), wrap)
    match = allowed.moved(wanted)
    own = match.copy()
    step = Search(flat(exemplar), CHANNELS, SIZE, PLACES, PATCHES, wrap, occurrence, 2.0, allowed).step
    random = np.random.default_rng(1)
    for _ in range(3):
        step(target, own, EFFORT, random)
        assert allowed.places[tuple(own)].all()
    assert (own != match).any()


def test_histograms_count_usable_pixels_only(exemplar: np.ndarray, rng: np.random.Generator) -> None:
    usable = rng.random(exemplar.shape[:2]) < 0.8
    ranges = (np.full(CHANNELS, -300.0), np.full(CHANNELS, 300.0))
    found = HistogramVote(flat(exemplar), SIZE, False, *ranges, usable)
    assert (found.histogram.sum(axis=1) == usable.sum()).all()
    other = np.where(usable[..., None], exemplar, 0).astype(np.int16)
    again = HistogramVote(flat(other), SIZE, False, *ranges, usable)
    np.testing.assert_array_equal(again.histogram, found.histogram)
    everything = HistogramVote(flat(exemplar), SIZE, False, *ranges)
    assert (everything.histogram.sum(axis=1) == usable.size).all()
