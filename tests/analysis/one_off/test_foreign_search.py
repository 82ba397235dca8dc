"""Beside a lattice, what the mean cell explains is not foreign, unless looks are sure; outlines at rims stay."""

import numpy as np
import pytest

from texloom.stages.analysis.one_off.foreign_search import _beside_lattice, _closed


@pytest.mark.parametrize(
    ("look", "left", "expected"),
    [
        (7.0, 2.5, 7.0),  # a bolt on a tread plate
        (7.0, 1.5, 1.5),  # an ornament that returns
        (5.0, 2.5, 2.5),  # an odd tile
        (5.0, 6.0, 5.0),
    ],
)
def test_sure_looks_count_where_the_mean_cell_leaves_some(look: float, left: float, expected: float) -> None:
    looks, cell = np.ones((2, 96, 96), np.float32)
    part = np.s_[30:50, 40:60]
    looks[part], cell[35:45, 45:55] = look, left
    made = _beside_lattice(looks, cell, np.ones((96, 96), np.bool_), 4.0)
    assert made[40, 50] == expected
    assert made[0, 0] == 1
    assert made[part].max() == expected


@pytest.mark.parametrize("known_from", [0, 20])
def test_parts_at_the_border_of_what_is_known_keep_their_shape(known_from: int) -> None:
    """A plant in the corner of a surface that is not a rectangle; amid it, it is filled to its convex hull."""
    valid = np.ones((96, 96), np.bool_)
    valid[:known_from] = False
    found = np.zeros_like(valid)
    found[20:60, 30:50] = found[40:60, 30:70] = True
    closed = _closed(found, valid, 2.0)
    assert closed[34, 56] == (known_from == 0)
    assert not closed[80, 20]
