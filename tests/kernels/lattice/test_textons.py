import numpy as np

from tests.kernels.lattice import naive
from texloom.stages.kernels.lattice.textons import LatticeNodes, TextonPlaces, lay_textons


def test_equals_twin(rng: np.random.Generator) -> None:
    pixels = rng.random((14, 17, 2)).astype(np.float32)
    source = (np.moveaxis(np.indices((14, 17)), 0, -1) + rng.normal(0, 0.4, (14, 17, 2))).astype(np.float32)
    lattice, origin = np.array([[5.0, 1.0], [-2.0, 6.0]]), np.array([1.5, -2.5])
    generators, start = np.array([[5.2, 0.8], [-1.9, 6.1]]), np.array([2.0, 1.0])
    table = np.array([[0, 0], [0, 1], [-1, 0]]), rng.random((7, 8, 3)) * (rng.random((7, 8, 3)) > 0.3)
    table[1][..., 0] += 0.1
    first = np.array([-4, -5])
    ids = np.arange(90).reshape(9, 10)
    textons = rng.uniform(0, 1, (90, 2))
    ids[6, 6] = -1  # no texton there: the others fill in
    places = rng.uniform(0, 9, (60, 2))
    by_step = {(i - 4, j - 5): textons[ids[i, j]] for i, j in np.ndindex(9, 10) if ids[i, j] >= 0}
    out, match = np.full((60, 2), np.nan, np.float32), np.zeros((60, 2), np.uint32)
    covered = [tuple(step) != (2, 1) for step in np.floor((places - origin) @ np.linalg.inv(lattice)).astype(int)]
    cells = LatticeNodes(np.linalg.inv(lattice), origin, first, ids)
    lay_textons(pixels, source, places, cells, TextonPlaces(textons, generators, start, *table), out, match)
    expected = [
        naive.laid_texton(pixels, source, place, origin, lattice, by_step, generators, start, *table)
        for place in places[covered]
    ]
    np.testing.assert_allclose(out[covered], expected, atol=2e-6)
    assert sum(covered) > 50


def test_one_texton_again_and_again_copies_its_pixels(rng: np.random.Generator) -> None:
    """Whole generators, no deformation: all is as it was."""
    pixels = rng.random((20, 20, 1)).astype(np.float32)
    source = np.moveaxis(np.indices((20, 20)), 0, -1).astype(np.float32, order="C")
    lattice = np.array([[6.0, 0.0], [0.0, 8.0]])
    ids = np.zeros((5, 5), np.int64)
    places = np.ascontiguousarray(np.argwhere(np.ones((12, 16))), float)
    out, match = np.empty((192, 1), np.float32), np.empty((192, 2), np.uint32)
    textons = np.array([[0.5, 0.25]])  # begins at row 3, column 2
    zero = np.zeros(2)
    cells = LatticeNodes(np.linalg.inv(lattice), zero, np.array([-1, -1]), ids)
    alone = TextonPlaces(textons, lattice, zero, np.zeros((1, 2), np.int64), np.ones((4, 5, 1)))
    lay_textons(pixels, source, places, cells, alone, out, match)
    row, column = (places % [6, 8] + [3, 2]).astype(int).T
    np.testing.assert_array_equal(match, np.stack([row, column], axis=1))
    np.testing.assert_allclose(out, pixels[row, column], atol=1e-6)
