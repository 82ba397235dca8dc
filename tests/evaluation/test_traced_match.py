import numpy as np
import pytest

from texloom.stages.evaluation.traced_match import traced_match
from texloom.stages.vocabulary.declare import InputError


def test_pixels_are_traced_through_all_generations(rng: np.random.Generator) -> None:
    first = rng.integers(0, (20, 30), (7, 9, 2)).astype(np.uint32)
    second = rng.integers(0, (7, 9), (5, 6, 2)).astype(np.uint32)
    traced = traced_match(second, traced_match(first).match).match
    assert traced.shape == (5, 6, 2)
    assert traced.dtype == np.uint32
    for row, column in np.ndindex(5, 6):
        assert tuple(traced[row, column]) == tuple(first[tuple(second[row, column])])


def test_the_first_generation_is_its_own_match(rng: np.random.Generator) -> None:
    match = rng.integers(0, (20, 30), (7, 9, 2)).astype(np.uint32)
    np.testing.assert_array_equal(traced_match(match).match, match)


def test_a_match_of_another_exemplar() -> None:
    match = np.full((4, 4, 2), 9, np.uint32)
    with pytest.raises(InputError, match="match: points outside of the 5 x 5 px of former"):
        traced_match(match, np.zeros((5, 5, 2), np.uint32))
