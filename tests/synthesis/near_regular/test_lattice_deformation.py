from __future__ import annotations

import numpy as np
import pytest

from texloom.stages.synthesis.near_regular.lattice_deformation import differences, synthesise_displacements
from texloom.stages.synthesis.near_regular.output_lattice import OutputLattice

CELLS = np.array([[20.0, 3.0], [-2.0, 24.0]])


def grid(rows: int, columns: int) -> np.ndarray:
    return np.argwhere(np.ones((rows, columns)))


def spread(parts: list[np.ndarray]) -> np.ndarray:
    """Root mean square along each axis."""
    return np.sqrt((np.concatenate(parts) ** 2).mean(axis=0))


def test_differences_of_neighbours() -> None:
    steps = np.array([[0, 0], [0, 1], [1, 0]])
    moves = np.array([[1.0, 2.0], [4.0, 1.0], [0.0, 0.0]])
    across, slanting, down, diagonal = differences(steps, moves)
    assert across.tolist() == [[3, -1]]
    assert slanting.tolist() == [[-4, -1]]  # from (0, 1) to (1, 0)
    assert down.tolist() == [[-1, -2]]
    assert diagonal.shape == (0, 2)


@pytest.mark.parametrize("tileable", [False, True])
@pytest.mark.parametrize("kind", ["jitter", "bends"])
def test_as_uneven_as_the_exemplar(kind: str, tileable: bool, rng: np.random.Generator) -> None:
    """Neighbours differ as much, and more along the axis along which they do in the exemplar."""
    steps = grid(12, 14)
    if kind == "jitter":
        moves = rng.normal(size=(len(steps), 2)) * [0.5, 2.0]
    else:
        moves = np.stack([np.sin(steps[:, 1] / 2), 3 * np.cos(steps[:, 0] / 2)], axis=1)
    lattice = OutputLattice.of(CELLS, (300, 340), tileable)
    displacements = synthesise_displacements(steps, moves, lattice, rng)
    theirs = spread(differences(steps, moves))
    if not tileable:
        ours = spread(differences(lattice.steps, displacements))
        np.testing.assert_allclose(np.hypot(*ours), np.hypot(*theirs), rtol=1e-6)
        assert 0.5 < (ours[0] / ours[1]) / (theirs[0] / theirs[1]) < 2
    np.testing.assert_allclose(displacements.mean(axis=0), 0, atol=1e-9)
    assert np.abs(displacements).max() < 8 * np.abs(moves).max()


def test_what_is_straight_stays_so(rng: np.random.Generator) -> None:
    lattice = OutputLattice.of(CELLS, (200, 200), False)
    assert not synthesise_displacements(grid(5, 5), np.zeros((25, 2)), lattice, rng).any()
    assert not synthesise_displacements(grid(1, 1), np.ones((1, 2)), lattice, rng).any()


def test_same_seed_same_bits() -> None:
    lattice = OutputLattice.of(CELLS, (200, 200), True)
    moves = np.random.default_rng(1).normal(size=(36, 2))
    one, two, other = (
        synthesise_displacements(grid(6, 6), moves, lattice, np.random.default_rng(seed)) for seed in (3, 3, 4)
    )
    np.testing.assert_array_equal(one, two)
    assert (one != other).any()
