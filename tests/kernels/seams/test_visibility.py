import numpy as np
import pytest

from tests.kernels.seams import naive
from tests.wraps import WRAPS, X, Y
from texloom.stages.kernels.seams.visibility import added_cost, seam_costs
from texloom.stages.vocabulary.facts import NOWHERE, TORUS, Wraps

EXEMPLAR, RESULT = (12, 15), (10, 13)


@pytest.fixture
def exemplar(rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """Features and slopes."""
    return rng.random((*EXEMPLAR, 3), np.float32), rng.random(EXEMPLAR, np.float32)


@pytest.fixture
def match(rng: np.random.Generator) -> np.ndarray:
    """A copy of the exemplar, with pixels from elsewhere."""
    match = np.stack(np.indices(RESULT), axis=2) + 1
    elsewhere = rng.random(RESULT) < 0.3
    match[elsewhere] = rng.integers(0, EXEMPLAR, (elsewhere.sum(), 2))
    return match.astype(np.uint32)


@pytest.mark.parametrize("wrap", WRAPS)
def test_costs_of_squares_equal_twin(
    wrap: Wraps, exemplar: tuple[np.ndarray, np.ndarray], match: np.ndarray
) -> None:
    costs = np.full((3, 4), np.nan)
    for span in ((0, 1), (1, 3)):
        seam_costs(*exemplar, match, wrap, 4, *span, costs)
    expected = np.pad(naive.seam_costs(*exemplar, match, wrap), ((0, 2), (0, 3)))
    np.testing.assert_allclose(costs, expected.reshape(3, 4, 4, 4).sum(axis=(1, 3)), rtol=1e-5)


@pytest.mark.parametrize(
    ("wrap", "top", "left"), [(NOWHERE, 6, 8), (NOWHERE, 0, 0), (TORUS, 8, 11), (X, 6, 11), (Y, 8, 8)]
)
def test_added_cost_is_that_after_less_that_before(
    wrap: Wraps, top: int, left: int, exemplar: tuple[np.ndarray, np.ndarray], match: np.ndarray
) -> None:
    new = np.random.default_rng(1).random((4, 5)) < 0.7
    added = added_cost(*exemplar, match, wrap, top, left, new, 3, 2)
    after = match.copy()
    for i, j in np.argwhere(new):
        after[(top + i) % RESULT[0], (left + j) % RESULT[1]] = 3 + i, 2 + j
    before, after = (naive.seam_costs(*exemplar, each, wrap).sum() for each in (match, after))
    assert added == pytest.approx(after - before, rel=1e-4)
