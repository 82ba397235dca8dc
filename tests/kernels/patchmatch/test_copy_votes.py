import numpy as np
import pytest

from tests.kernels.patchmatch import naive
from tests.wraps import WRAPS, sides
from texloom.stages.synthesis.optimisation.vote import copy_vote, mean_vote
from texloom.stages.vocabulary.facts import NOWHERE, Wraps


@pytest.mark.parametrize("wrap", WRAPS)
@pytest.mark.parametrize("reach", [0, 1])
def test_the_best_proposal_is_copied(reach: int, wrap: Wraps, rng: np.random.Generator) -> None:
    size, channels, shape = 3, 2, (9, 11)
    exemplar = rng.integers(-50, 50, (*shape, channels)).astype(np.int16)
    match = np.stack([rng.integers(0, side - size + 1, (7, 8)) for side in shape]).astype(np.int32)
    flat = np.ascontiguousarray(exemplar.reshape(shape[0], -1))
    target = mean_vote(match, flat, channels, size, wrap)
    source = copy_vote(match, target, flat, channels, size, reach, wrap)
    whole = sides((7, 8), 2, wrap)
    assert source.shape == (*whole, 2)
    wanted = target.reshape(target.shape[0], -1, channels)[: whole[0], : whole[1]]
    for y, x in np.ndindex(whole):
        proposals = [(row, column) for _, _, row, column in naive.votes(match, size, wrap, y, x)]
        assert tuple(source[y, x]) in proposals
        least = naive.copy_vote(match, wanted, exemplar, size, reach, wrap, y, x)
        assert least == distance(wanted, exemplar, (y, x), tuple(source[y, x]), reach, wrap)


def distance(
    target: np.ndarray, exemplar: np.ndarray, at: tuple[int, int], to: tuple[int, int], reach: int, wrap: Wraps
) -> int:
    """Of one exemplar pixel, as the only vote: the patch of one pixel at ``to``."""
    match = np.zeros((2, *target.shape[:2]), np.int64)
    match[:, at[0], at[1]] = to
    return naive.copy_vote(match, target, exemplar, 1, reach, wrap, *at)


def test_patches_that_agree_are_copied_whole(rng: np.random.Generator) -> None:
    """Whatever the target is like."""
    exemplar = rng.integers(-50, 50, (12, 12)).astype(np.int16)
    match = np.ascontiguousarray(np.indices((8, 9)).astype(np.int32))
    target = np.zeros((10, 11), np.int16)
    source = copy_vote(match, target, exemplar, 1, 3, 1, NOWHERE)
    np.testing.assert_array_equal(source, np.indices((10, 11)).transpose(1, 2, 0))
