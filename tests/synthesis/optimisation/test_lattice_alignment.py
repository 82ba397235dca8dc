import itertools

import numpy as np
import pytest

from texloom.stages.synthesis.optimisation import lattice_alignment
from texloom.stages.synthesis.optimisation.allowed import Allowed
from texloom.stages.synthesis.optimisation.lattice_alignment import align_pieces, cheapest_moves
from texloom.stages.synthesis.optimisation.lattice_phase import LatticePhase
from texloom.stages.synthesis.stitching.seams import SeamCosts, pairs
from texloom.stages.vocabulary.facts import NOWHERE, Wraps

SIZE, MIDDLE = 6, 3
CELL, SIDE = 16, 96
"""px of a square of a checkerboard, and of the exemplar and the result"""
BOARD = np.array([[CELL, CELL], [CELL, -CELL]], np.float32)
COURSES = np.array([[2 * CELL, 0]], np.float32)


def board() -> np.ndarray:
    """Lightness and colour of black and white squares."""
    rows, columns = np.indices((SIDE, SIDE)) // CELL
    return np.repeat(np.where((rows + columns) % 2, 90, 5)[..., None], 3, axis=2).astype(np.float32)


def bent(patches: tuple[int, int], shift: int = 2) -> np.ndarray:
    """The exemplar itself, but for parts that lie some pixels off its lattice."""
    match = np.indices(patches).astype(np.int32)
    match[1, 20:50, 10:40] += shift
    match[0, 40:80, 50:80] -= shift
    match[:, 10:30, 60:70] += 1
    return np.clip(match, 0, SIDE - SIZE)


def aligned(
    match: np.ndarray,
    lab: np.ndarray,
    generators: np.ndarray = BOARD,
    wrap: Wraps = NOWHERE,
    allowed: Allowed | None = None,
) -> np.ndarray:
    result = match.copy()
    phase = LatticePhase(generators, np.moveaxis(match, 0, 2).astype(np.uint32), wrap)
    align_pieces(result, lab, SIZE, (0, 0), wrap, generators, phase, allowed)
    return result


def shown(match: np.ndarray, lab: np.ndarray) -> np.ndarray:
    return lab[match[0] + MIDDLE, match[1] + MIDDLE, 0]


@pytest.mark.parametrize("window", [1280, 80])
@pytest.mark.parametrize("generators", [BOARD, np.array([[0, 2 * CELL], [CELL, CELL]], np.float32)])
def test_bent_lines_become_straight(window: int, generators: np.ndarray, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(lattice_alignment, "_WINDOW", window)
    monkeypatch.setattr(lattice_alignment, "_OVERLAP", 60)
    lab = board()
    match = bent((SIDE - SIZE + 1, SIDE - SIZE + 1))
    straight = shown(np.indices(match.shape[1:]), lab)
    assert (shown(match, lab) != straight).sum() > 200
    assert np.array_equal(shown(aligned(match, lab, generators), lab), straight)


def test_rows_become_straight_where_they_alone_repeat(rng: np.random.Generator) -> None:
    """Displacements along the rows stay."""
    lab = np.repeat(np.where(np.arange(SIDE) // CELL % 2, 90, 5)[:, None, None], SIDE, axis=1).astype(np.float32)
    lab = lab + rng.uniform(0, 0.5, (SIDE, SIDE, 3)).astype(np.float32)
    match = bent((SIDE - SIZE + 1, SIDE - SIZE + 1))
    result = aligned(match, lab, COURSES)
    assert np.array_equal(result[1], match[1])
    assert np.array_equal(shown(result, lab) > 50, shown(np.indices(match.shape[1:]), lab) > 50)


def test_pieces_across_the_border_of_what_tiles_move() -> None:
    lab = board()
    match = np.indices((SIDE, SIDE)).astype(np.int32)
    match -= MIDDLE
    match %= 2 * CELL  # of the first squares
    match[1, 30:60, -12:] += 1
    match[1, 30:60, :9] += 1
    result = aligned(match, lab, wrap=Wraps(down=True, across=True))
    assert np.array_equal(shown(result, lab), lab[:SIDE, :SIDE, 0])


def test_joints_never_get_dearer(rng: np.random.Generator) -> None:
    """Also where nothing lies on a lattice."""
    lab = np.repeat(np.cumsum(rng.normal(0, 8, (SIDE, SIDE, 1)), axis=1), 3, axis=2).astype(np.float32)
    costs = SeamCosts(lab, gradients=True, squared=True)

    def total(match: np.ndarray) -> int:
        sources = np.moveaxis(match + MIDDLE, 0, 2)
        return sum(
            int(
                costs.between(
                    axis, *(np.ascontiguousarray(end.reshape(-1, 2)) for end in pairs(sources, axis))
                ).sum()
            )
            for axis in (0, 1)
        )

    for shift in (1, 3, 5):
        match = bent((SIDE - SIZE + 1, SIDE - SIZE + 1), shift)
        assert total(aligned(match, lab)) <= total(match)


def test_no_masked_pixel_is_taken() -> None:
    usable = np.ones((SIDE, SIDE), bool)
    usable[:, :12] = False
    allowed = Allowed(usable, SIDE, SIDE, SIZE)
    match = allowed.moved(bent((SIDE - SIZE + 1, SIDE - SIZE + 1)))
    result = aligned(match, board(), allowed=allowed)
    assert (result != match).any()
    assert allowed.places[result[0], result[1]].all()


def test_moves_cost_as_little_as_any(rng: np.random.Generator) -> None:
    """Compared with all choices, where a joint costs no less if one of two pieces moves."""
    pieces = 7
    joints = np.array([*itertools.combinations(range(pieces), 2), *((one, one) for one in range(pieces))]).T
    for _ in range(20):
        joints = np.where(rng.random(joints.shape[1]) < 0.5, joints, joints[::-1])
        same, apart = rng.integers(0, 1000, (2, 2, joints.shape[1]))
        cost = np.stack([same[0], same.max(axis=0) + apart[0], same.max(axis=0) + apart[1], same[1]])
        free = rng.random(pieces) < 0.8
        taken = cheapest_moves(joints, cost, free)
        choices = np.array([*itertools.product((0, 1), repeat=pieces)])
        choices = np.vstack([taken, choices[~choices[:, ~free].any(axis=1)]])
        index = 2 * choices[:, joints[0]] + choices[:, joints[1]]
        totals = np.take_along_axis(cost, index, axis=0).sum(axis=1)
        assert not taken[~free].any()
        assert totals[0] == totals.min()


def test_large_costs_are_no_problem() -> None:
    joints = np.array([[0, 0], [1, 0]])
    cost = np.array([[10, 1 << 40], [1 << 40, 0], [1 << 40, 0], [10, 0]])
    assert cheapest_moves(joints, cost, np.ones(2, bool)).tolist() == [True, True]
