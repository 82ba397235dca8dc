"""The kernels of inverse texture synthesis against their twins."""

from __future__ import annotations

import numpy as np
import pytest

from tests import naive
from texloom.stages.kernels.compaction.joint_cost import weighted_differences
from texloom.stages.kernels.compaction.nearest_vectors import nearest_vectors
from texloom.stages.kernels.compaction.solver import (
    choose_pixels,
    forward_votes,
    improve_forward,
    improve_inverse,
    inverse_votes,
    propagate_inverse,
    seam_sum,
)
from texloom.stages.kernels.compaction.tree import drop_vectors, fold_sizes, folded_into, split_nodes
from texloom.stages.kernels.kcoherence.candidates import similar_in_clusters, similar_to_neighbours

SIZE, CHANNELS, STEP = 5, 2, 2
TEXTURE, COMPACTION = (16, 18), (11, 12)
RUN = (0,) * (SIZE * CHANNELS)


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


def test_pieces_differ_from_what_stands_where_it_counts(rng: np.random.Generator) -> None:
    planes, stands = (rng.integers(-400, 400, (*shape, CHANNELS)).astype(np.float32) for shape in (TEXTURE, (4, 5)))
    pieces = np.stack([rng.integers(0, side, (6, 4, 5)) for side in TEXTURE], axis=1).astype(np.int32)
    weights = rng.uniform(0, 1, (4, 5)) * (rng.random((4, 5)) < 0.6)
    stands[weights == 0] = np.nan  # and is not looked at elsewhere
    found = np.empty(6)
    weighted_differences(planes, pieces, stands, weights, found)
    expected = [naive.weighted_difference(planes, piece, np.nan_to_num(stands), weights) for piece in pieces]
    np.testing.assert_allclose(found, expected, rtol=1e-12)


@pytest.mark.parametrize("spread", [0, 3, 2000])
def test_the_nearest_vector_is_found_the_first_of_equals(spread: int, rng: np.random.Generator) -> None:
    """Where the first component tells nothing, little or much."""
    wanted, given = (rng.integers(-2, 3, (count, 32)).astype(np.int16) for count in (40, 60))
    for vectors in (wanted, given):
        vectors[:, 0] = rng.integers(-spread, spread + 1, len(vectors))
    given[30:] = given[:30]  # all twice
    order = np.argsort(given[:, 0], kind="stable")
    found = np.empty(40, np.int64)
    for span in ((0, 17), (17, 40)):
        nearest_vectors(wanted.reshape(-1, 16), given[order].reshape(-1, 16), order, found, *span)
    np.testing.assert_array_equal(found, [naive.nearest_vector(vector, given) for vector in wanted])


def test_inverse_match_takes_the_better(rng: np.random.Generator) -> None:
    texture, compaction = features(TEXTURE, rng), features(COMPACTION, rng)
    shape = counts(TEXTURE, STEP)
    match, proposed = (random_places(shape, COMPACTION, rng) for _ in range(2))
    expected = naive.inverse_match(texture, compaction, CHANNELS, SIZE, STEP, [match, proposed])
    distance = np.empty(shape, np.int64)
    improve_inverse(texture, compaction, STEP, SIZE, RUN, proposed, match, distance, 0, shape[0])
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
    shared = (texture, compaction, STEP, SIZE, RUN, wrap)
    propagate_inverse(*shared, known, np.ones(shape, bool), match, distance, 0, shape[0])
    np.testing.assert_array_equal(match, expected[0])
    np.testing.assert_array_equal(distance, expected[1])
    fresh = (match != known).any(axis=0)
    assert 0 < fresh.sum() < fresh.size
    # and again: what has been tried already would change nothing
    now, (twice, far), (whole, whole_far) = (
        match.copy(), (match.copy(), distance.copy()), (match.copy(), distance.copy())
    )  # fmt: skip
    propagate_inverse(*shared, now, fresh, twice, far, 0, shape[0])
    propagate_inverse(*shared, now, np.ones(shape, bool), whole, whole_far, 0, shape[0])
    np.testing.assert_array_equal(twice, whole)
    np.testing.assert_array_equal(far, whole_far)
    assert (twice != now).any()


def test_forward_match_takes_the_best_candidate(rng: np.random.Generator) -> None:
    texture, candidates, source = features(TEXTURE, rng), random_similar(rng), random_source(rng)
    compaction = features(COMPACTION, rng)
    shape = counts(COMPACTION)
    match = random_places(shape, TEXTURE, rng)
    before, distance = match.copy(), np.empty(shape, np.int64)
    improve_forward(texture, compaction, source, candidates, SIZE, RUN, match, distance, 0, shape[0])
    limits = counts(TEXTURE)
    for y, x in np.ndindex(shape):
        pixels = naive.coherent_pixels(source, candidates, SIZE, y + SIZE // 2, x + SIZE // 2)
        tried = [(row - SIZE // 2, column - SIZE // 2) for row, column in pixels]
        tried = [place for place in tried if 0 <= place[0] < limits[0] and 0 <= place[1] < limits[1]]
        tried.append((int(before[0, y, x]), int(before[1, y, x])))
        far = [naive.neighbourhood_distance(compaction, (y, x), texture, to, CHANNELS, SIZE) for to in tried]
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
    inverse_votes(texture, STEP, SIZE, RUN, match, sums, number, 0, shape[0])
    np.testing.assert_array_equal(sums.reshape(expected.shape), expected)
    np.testing.assert_array_equal(number, seen)

    shape = counts(COMPACTION)
    match = random_places(shape, TEXTURE, rng)
    for y, x in np.ndindex(shape):
        row, column = match[:, y, x]
        expected[y : y + SIZE, x : x + SIZE] += planes[row : row + SIZE, column : column + SIZE]
        seen[y : y + SIZE, x : x + SIZE] += 1
    forward_votes(texture, SIZE, RUN, match, sums, number)
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
    choose_pixels(texture, inside, wanted, weights, np.float32(seam_weight), candidates, SIZE, wrap, new)
    state = source.copy()
    for y, x in np.ndindex(COMPACTION):
        found = naive.coherent_pixels(state, candidates, SIZE, y, x, wrap)
        prices = {}
        for place in found:
            if 0 <= place[0] < TEXTURE[0] and 0 <= place[1] < TEXTURE[1] and inside[place]:
                prices[place] = weights[y, x] * ((planes[place] - wanted[y, x]) ** 2).sum()
                prices[place] += seam_weight * naive.seams_around(planes, state, y, x, place, wrap)
        state[:, y, x] = new[:, y, x]
        assert prices[tuple(new[:, y, x])] <= min(prices.values()) * (1 + 1e-5) + 1e-3


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


def two_clouds(rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """Vectors around two points, and which of them each is of."""
    which = rng.integers(0, 2, 60)
    places = rng.integers(-300, 300, (2, 32))
    return (places[which] + rng.integers(-20, 21, (60, 32))).astype(np.int16), which


def test_a_node_is_split_where_its_members_are_apart(rng: np.random.Generator) -> None:
    vectors, which = two_clouds(rng)
    order, halves = np.arange(60), vectors.reshape(-1, 16)
    means, out = np.zeros((4, 16), np.int16), [np.zeros(1, np.int64), np.zeros(1), np.zeros(1, np.int64)]
    medoid, distortion, left = out
    whole = (np.zeros(1, np.int64), np.full(1, 60))
    split_nodes(halves, order, np.empty(60, np.int64), *whole, 1.0, 10, means, medoid, distortion, left, 0, 1)
    first = order[: left[0]]
    assert set(which[first]) != set(which[order[left[0] :]])
    assert len(set(which[first])) == 1
    exact = vectors.astype(np.float64)
    assert distortion[0] == pytest.approx(((exact - exact.mean(axis=0)) ** 2).sum())
    far = ((exact - np.rint(exact.mean(axis=0))) ** 2).sum(axis=1)
    assert far[medoid[0]] == far.min()
    np.testing.assert_array_equal(means.reshape(2, 32)[0], np.rint(exact[first].mean(axis=0)))

    leaf = np.empty(60, np.int32)
    drop_vectors(halves, np.array([1, -1, -1], np.int32), np.concatenate([means, means, means]), leaf, 0, 60)
    np.testing.assert_array_equal(np.flatnonzero(leaf == 1), np.sort(first))


def random_tree(rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Parents, left children, distortions."""
    parent, child, distortion = [-1], [-1], [1000.0]
    for _ in range(12):
        node = int(rng.choice(np.flatnonzero(np.array(child) < 0)))
        child[node] = len(parent)
        parts = rng.uniform(0, distortion[node] / 2, 2)
        parent += [node, node]
        child += [-1, -1]
        distortion += parts.tolist()
    return np.array(parent, np.int32), np.array(child, np.int32), np.array(distortion)


@pytest.mark.parametrize("seed", range(5))
def test_nodes_fold_in_the_order_of_their_cost(seed: int) -> None:
    parent, child, distortion = random_tree(np.random.default_rng(seed))
    fold = np.empty(parent.size, np.int32)
    fold_sizes(parent, child, distortion, fold)
    assert fold.tolist() == naive.folding(parent.tolist(), child.tolist(), distortion.tolist())
    for leaves in range(1, 14):
        owner = np.empty(parent.size, np.int32)
        folded_into(parent, fold, leaves, owner)
        kept = {int(owner[node]) for node in np.flatnonzero(child < 0)}
        assert len(kept) <= leaves
        for node in range(1, parent.size):
            above = parent[node]
            folded = owner[above] != above or fold[above] > leaves
            assert owner[node] == (owner[above] if folded else node)


def test_similar_places_are_sorted_apart_and_nearest(rng: np.random.Generator) -> None:
    """In one cluster that holds all, nothing closer is left out without one as close beside it."""
    down, across, min_separation = 7, 9, 2
    vectors = rng.integers(-200, 200, (down * across, 32)).astype(np.int16)
    candidates = np.empty((down * across, 4), np.int32)
    distance = np.empty((down * across, 4), np.int64)
    begin = np.array([0, down * across])
    halves = vectors.reshape(-1, 16)
    similar_in_clusters(
        halves, np.arange(down * across), begin, across, min_separation, 1000, candidates, distance, 0, 1
    )
    similar_to_neighbours(halves, down, across, min_separation, candidates.copy(), candidates, distance, 0, down)
    exact = ((vectors[:, None].astype(np.int64) - vectors[None]) ** 2).sum(axis=2)
    rows, columns = np.divmod(np.arange(down * across), across)
    gap = np.maximum(np.abs(rows[:, None] - rows), np.abs(columns[:, None] - columns))
    for place in range(down * across):
        found = candidates[place][candidates[place] >= 0]
        assert found[0] == place
        far = exact[place, found]
        np.testing.assert_array_equal(distance[place, : found.size], far)
        assert (np.diff(far) >= 0).all()
        assert all(gap[a, b] >= min_separation for a in found for b in found if a != b)
        # the nearest of all that are apart from it comes next
        allowed = exact[place][gap[place] >= min_separation]
        assert far[1] == allowed.min()
