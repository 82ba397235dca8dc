"""How much a lattice changes."""

import numpy as np
import pytest

from texloom.stages.common.regularity.lattice_strain import lattice_strain, visibility

GENERATORS = np.array([[12.0, 5.0], [-3.0, 16.0]])


def test_positions_move_as_their_generators() -> None:
    own = GENERATORS + np.array([[0.5, -1.0], [0.2, 0.4]])
    strain = lattice_strain(GENERATORS, own)
    np.testing.assert_allclose(GENERATORS + GENERATORS @ strain, own)


def test_turned_rows_are_more_visible_than_other_spacing() -> None:
    spacing, turned = np.diag([0.1, 0.0]), np.array([[0.0, 0.0], [0.1, 0.0]])
    assert visibility(turned) == pytest.approx(9 * visibility(spacing)) == pytest.approx(0.09)
