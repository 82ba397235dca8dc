import numpy as np
import pytest

from tests.kernels.compaction import naive
from texloom.stages.kernels.compaction.nearest_vectors import nearest_vectors


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
