import numpy as np
import pytest

from texloom.stages.common.similarity.similarity_sets import similarity_sets


@pytest.mark.parametrize("rounds", [0, 1])
def test_similar_places_are_sorted_apart_and_nearest(rng: np.random.Generator, rounds: int) -> None:
    """In one cluster that holds all, nothing closer is left out without one as close beside it."""
    down, across, min_separation = 7, 9, 2
    vectors = rng.integers(-200, 200, (down * across, 32)).astype(np.int16)
    members, begin = np.arange(down * across), np.array([0, down * across])
    candidates = similarity_sets(vectors, (down, across), members, begin, [(0, 1)], 4, min_separation, 1000, rounds)
    exact = ((vectors[:, None].astype(np.int64) - vectors[None]) ** 2).sum(axis=2)
    rows, columns = np.divmod(np.arange(down * across), across)
    gap = np.maximum(np.abs(rows[:, None] - rows), np.abs(columns[:, None] - columns))
    for place in range(down * across):
        found = candidates[place][candidates[place] >= 0]
        assert found[0] == place
        far = exact[place, found]
        assert (np.diff(far) >= 0).all()
        assert all(gap[a, b] >= min_separation for a in found for b in found if a != b)
        # the nearest of all that are apart from it comes next
        allowed = exact[place][gap[place] >= min_separation]
        assert far[1] == allowed.min()


def test_sets_of_lone_places_hold_themselves(rng: np.random.Generator) -> None:
    vectors = rng.integers(-200, 200, (20, 32)).astype(np.int16)
    members = np.arange(15)
    sets = similarity_sets(
        vectors, (4, 5), members, np.array([0, 15]), [(0, 1)], 3, 1, 48, 0, lone=np.array([16, 19])
    )
    np.testing.assert_array_equal(sets[15:, 0], [-1, 16, -1, -1, 19])
    assert (sets[15:, 1:] == -1).all()
    assert (sets[:15, 1:] >= 0).all()


def test_too_many_places_are_refused() -> None:
    none = np.empty(0, np.int64)
    with pytest.raises(ValueError, match="2\\^31"):
        similarity_sets(np.empty((0, 32), np.int16), (1 << 16, 1 << 16), none, none, [], 2, 1, 48, 1)
