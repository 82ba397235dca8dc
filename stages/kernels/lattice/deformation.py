"""Gibbs sampling of the displacements of a lattice's vertices, each given its eight neighbours."""

import math

import numpy as np

from texloom.stages.kernels.core.compiled import compiled, inner
from texloom.stages.kernels.core.resample import bilinear
from texloom.stages.kernels.patchmatch.search import random_bits

_UNIT = 1.0 / 9007199254740992.0  # of 53 random bits


@inner
def _uniform(key, position, counter):
    return np.float64(random_bits(key, position, counter) >> np.uint64(11)) * _UNIT


@compiled
def draw_displacements(tables, step, neighbours, grid, most, rounds, key, moves):
    """Visit all vertices ``rounds`` times, each time drawing the displacement of one, given its neighbours.

    Parameters
    ----------
    tables : (4, side, side) float64, for each of the first four directions the logarithm of how likely it is that
        the neighbour's displacement less that of the vertex is the entry's; the middle is for none
    step : px between entries
    neighbours : (n, 8) int64, vertices in the four directions and then in those opposite, in the same order; -1
        for none
    grid : (places, 2) float64, px, moves among which is drawn; all are shifted by up to half of the second less the
        first, so that vertices stand anywhere
    most : px, no displacement is longer along an axis
    rounds : visits of every vertex
    key : uint64, decides the draws
    moves : (n, 2) float64, px, displacements, changed in place
    """
    count, places = moves.shape[0], grid.shape[0]
    middle = (tables.shape[1] - 1) / 2
    pitch = grid[1, 1] - grid[0, 1]
    likely = np.empty(places)
    for number in range(rounds):
        for node in range(count):
            shift_row = (_uniform(key, node, 4 * number) - 0.5) * pitch
            shift_column = (_uniform(key, node, 4 * number + 1) - 0.5) * pitch
            best = -np.inf
            for place in range(places):
                row = moves[node, 0] + grid[place, 0] + shift_row
                column = moves[node, 1] + grid[place, 1] + shift_column
                likely[place] = -np.inf
                if abs(row) > most or abs(column) > most:
                    continue
                total = 0.0
                for side in range(8):
                    other = neighbours[node, side]
                    if other < 0:
                        continue
                    sign = 1.0 if side < 4 else -1.0
                    total += bilinear(
                        tables[side % 4],
                        middle + sign * (moves[other, 0] - row) / step,
                        middle + sign * (moves[other, 1] - column) / step,
                    )
                likely[place] = total
                best = max(best, total)
            if best == -np.inf:
                continue
            weight = 0.0
            for place in range(places):
                likely[place] = math.exp(likely[place] - best)
                weight += likely[place]
            left = _uniform(key, node, 4 * number + 2) * weight
            for place in range(places):
                left -= likely[place]
                if left < 0.0:
                    moves[node, 0] += grid[place, 0] + shift_row
                    moves[node, 1] += grid[place, 1] + shift_column
                    break
