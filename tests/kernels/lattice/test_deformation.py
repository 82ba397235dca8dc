import numpy as np

from tests.kernels.lattice import naive
from texloom.stages.kernels.lattice.deformation import draw_displacements

LINE = np.linspace(-1, 1, 5)
GRID = np.stack(np.meshgrid(LINE, LINE, indexing="ij"), axis=-1).reshape(-1, 2)


def test_equals_twin(rng: np.random.Generator) -> None:
    tables = rng.normal(size=(4, 7, 7))
    neighbours = rng.integers(-1, 6, (6, 8))
    moves = rng.uniform(-1, 1, (6, 2))
    expected = naive.draw_displacements(tables, 0.4, neighbours, GRID, 1.4, 3, 12345, moves)
    draw_displacements(tables, 0.4, neighbours, GRID, 1.4, 3, np.uint64(12345), moves)
    np.testing.assert_allclose(moves, expected, atol=1e-12)
    assert np.abs(moves).max() <= 1.4


def test_draws_follow_the_density() -> None:
    """The last vertex is drawn beside one that stands anywhere: how they differ is as the table says.

    Those far from where they began are left out, as no displacement may be longer than a bound.
    """
    line = (np.arange(41) - 20) * 0.25
    density = -((line[:, None] - 1.0) ** 2 + (line[None, :] + 0.5) ** 2) / (2 * 0.6**2)
    neighbours = np.full((2, 8), -1)
    neighbours[1, 0] = 0
    tables = np.repeat(density[None], 4, axis=0)
    found = []
    for key in range(2000):
        moves = np.zeros((2, 2))
        draw_displacements(tables, 0.25, neighbours, GRID * 2, 4.0, 6, np.uint64(key), moves)
        if np.abs(moves[0]).max() < 1.5:
            found.append(moves[0] - moves[1])
    kept = np.array(found)
    assert len(kept) > 150
    np.testing.assert_allclose(np.median(kept, axis=0), [1.0, -0.5], atol=0.15)
    spread = np.percentile(kept, 75, axis=0) - np.percentile(kept, 25, axis=0)
    np.testing.assert_allclose(spread, 2 * 0.6745 * 0.6, rtol=0.25)
