"""How a lattice is deformed, taken as a texture: displacements of a result's vertices like those of an exemplar."""

import numpy as np
from jaxtyping import Float64, Int64

from texloom.stages.synthesis._lattice.output_lattice import OutputLattice

DIRECTIONS = ((0, 1), (1, -1), (1, 0), (1, 1), (0, -1), (-1, 1), (-1, 0), (-1, -1))
"""steps to the eight neighbours, the first four and then their opposites"""

_ENTRIES = 65  # along a side of a density
_PAIRS = 512  # of neighbours that a density is made of
_UNLIKELY = 1e-6  # of the highest density
_LEAST = 0.02  # px; what bends less is straight
_ROUNDS = 30
_GRID = 9  # moves along an axis that are tried
_SPAN = 2.0  # how far they reach, in root mean squares of the differences of neighbours


def differences(steps: Int64[np.ndarray, "n 2"], moves: Float64[np.ndarray, "n 2"]) -> list[np.ndarray]:
    """What neighbours' displacements differ by, (k, 2) px for each of the first four directions."""
    number = {tuple(step): index for index, step in enumerate(steps.tolist())}
    found = []
    for di, dj in DIRECTIONS[:4]:
        pairs = [(number[i + di, j + dj], index) for (i, j), index in number.items() if (i + di, j + dj) in number]
        others, own = np.array(pairs, np.int64).reshape(-1, 2).T
        found.append(moves[others] - moves[own])
    return found


def _root_mean_square(parts: list[np.ndarray]) -> float:
    values = np.concatenate(parts)
    return float(np.sqrt((values**2).mean())) if values.size else 0.0


def _densities(parts: list[np.ndarray], reach: float) -> Float64[np.ndarray, "4 side side"]:
    """Logarithm of the density of the differences in each direction, up to ``reach`` px; 0 where there are none."""
    line = np.linspace(-reach, reach, _ENTRIES)
    tables = np.zeros((4, _ENTRIES, _ENTRIES))
    for table, values in zip(tables, parts, strict=True):
        if not len(values):
            continue
        chosen = values[:: -(-len(values) // _PAIRS)]
        width = max(_LEAST, float(np.sqrt((chosen**2).mean())) * len(chosen) ** (-1 / 6))
        rows, columns = (np.exp(-((line[:, None] - chosen[:, axis]) ** 2) / (2 * width**2)) for axis in (0, 1))
        density = np.einsum("ik,jk->ij", rows, columns)
        table[:] = np.log(density / density.max() + _UNLIKELY)
    return tables


def synthesise_displacements(
    steps: Int64[np.ndarray, "n 2"],
    moves: Float64[np.ndarray, "n 2"],
    lattice: OutputLattice,
    rng: np.random.Generator,
) -> Float64[np.ndarray, "nodes 2"]:
    """Displace the nodes of a lattice as an exemplar's vertices are displaced, px.

    A vertex and its eight neighbours form a Markov random field: how a neighbour stands to a vertex is as likely
    as it is frequent in the exemplar. Starting from random displacements, each vertex in turn is drawn anew given
    its neighbours.

    Parameters
    ----------
    steps, moves : vertices of the exemplar and their displacements from the regular lattice, px.

    References
    ----------
    [Lin2004]_ appendix A, equations 1 to 3, with squared distances. There each vertex is put where it is most
    likely, by which any texture comes to rest at its mean; we draw from the likelihood, and at the end scale all
    displacements so that neighbours differ as much as in the exemplar.
    """
    from texloom.stages.kernels.lattice.deformation import draw_displacements

    count = len(lattice.steps)
    given = differences(steps, moves)
    spread = _root_mean_square(given)
    if spread < _LEAST:
        return np.zeros((count, 2))
    reach = max(float(np.abs(values).max(initial=0)) for values in given) + 2 * spread
    most = max(float(np.abs(moves).max()), 2 * spread)
    line = np.linspace(-_SPAN * spread, _SPAN * spread, _GRID)
    grid = np.stack(np.meshgrid(line, line, indexing="ij"), axis=-1).reshape(-1, 2)
    drawn = rng.uniform(-spread, spread, (count, 2))
    neighbours = lattice.neighbours(DIRECTIONS)
    step = 2 * reach / (_ENTRIES - 1)
    key = rng.integers(0, 2**64, dtype=np.uint64)
    draw_displacements(_densities(given, reach), step, neighbours, grid, most, _ROUNDS, key, drawn)
    drawn -= drawn.mean(axis=0)
    own = neighbours[:, :4]
    left = _root_mean_square([drawn[own[:, k]][own[:, k] >= 0] - drawn[own[:, k] >= 0] for k in range(4)])
    return drawn * (spread / left) if left > 0 else drawn
