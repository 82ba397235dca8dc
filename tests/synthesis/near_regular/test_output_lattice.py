from __future__ import annotations

import itertools

import numpy as np
import pytest

from tests.synthetic import LATTICES
from texloom.stages.synthesis.near_regular.lattice_deformation import DIRECTIONS
from texloom.stages.synthesis.near_regular.output_lattice import OutputLattice
from texloom.stages.vocabulary.declare import InputError

SIZE = (150, 190)


@pytest.mark.parametrize("name", list(LATTICES))
def test_nodes_cover_the_result(name: str) -> None:
    lattice = OutputLattice.of(LATTICES[name], SIZE, False)
    np.testing.assert_array_equal(lattice.generators, LATTICES[name])
    corners = np.array([(0, 0), (0, 189), (149, 0), (149, 189), (70, 90)])
    for cell in np.floor(corners @ np.linalg.inv(lattice.generators)).astype(int):
        for step in itertools.product((0, 1), repeat=2):
            i, j = cell + step - lattice.first
            node = lattice.ids[i, j]
            np.testing.assert_array_equal(lattice.steps[node], cell + step)
            np.testing.assert_allclose(lattice.places[node], (cell + step) @ lattice.generators)


@pytest.mark.parametrize("name", list(LATTICES))
def test_a_torus_has_each_node_once(name: str) -> None:
    lattice = OutputLattice.of(LATTICES[name], SIZE, True)
    # whole cells, similar to the generators
    cells = np.prod(SIZE) / abs(np.linalg.det(lattice.generators))
    assert len(lattice.steps) == round(cells)
    assert abs(cells - round(cells)) < 1e-6
    assert np.abs(lattice.generators - LATTICES[name]).max() < 0.35 * np.abs(LATTICES[name]).max()
    # steps with the same place on the torus have the same node, others have not
    i, j = np.indices(lattice.ids.shape)
    steps = np.stack([i, j], axis=-1) + lattice.first
    away = (steps @ lattice.generators - lattice.places[lattice.ids]) / SIZE
    np.testing.assert_allclose(away, np.rint(away), atol=1e-9)
    assert len(np.unique(np.round(lattice.places, 6) % SIZE, axis=0)) == len(lattice.steps)


@pytest.mark.parametrize("tileable", [False, True])
def test_neighbours(tileable: bool) -> None:
    lattice = OutputLattice.of(LATTICES["sheared"], SIZE, tileable)
    table = lattice.neighbours(DIRECTIONS)
    assert (table >= 0).all() == tileable
    for node, near in enumerate(table):
        for direction, other in zip(DIRECTIONS, near, strict=True):
            if other >= 0:
                away = lattice.places[other] - lattice.places[node] - np.array(direction) @ lattice.generators
                turns = away / SIZE if tileable else away
                np.testing.assert_allclose(turns, np.rint(turns) if tileable else 0, atol=1e-9)
    opposite = table[:, [DIRECTIONS.index((-i, -j)) for i, j in DIRECTIONS]]
    for node, near in enumerate(table):
        assert all(opposite[other, k] == node for k, other in enumerate(near) if other >= 0)


def test_a_torus_smaller_than_a_cell() -> None:
    with pytest.raises(InputError, match="size: 30 x 20 px is smaller than a cell"):
        OutputLattice.of(np.array([[60.0, 0.0], [0.0, 90.0]]), (20, 30), True)
    with pytest.raises(InputError, match="too many cells"):
        OutputLattice.of(np.array([[1.0, 0.0], [0.0, 1.0]]), (4000, 4000), False)
