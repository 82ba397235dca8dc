"""The patch search kernels against their twins, and the steps of the search that they make up."""

from typing import Any

import numpy as np
import pytest

from tests.kernels.patchmatch import naive
from tests.kernels.patchmatch.conftest import CHANNELS, PATCHES, PLACES, SIZE, flat, outcomes
from tests.wraps import WRAPS, X, beyond, sides
from texloom.stages.common.similarity.neighbourhoods import UNIT, fixed_point
from texloom.stages.kernels.patchmatch.search import (
    ALL_ACTIVE,
    PatchShape,
    Scan,
    SearchedExemplar,
    Target,
    count_matches,
    count_moves,
    match_distances,
    occurrence_penalty,
    random_bits,
    sweep,
    wrap_index,
)
from texloom.stages.synthesis.optimisation.allowed import Allowed
from texloom.stages.synthesis.optimisation.match_search import Effort, Search
from texloom.stages.synthesis.optimisation.vote import mean_vote
from texloom.stages.vocabulary.facts import NOWHERE, TORUS, Wraps

EFFORT = Effort(sweeps=3, tries=3, fill_tries=2, tolerance=0.0)

KINDS = [(3, 3), (4, 4), (5, 5)]
"""patch size and channels"""


class Problem:
    """A small random search: few distinct values, so that distances tie and rules for ties show."""

    def __init__(
        self, size: int, channels: int, wrap: Wraps, rng: np.random.Generator, down: int = 7, across: int = 6
    ):
        self.size, self.channels, self.wrap = size, channels, wrap
        self.places = (9, 8)
        pixels = rng.integers(-40, 40, (down + size - 1, across + size - 1, channels)) // 8
        high, wide = sides((down, across), size - 1, wrap)
        pixels = np.pad(pixels[:high, :wide], [*beyond(size - 1, wrap), (0, 0)], mode="wrap")
        self.target = np.ascontiguousarray(pixels.reshape(pixels.shape[0], -1), np.int16)
        self.exemplar = (rng.integers(-40, 40, (9 + size - 1, (8 + size - 1) * channels)) // 8).astype(np.int16)
        self.match = np.stack([rng.integers(0, n, (down, across)) for n in self.places]).astype(np.int32)
        # a run of agreeing neighbours, which the sweep leaves alone
        self.match[0, :4, :4] = np.arange(4)[:, None] + 1
        self.match[1, :4, :4] = np.arange(4)[None, :] + 2
        self.distance = naive.distances(self.target, self.exemplar, self.match, channels, size)
        self.active = np.full((down, across), ALL_ACTIVE, np.uint8)
        self.unused = np.stack([rng.integers(0, n, 20) for n in self.places]).astype(np.int32)

    def arguments(
        self, penalty: np.ndarray, own_penalty: int = 0, limit: int = 2**60, *,
        forward: bool = True, radius: int = 9, tries: int = 3, fill_tries: int = 2, key: int = 1,
        everywhere: bool = True, distance_per_try: int = 0,
    ) -> tuple[PatchShape, Target, SearchedExemplar, Scan]:  # fmt: skip
        """What a sweep takes; it changes the problem in place."""
        target = Target(self.target, *self.match, self.distance, self.active)
        exemplar = SearchedExemplar(
            self.exemplar, np.float32(penalty), np.int64(own_penalty), np.int64(limit), *self.unused
        )
        radii = np.maximum(1, radius // np.arange(1, tries + 1))
        per_try = np.int64(distance_per_try)
        scan = Scan(forward, self.wrap, radii, per_try, fill_tries, np.uint64(key), everywhere)
        return PatchShape.of(self.size, self.channels), target, exemplar, scan

    def sweep(self, penalty: np.ndarray, own_penalty: int = 0, limit: int = 2**60, **how: Any) -> int:
        """The compiled sweep over all rows; the number of distances that it compares."""
        return sweep(*self.arguments(penalty, own_penalty, limit, **how), 0, len(self.match[0]))[1]


def test_random_bits_equal_whole_number_arithmetic(rng: np.random.Generator) -> None:
    for key in (0, 1, 2**64 - 1, *rng.integers(2**64, size=50, dtype=np.uint64)):
        position, counter = int(rng.integers(2**40)), int(rng.integers(100))
        assert int(random_bits(np.uint64(key), position, counter)) == naive.random_bits(int(key), position, counter)


def test_random_bits_are_even() -> None:
    drawn = [naive.random_bits(7, position, counter) for position in range(500) for counter in range(4)]
    assert len(set(drawn)) == len(drawn)
    ones = np.array([[bits >> place & 1 for place in range(64)] for bits in drawn]).mean(axis=0)
    assert np.abs(ones - 0.5).max() < 5 * 0.5 / np.sqrt(len(drawn))


@pytest.mark.parametrize("size", [1, 2, 3, 5, 8])
def test_occurrence_penalty_equals_counting_pixels(size: int, rng: np.random.Generator) -> None:
    for places in ((1, 1), (1, 9), (6, 3), (9, 11)):
        match = np.stack([rng.integers(0, n, (7, 5)) for n in places]).astype(np.int32)
        counts, penalty = np.zeros(places, np.int32), np.empty(places, np.float32)
        count_matches(match[0], match[1], counts)
        occurrence_penalty(counts, size, 1234.5, penalty)
        np.testing.assert_array_equal(penalty, naive.occurrence_penalty(match, size, places, 1234.5))
        # every patch covers size**2 pixels
        assert naive.occurrence_map(match, size, places).sum() == 35 * size**2


def test_penalties_are_those_of_all_places_where_most_are_far_from_any_use(rng: np.random.Generator) -> None:
    for width in (64, 191, 400):  # places are skipped by 64
        match = np.stack([rng.integers(0, 9, (2, 3)), rng.integers(0, width, (2, 3))]).astype(np.int32)
        counts, penalty = np.zeros((9, width), np.int32), np.full((9, width), -1, np.float32)
        count_matches(match[0], match[1], counts)
        occurrence_penalty(counts, 5, 1234.5, penalty)
        np.testing.assert_array_equal(penalty, naive.occurrence_penalty(match, 5, (9, width), 1234.5))


def test_penalty_of_one_use_falls_with_the_share_of_common_pixels() -> None:
    counts, penalty = np.zeros((9, 11), np.int32), np.empty((9, 11), np.float32)
    counts[4, 5] = 1
    occurrence_penalty(counts, 4, 1600.0, penalty)
    assert penalty[4, 5] == 1600
    assert penalty[4, 7] == penalty[6, 5] == 800
    assert penalty[3, 6] == 900
    assert penalty[4, 9] == penalty[0, 5] == 0


@pytest.mark.parametrize("wrap", WRAPS)
@pytest.mark.parametrize(("size", "channels"), KINDS)
def test_distances_equal_sums_of_squares(size: int, channels: int, wrap: Wraps, rng: np.random.Generator) -> None:
    problem = Problem(size, channels, wrap, rng)
    found = np.full_like(problem.distance, -1)
    target = Target(problem.target, *problem.match, found, problem.active)
    match_distances(PatchShape.of(size, channels), target, problem.exemplar, 2, 5)
    np.testing.assert_array_equal(found[2:5], problem.distance[2:5])
    assert (found[:2] == -1).all()
    assert (found[5:] == -1).all()


def test_a_place_that_both_neighbours_propose_is_compared_once(rng: np.random.Generator) -> None:
    problem = Problem(3, 3, NOWHERE, rng)
    problem.match[:, 2, 2] = 7, 1  # among patches that agree
    problem.distance = naive.distances(problem.target, problem.exemplar, problem.match, 3, 3)
    problem.distance[2, 2] = 0
    penalty = np.zeros((9, 8))
    penalty[7, 1] = 1  # so that what is proposed is compared, and rejected
    problem.active[:] = 0
    problem.active[2, 2] = ALL_ACTIVE
    assert problem.sweep(penalty, tries=0, fill_tries=0) == 1


@pytest.mark.parametrize("wrap", WRAPS)
@pytest.mark.parametrize(("size", "channels"), KINDS)
def test_sweep_equals_twin(size: int, channels: int, wrap: Wraps, rng: np.random.Generator) -> None:
    typical = int(np.median(Problem(size, channels, wrap, rng).distance))
    for trial in range(6):
        problem = Problem(size, channels, wrap, rng)
        penalty = rng.integers(0, typical, problem.places)
        own_penalty, limit = typical // 10, typical // 3
        how = {"forward": trial % 2 == 0, "radius": 2 + 2 * trial, "key": trial}
        how["distance_per_try"] = 0 if trial % 3 == 0 else typical // 2
        shape, target, exemplar, scan = problem.arguments(penalty, own_penalty, limit, **how)
        slow = target._replace(row=target.row.copy(), column=target.column.copy(), distance=target.distance.copy())
        span = (0, 7) if trial < 4 else (2, 6)
        counts = np.zeros(problem.places, np.int32)
        count_matches(*problem.match, counts)
        expected = naive.Sweep(shape, slow, exemplar, scan).run(*span)
        assert expected > 0
        moves, _ = sweep(shape, target, exemplar, scan, *span)
        assert len(moves) == expected
        for array, slow_array in zip(target[1:4], slow[1:4], strict=True):
            np.testing.assert_array_equal(array, slow_array)
        count_moves(moves, counts.reshape(-1))
        after = np.zeros_like(counts)
        count_matches(*problem.match, after)
        np.testing.assert_array_equal(counts, after)


@pytest.mark.parametrize("wrap", WRAPS)
def test_sweeps_that_try_only_what_is_new_find_the_same(wrap: Wraps, rng: np.random.Generator) -> None:
    """At fixed penalties, what was refused once is refused again."""
    penalty = rng.integers(0, 300, (9, 8))
    first, other = (Problem(3, 3, wrap, np.random.default_rng(5), down=30, across=20) for _ in range(2))
    compared = [0, 0]
    for number in range(6):
        how = {"own_penalty": 30, "forward": number % 2 == 0, "tries": 0, "fill_tries": 0}
        compared[0] += first.sweep(penalty, **how)
        compared[1] += other.sweep(penalty, **how, everywhere=number == 0)
        np.testing.assert_array_equal(other.match, first.match)
        np.testing.assert_array_equal(other.distance, first.distance)
    assert compared[1] < 0.7 * compared[0]


@pytest.mark.parametrize(("wrap", "most"), [(NOWHERE, 0), (TORUS, 0), (X, 0), (TORUS, 500)])
def test_no_patch_gets_worse_at_fixed_penalties(wrap: Wraps, most: int, rng: np.random.Generator) -> None:
    problem = Problem(3, 3, wrap, rng, down=20, across=20)
    penalty = rng.integers(0, most + 1, problem.places)

    def cost() -> np.ndarray:
        return problem.distance + penalty[tuple(problem.match)]

    first = cost()
    for number in range(6):
        before = cost()
        problem.sweep(penalty, own_penalty=most // 10, limit=most // 2, forward=number % 2 == 0, key=number)
        assert (cost() <= before).all()
        held = naive.distances(problem.target, problem.exemplar, problem.match, 3, 3)
        np.testing.assert_array_equal(problem.distance, held)
    assert cost().sum() < 0.7 * first.sum()


def test_propagation_carries_one_good_match_across_the_target(rng: np.random.Generator) -> None:
    """The target is a piece of the exemplar; one patch knows where."""
    problem = Problem(3, 3, NOWHERE, rng)
    problem.target = np.ascontiguousarray(problem.exemplar[1:10, 2 * 3 : 10 * 3])
    problem.match[0], problem.match[1] = problem.places[0] - 1, problem.places[1] - 1
    problem.match[:, 0, 0] = 1, 2
    problem.distance = naive.distances(problem.target, problem.exemplar, problem.match, 3, 3)
    problem.sweep(np.zeros(problem.places, np.int64), tries=0, fill_tries=0)
    np.testing.assert_array_equal(problem.match - np.indices((7, 6)), np.full((2, 7, 6), [[[1]], [[2]]]))
    assert problem.distance.sum() == 0


def test_random_search_rejects_overused_patches(rng: np.random.Generator) -> None:
    """What random search may not take, it takes once the limit is raised."""
    for limit, taken in ((10, False), (11, True)):
        problem = Problem(3, 3, NOWHERE, rng)
        penalty = np.full(problem.places, 10, np.int64)
        penalty[:, :4] = 11
        problem.match[1] = 4 + problem.match[1] % 4
        problem.distance = naive.distances(problem.target, problem.exemplar, problem.match, 3, 3)
        problem.sweep(penalty, limit=limit, tries=8, fill_tries=0)
        # propagation is free to go there, but only from one place to the next
        assert (problem.match[1] < 3).any() == taken


def test_a_patch_has_more_tries_the_worse_it_fits(rng: np.random.Generator) -> None:
    """The number of distances that are compared tells how many tries there were."""
    penalty = np.zeros((9, 8), np.int64)
    least = int(Problem(3, 3, NOWHERE, np.random.default_rng(5)).distance.min())
    compared = []
    for per_try in (0, max(1, least // 4), 3 * least, 2**40):
        problem = Problem(3, 3, NOWHERE, np.random.default_rng(5))
        compared.append(problem.sweep(penalty, tries=4, fill_tries=0, distance_per_try=per_try))
    assert compared[0] == compared[1] > compared[2] > compared[3]
    problem = Problem(3, 3, NOWHERE, np.random.default_rng(5))
    assert compared[3] == problem.sweep(penalty, tries=0, fill_tries=0)


def test_random_search_narrows_from_sweep_to_sweep_or_from_try_to_try() -> None:
    by_sweeps = Effort(sweeps=4, tries=3, fill_tries=0, tolerance=0.0)
    assert [by_sweeps.radii(sweep, 100).tolist() for sweep in range(6)] == [
        [100] * 3,
        [50] * 2,
        [25],
        [12],
        [6],
        [5],
    ]
    by_tries = Effort(sweeps=4, tries=3, fill_tries=2, tolerance=0.0, narrow=True)
    assert [by_tries.fills(sweep) for sweep in range(3)] == [2, 0, 0]
    assert [by_tries.radii(sweep, 125).tolist() for sweep in range(3)] == [[125, 25, 5], [], []]
    none = Effort(sweeps=4, tries=0, fill_tries=0, tolerance=0.0, narrow=True)
    assert not none.radii(0, 100).size


@pytest.mark.parametrize("wrap", [False, True])
def test_indices_wrap_or_end(wrap: bool) -> None:
    beyond = [wrap_index(index, 5, wrap) for index in range(-5, 10)]
    assert beyond == ([*range(5)] * 3 if wrap else [*[-1] * 5, *range(5), *[-1] * 5])


def search(exemplar: np.ndarray, wrap: Wraps, occurrence: float = 0.0) -> Search:
    return Search(flat(exemplar), CHANNELS, SIZE, PLACES, PATCHES, wrap, occurrence, 2.0)


@pytest.mark.parametrize("wrap", WRAPS)
@pytest.mark.parametrize("occurrence", [0.0, 10.0])
def test_search_is_the_same_for_any_number_of_threads(
    exemplar: np.ndarray, match: np.ndarray, wrap: Wraps, occurrence: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    target = mean_vote(match, flat(exemplar), CHANNELS, SIZE, wrap)
    reports = []

    def step(seed: int = 1) -> np.ndarray:
        own = match.copy()
        reports.append(search(exemplar, wrap, occurrence).step(target, own, EFFORT, np.random.default_rng(seed)))
        return own

    one, two = outcomes(monkeypatch, step)
    np.testing.assert_array_equal(one, two)
    assert reports[0] == reports[1]
    assert (step(seed=2) != one).any()


@pytest.mark.parametrize("wrap", WRAPS)
def test_search_without_penalty_never_makes_the_target_worse(
    exemplar: np.ndarray, match: np.ndarray, wrap: Wraps
) -> None:
    target = mean_vote(match, flat(exemplar), CHANNELS, SIZE, wrap)
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
    step = Search(flat(exemplar), CHANNELS, SIZE, PLACES, PLACES, NOWHERE, 5.0, 2.0).step
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
    target = mean_vote(match, flat(exemplar), CHANNELS, SIZE, TORUS)
    step = Search(flat(exemplar), CHANNELS, SIZE, PLACES, (40, 20), TORUS, 1000.0, 2.0)
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


def test_energy_is_that_of_the_matches_that_are_left(exemplar: np.ndarray, match: np.ndarray) -> None:
    target = mean_vote(match, flat(exemplar), CHANNELS, SIZE, NOWHERE)
    again = search(exemplar, NOWHERE, 10.0)
    random = np.random.default_rng(1)
    for _ in range(3):
        energy, penalty, _ = again.step(target, match, EFFORT, random)
        penalties = naive.occurrence_penalty(match, SIZE, PLACES, again.penalty_per_use)
        np.testing.assert_array_equal(again.penalty, penalties)
        distance = naive.distances(target, flat(exemplar), match, CHANNELS, SIZE).sum()
        total = penalties[tuple(match)].sum()
        assert penalty == pytest.approx(total / again.unit / match[0].size)
        assert energy == pytest.approx((distance + total) / again.unit / match[0].size)


def test_the_penalty_spreads_the_matches(exemplar: np.ndarray, match: np.ndarray) -> None:
    spread = []
    for occurrence in (0.0, 20.0):
        own, keys = match.copy(), np.random.default_rng(1)
        target = mean_vote(own, flat(exemplar), CHANNELS, SIZE, TORUS)
        for _ in range(3):
            search(exemplar, TORUS, occurrence).step(target, own, EFFORT, keys)
            target = mean_vote(own, flat(exemplar), CHANNELS, SIZE, TORUS)
        spread.append(naive.occurrence_map(own, SIZE, PLACES).std())
    assert spread[1] < 0.7 * spread[0]


def test_little_used_places_are_drawn_by_what_they_lack(exemplar: np.ndarray, match: np.ndarray) -> None:
    match[0] //= 2  # the lower half is unused
    probe = search(exemplar, NOWHERE, 10.0)
    probe._count(match)
    probe._set_penalties()
    rows, columns = probe._little_used()
    drawn = np.zeros(PLACES)
    np.add.at(drawn, (rows, columns), 1)
    lack = np.maximum(0, probe.even_penalty - probe.penalty)
    np.testing.assert_allclose(drawn / drawn.sum(), lack / lack.sum(), atol=2 / rows.size)
    assert drawn[PLACES[0] // 2 + SIZE :].sum() > drawn[: PLACES[0] // 2].sum()


@pytest.mark.parametrize(("size", "channels"), [(11, 4), (12, 4), (32, 8), (23, 16)])
def test_the_most_different_features_have_the_right_distance(size: int, channels: int) -> None:
    white, black = (fixed_point(np.full((size, size, channels), v, np.float32)) for v in (1e9, -1e9))
    origin = np.zeros((2, 1, 1), np.int32)
    found = np.empty((1, 1), np.int64)
    match_distances(
        PatchShape.of(size, channels),
        Target(white, *origin, found, np.full((1, 1), ALL_ACTIVE, np.uint8)),
        black,
        0,
        1,
    )
    assert found[0, 0] == naive.patch_distance(white, black, channels, size, (0, 0), (0, 0))


@pytest.mark.parametrize("wrap", WRAPS)
@pytest.mark.parametrize("occurrence", [0.0, 10.0])
def test_what_is_not_allowed_is_never_taken(
    exemplar: np.ndarray, wrap: Wraps, occurrence: float, rng: np.random.Generator
) -> None:
    """Though it would fit exactly: the target is made of places that are not allowed."""
    usable = rng.random((PLACES[0] + SIZE - 1, PLACES[1] + SIZE - 1)) < 0.95
    allowed = Allowed(usable, *usable.shape, SIZE)
    forbidden = np.argwhere(~allowed.places)
    wanted = forbidden[rng.integers(0, len(forbidden), PATCHES)].transpose(2, 0, 1).astype(np.int32)
    target = mean_vote(np.ascontiguousarray(wanted), flat(exemplar), CHANNELS, SIZE, wrap)
    match = allowed.moved(wanted)
    own = match.copy()
    step = Search(flat(exemplar), CHANNELS, SIZE, PLACES, PATCHES, wrap, occurrence, 2.0, allowed).step
    random = np.random.default_rng(1)
    for _ in range(3):
        step(target, own, EFFORT, random)
        assert allowed.places[tuple(own)].all()
    assert (own != match).any()
