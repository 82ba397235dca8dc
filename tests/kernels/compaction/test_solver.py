import itertools

import numpy as np
import pytest

from tests.kernels.compaction import naive
from tests.kernels.patchmatch.naive import patch_distance
from texloom.stages.kernels.compaction.solver import (
    CompactionSource,
    MatchedNeighbourhoods,
    Objective,
    choose_pixels,
    gather_votes,
    improve_match,
    match_by_coherence,
    propagate_match,
    scatter_votes,
    seam_sum,
)
from texloom.stages.kernels.patchmatch.search import PatchShape

SIZE, CHANNELS, STEP = 5, 4, 2
TEXTURE, COMPACTION = (16, 18), (11, 12)
SHAPE = PatchShape.of(SIZE, CHANNELS)


def features(shape: tuple[int, int], rng: np.random.Generator) -> np.ndarray:
    return rng.integers(-400, 400, (shape[0], shape[1] * CHANNELS)).astype(np.int16)


def random_places(shape: tuple[int, int], within: tuple[int, int], rng: np.random.Generator) -> np.ndarray:
    return np.stack([rng.integers(0, n - SIZE + 1, shape) for n in within]).astype(np.int32)


def counts(shape: tuple[int, int], step: int = 1) -> tuple[int, int]:
    return (shape[0] - SIZE) // step + 1, (shape[1] - SIZE) // step + 1


def random_similar(rng: np.random.Generator) -> np.ndarray:
    down, across = counts(TEXTURE)
    candidates = rng.integers(-1, down * across, (down, across, 3)).astype(np.int32)
    candidates[..., 0] = np.arange(down * across).reshape(down, across)
    candidates[candidates[..., 1] < 0, 2] = -1
    return candidates


def random_source(rng: np.random.Generator) -> np.ndarray:
    return np.stack([rng.integers(0, n, COMPACTION) for n in TEXTURE]).astype(np.int32)


def test_inverse_match_takes_the_better(rng: np.random.Generator) -> None:
    texture, compaction = features(TEXTURE, rng), features(COMPACTION, rng)
    shape = counts(TEXTURE, STEP)
    match, proposed = (random_places(shape, COMPACTION, rng) for _ in range(2))
    expected = naive.inverse_match(texture, compaction, CHANNELS, SIZE, STEP, [match, proposed])
    _, distance = naive.inverse_match(texture, compaction, CHANNELS, SIZE, STEP, [match])
    moved = rng.random(counts(COMPACTION)) < 0.5
    distance[moved[match[0], match[1]]] = 0  # no longer true, computed again
    neighbourhoods = MatchedNeighbourhoods(SHAPE, texture, compaction, STEP)
    improve_match(neighbourhoods, proposed, moved, match, distance, 0, shape[0])
    np.testing.assert_array_equal(match, expected[0])
    np.testing.assert_array_equal(distance, expected[1])


@pytest.mark.parametrize("wrap", [False, True])
def test_inverse_match_goes_on_from_neighbours(wrap: bool, rng: np.random.Generator) -> None:
    texture, compaction = features(TEXTURE, rng), features(COMPACTION, rng)
    shape = counts(TEXTURE, STEP)
    known = random_places(shape, COMPACTION, rng)
    match, (_, distance) = known.copy(), naive.inverse_match(texture, compaction, CHANNELS, SIZE, STEP, [known])
    proposals = [known]
    limit = np.array(counts(COMPACTION))[:, None, None]
    for dy, dx in ((-1, 0), (0, -1), (1, 0), (0, 1)):
        beside = np.roll(known, (-dy, -dx), (1, 2)) - np.array([dy, dx])[:, None, None] * STEP
        rows, columns = np.indices(shape)
        beside = beside % limit if wrap else beside
        there = (rows + dy >= 0) & (rows + dy < shape[0]) & (columns + dx >= 0) & (columns + dx < shape[1])
        there &= ((beside >= 0) & (beside < limit)).all(axis=0)
        proposals.append(np.where(there, beside, known))
    expected = naive.inverse_match(texture, compaction, CHANNELS, SIZE, STEP, proposals)
    shared = (MatchedNeighbourhoods(SHAPE, texture, compaction, STEP), wrap)
    propagate_match(*shared, known, np.ones(shape, bool), match, distance, 0, shape[0])
    np.testing.assert_array_equal(match, expected[0])
    np.testing.assert_array_equal(distance, expected[1])
    changed = (match != known).any(axis=0)
    assert 0 < changed.sum() < changed.size
    # and again: what has been tried already would change nothing
    once, again = (match.copy(), distance.copy()), (match.copy(), distance.copy())
    propagate_match(*shared, match, changed, *once, 0, shape[0])
    propagate_match(*shared, match, np.ones(shape, bool), *again, 0, shape[0])
    for one, other in zip(once, again, strict=True):
        np.testing.assert_array_equal(one, other)
    assert (once[0] != match).any()


def test_forward_match_takes_the_best_candidate(rng: np.random.Generator) -> None:
    texture, candidates, source = features(TEXTURE, rng), random_similar(rng), random_source(rng)
    compaction = features(COMPACTION, rng)
    shape = counts(COMPACTION)
    match = random_places(shape, TEXTURE, rng)
    before, distance = match.copy(), np.full(shape, -1, np.int64)
    moved = rng.random(shape) < 0.7
    neighbourhoods = MatchedNeighbourhoods(SHAPE, compaction, texture, 1)
    match_by_coherence(neighbourhoods, source, candidates, moved, match, distance, 0, shape[0])
    np.testing.assert_array_equal(match[:, ~moved], before[:, ~moved])
    assert (distance[~moved] == -1).all()
    limits = counts(TEXTURE)
    for y, x in np.argwhere(moved).tolist():
        pixels = naive.coherent_pixels(source, candidates, SIZE, y + SIZE // 2, x + SIZE // 2)
        tried = [(row - SIZE // 2, column - SIZE // 2) for row, column in pixels]
        tried = [place for place in tried if 0 <= place[0] < limits[0] and 0 <= place[1] < limits[1]]
        tried.append((int(before[0, y, x]), int(before[1, y, x])))
        far = [patch_distance(compaction, texture, CHANNELS, SIZE, (y, x), to) for to in tried]
        assert distance[y, x] == min(far)
        assert tuple(match[:, y, x]) in tried


def test_votes_are_all_pixels_of_all_matches(rng: np.random.Generator) -> None:
    texture = features(TEXTURE, rng)
    planes = texture.reshape(*TEXTURE, CHANNELS).astype(np.int64)
    shape = counts(TEXTURE, STEP)
    match = random_places(shape, COMPACTION, rng)
    sums, number = np.zeros((COMPACTION[0], COMPACTION[1] * CHANNELS), np.int64), np.zeros(COMPACTION, np.int64)
    expected, seen = np.zeros((*COMPACTION, CHANNELS), np.int64), np.zeros(COMPACTION, np.int64)
    for y, x in np.ndindex(shape):
        row, column = match[:, y, x]
        into = (slice(row, row + SIZE), slice(column, column + SIZE))
        expected[into] += planes[y * STEP : y * STEP + SIZE, x * STEP : x * STEP + SIZE]
        seen[into] += 1
    nothing = np.empty((0, 0), np.int16)
    scatter_votes(MatchedNeighbourhoods(SHAPE, texture, nothing, STEP), match, sums, number, 0, shape[0])
    np.testing.assert_array_equal(sums.reshape(expected.shape), expected)
    np.testing.assert_array_equal(number, seen)

    shape = counts(COMPACTION)
    match = random_places(shape, TEXTURE, rng)
    for y, x in np.ndindex(shape):
        row, column = match[:, y, x]
        expected[y : y + SIZE, x : x + SIZE] += planes[row : row + SIZE, column : column + SIZE]
        seen[y : y + SIZE, x : x + SIZE] += 1
    gather_votes(MatchedNeighbourhoods(SHAPE, nothing, texture, 1), match, sums, number)
    np.testing.assert_array_equal(sums.reshape(expected.shape), expected)
    np.testing.assert_array_equal(number, seen)


@pytest.mark.parametrize(("seam_weight", "wrap"), [(0.0, False), (0.5, False), (0.5, True)])
def test_pixels_are_the_cheapest_candidates(seam_weight: float, wrap: bool, rng: np.random.Generator) -> None:
    """One after the other, each beside those that were chosen before it."""
    texture, candidates, source = features(TEXTURE, rng), random_similar(rng), random_source(rng)
    planes = texture.reshape(*TEXTURE, CHANNELS).astype(np.float64)
    wanted = rng.uniform(-400, 400, (*COMPACTION, CHANNELS)).astype(np.float32)
    weights = rng.uniform(0, 2, COMPACTION).astype(np.float32)
    new = source.copy()
    inside = rng.random(TEXTURE) < 0.9
    objective = Objective(wanted, weights, np.float32(seam_weight), wrap)
    active = rng.random(COMPACTION) < 0.5
    last = active.copy()
    choose_pixels(CompactionSource(texture, inside, candidates, SIZE), objective, last, new)
    state = source.copy()
    for y, x in np.ndindex(COMPACTION):
        if not active[y, x]:
            assert (new[:, y, x] == source[:, y, x]).all()
            continue
        active[y, x] = False
        found = naive.coherent_pixels(state, candidates, SIZE, y, x, wrap)
        costs = {}
        for place in found:
            if 0 <= place[0] < TEXTURE[0] and 0 <= place[1] < TEXTURE[1] and inside[place]:
                costs[place] = weights[y, x] * ((planes[place] - wanted[y, x]) ** 2).sum()
                costs[place] += seam_weight * naive.seams_around(planes, state, y, x, place, wrap)
        if (state[:, y, x] != new[:, y, x]).any():
            for v, u in itertools.product((y - 1, y, y + 1), (x - 1, x, x + 1)):
                if wrap or (0 <= v < COMPACTION[0] and 0 <= u < COMPACTION[1]):
                    active[v % COMPACTION[0], u % COMPACTION[1]] = True
        state[:, y, x] = new[:, y, x]
        assert costs[tuple(new[:, y, x])] <= min(costs.values()) * (1 + 1e-5) + 1e-3
    np.testing.assert_array_equal(last, active)


@pytest.mark.parametrize("wrap", [False, True])
def test_seams_are_summed_once_a_pair(wrap: bool, rng: np.random.Generator) -> None:
    texture, source = features(TEXTURE, rng), random_source(rng)
    planes = texture.reshape(*TEXTURE, CHANNELS).astype(np.float64)
    around = [
        naive.seams_around(planes, source, y, x, tuple(source[:, y, x]), wrap) for y, x in np.ndindex(COMPACTION)
    ]
    assert seam_sum(texture, CHANNELS, wrap, source) == pytest.approx(sum(around) / 2, rel=1e-5)
    whole = np.indices(COMPACTION).astype(np.int32) + 3
    assert (seam_sum(texture, CHANNELS, wrap, whole) > 0) == wrap
