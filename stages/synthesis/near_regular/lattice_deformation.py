"""Displacements of a result's lattice, synthesised from those of an exemplar as a Markov random field."""

import numpy as np
from jaxtyping import Float64, Int64

from texloom.stages.kernels.core.elementary_functions import exp, log
from texloom.stages.synthesis.near_regular.output_lattice import OutputLattice

DIRECTIONS = ((0, 1), (1, -1), (1, 0), (1, 1), (0, -1), (-1, 1), (-1, 0), (-1, -1))
"""steps to the eight neighbours, the first four and then their opposites"""

_ENTRIES = 65  # along a side of a density
_MAX_PAIRS = 512  # of neighbours that a density is estimated from
_MIN_DENSITY = 1e-6  # relative to the highest
_MIN_DEVIATION = 0.02  # px; lattices that deviate less are regular
_ITERATIONS = 30
_GRID = 9  # displacements along an axis that are tried
_SPAN = 2.0  # of these, in root mean squares of the differences of neighbours


def differences(steps: Int64[np.ndarray, "n 2"], moves: Float64[np.ndarray, "n 2"]) -> list[np.ndarray]:
    """Differences of neighbours' displacements, (k, 2) px for each of the first four directions."""
    number = {tuple(step): index for index, step in enumerate(steps.tolist())}
    parts = []
    for di, dj in DIRECTIONS[:4]:
        pairs = [(number[i + di, j + dj], index) for (i, j), index in number.items() if (i + di, j + dj) in number]
        others, own = np.array(pairs, np.int64).reshape(-1, 2).T
        parts.append(moves[others] - moves[own])
    return parts


def _root_mean_square(parts: list[np.ndarray]) -> float:
    values = np.concatenate(parts)
    return float(np.sqrt((values**2).mean())) if values.size else 0.0


def _densities(parts: list[np.ndarray], reach: float) -> Float64[np.ndarray, "4 side side"]:
    """Log density of the differences in each direction, up to ``reach`` px; 0 for a direction without any."""
    line = np.linspace(-reach, reach, _ENTRIES)
    tables = np.zeros((4, _ENTRIES, _ENTRIES))
    for table, values in zip(tables, parts, strict=True):
        if not len(values):
            continue
        sample = values[:: -(-len(values) // _MAX_PAIRS)]
        width = max(_MIN_DEVIATION, float(np.sqrt((sample**2).mean())) * len(sample) ** (-1 / 6))
        rows, columns = (exp(-((line[:, None] - sample[:, axis]) ** 2) / (2 * width**2)) for axis in (0, 1))
        density = np.einsum("ik,jk->ij", rows, columns)
        table[:] = log(density / density.max() + _MIN_DENSITY)
    return tables


def synthesise_displacements(
    steps: Int64[np.ndarray, "n 2"],
    moves: Float64[np.ndarray, "n 2"],
    lattice: OutputLattice,
    rng: np.random.Generator,
) -> Float64[np.ndarray, "nodes 2"]:
    """Displace the nodes of a lattice like an exemplar's vertices, px.

    A vertex and its eight neighbours form a Markov random field, whose densities are those of the differences
    between the exemplar's neighbours. Starting from random displacements, each vertex in turn is sampled given its
    neighbours.

    Parameters
    ----------
    steps, moves : vertices of the exemplar, in steps along the generators of ``lattice``, and their displacements
        from the regular lattice, px.

    References
    ----------
    [Lin2004]_ appendix A, equations 1 to 3, with squared distances. The paper moves each vertex to the most likely
    position, which converges to the mean; we sample from the likelihood, and finally scale all displacements so
    that neighbours differ as much as in the exemplar.
    """
    from texloom.stages.kernels.lattice.deformation import draw_displacements

    count = len(lattice.steps)
    parts = differences(steps, moves)
    spread = _root_mean_square(parts)
    if spread < _MIN_DEVIATION:
        return np.zeros((count, 2))
    reach = max(float(np.abs(values).max(initial=0)) for values in parts) + 2 * spread
    limit = max(float(np.abs(moves).max()), 2 * spread)
    line = np.linspace(-_SPAN * spread, _SPAN * spread, _GRID)
    grid = np.stack(np.meshgrid(line, line, indexing="ij"), axis=-1).reshape(-1, 2)
    drawn = rng.uniform(-spread, spread, (count, 2))
    neighbours = lattice.neighbours(DIRECTIONS)
    step = 2 * reach / (_ENTRIES - 1)
    key = rng.integers(0, 2**64, dtype=np.uint64)
    draw_displacements(_densities(parts, reach), step, neighbours, grid, limit, _ITERATIONS, key, drawn)
    drawn -= drawn.mean(axis=0)
    own = neighbours[:, :4]
    own_spread = _root_mean_square([drawn[own[:, k]][own[:, k] >= 0] - drawn[own[:, k] >= 0] for k in range(4)])
    return drawn * (spread / own_spread) if own_spread > 0 else drawn
