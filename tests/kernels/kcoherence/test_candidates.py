import numpy as np

from texloom.stages.kernels.kcoherence.candidates import cluster_candidates, propagate_candidates


def test_similar_places_are_sorted_apart_and_nearest(rng: np.random.Generator) -> None:
    """In one cluster that holds all, nothing closer is left out without one as close beside it."""
    down, across, min_separation = 7, 9, 2
    vectors = rng.integers(-200, 200, (down * across, 32)).astype(np.int16)
    candidates = np.empty((down * across, 4), np.int32)
    distance = np.empty((down * across, 4), np.int64)
    begin = np.array([0, down * across])
    halves = vectors.reshape(-1, 16)
    cluster_candidates(
        halves, np.arange(down * across), begin, across, min_separation, 1000, candidates, distance, 0, 1
    )
    propagate_candidates(halves, down, across, min_separation, candidates.copy(), candidates, distance, 0, down)
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
