import numpy as np
import pytest

from tests.kernels.kcoherence import naive
from texloom.stages.kernels.kcoherence.local_search import search_around


@pytest.mark.parametrize("reach", [0, 1, 2, 9])
def test_places_move_as_their_naive_twins_do(reach: int, rng: np.random.Generator) -> None:
    vectors = rng.integers(0, 4, (7, 9, 3)).astype(np.float32)
    own = np.stack(np.divmod(np.arange(63), 9), axis=1)
    places = np.stack(np.divmod((np.arange(63)[:, None] + rng.integers(1, 63, (63, 4))) % 63, 9), axis=2)
    found = places.astype(np.int32)
    search_around(vectors, own, found, reach, 5, 60)
    expected = places.copy()
    for index in range(5, 60):
        for which in range(4):
            y, x = places[index, which]
            expected[index, which] = naive.best_around(vectors, tuple(own[index]), (int(y), int(x)), reach)
    np.testing.assert_array_equal(found, expected)
