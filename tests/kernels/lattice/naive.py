"""Slow readable twins of the kernels of lattices."""

import math

import numpy as np

from tests.kernels.core.naive import bilinear, sampled
from tests.kernels.patchmatch.naive import random_bits


def lattice_sums(
    density: np.ndarray, mass: np.ndarray, penalty: float, first: np.ndarray, second: np.ndarray
) -> tuple[float, int, float]:
    """Score, number of points and mass that one lattice collects, one point of each pair of opposites."""
    if abs(np.linalg.det([first, second])) < 1:
        return 0.0, 0, 0.0
    reach = np.array(density.shape) // 2
    score, number, total = 0.0, 0, 0.0
    steps = range(-sum(density.shape), sum(density.shape) + 1)
    for a, b in ((a, b) for a in steps if a >= 0 for b in steps if a > 0 or b > 0):
        offset = a * first + b * second
        if (np.abs(offset) > reach).any():
            continue
        row, column = np.rint(offset).astype(int) + reach
        value = float(density[row, column])
        score += value if value > 0 else -penalty
        number += 1
        total += float(mass[row, column])
    return score, number, total


def laid_texton(
    pixels: np.ndarray,
    source: np.ndarray,
    place: np.ndarray,
    origin: np.ndarray,
    lattice: np.ndarray,
    textons: dict[tuple[int, int], np.ndarray],
    generators: np.ndarray,
    start: np.ndarray,
    cells: np.ndarray,
    weights: np.ndarray,
) -> np.ndarray:
    """What textons, by the steps of their cells, show at a place: as much of each as the table says."""
    at = (place - origin) @ np.linalg.inv(lattice)
    corner = np.floor(at).astype(int)
    sample = np.minimum((at - corner) * weights.shape[:2], np.array(weights.shape[:2]) - 1).astype(int)
    total, value = 0.0, np.zeros(pixels.shape[2])
    for cell, weight in zip(cells, weights[tuple(sample)], strict=True):
        step = tuple(corner + cell)
        if weight > 0 and step in textons:
            straight = (textons[step] + at - step) @ generators + start
            value += weight * sampled(pixels, *bilinear(source, *straight))
            total += weight
    return value / total


def draw_displacements(
    tables: np.ndarray,
    step: float,
    neighbours: np.ndarray,
    grid: np.ndarray,
    most: float,
    rounds: int,
    key: int,
    moves: np.ndarray,
) -> np.ndarray:
    """Gibbs sampling of the vertices, in turn."""

    def uniform(node: int, counter: int) -> float:
        return (random_bits(key, node, counter) >> 11) / 2**53

    moves = moves.copy()
    middle = (tables.shape[1] - 1) / 2
    pitch = grid[1, 1] - grid[0, 1]
    for number in range(rounds):
        for node in range(len(moves)):
            shift = (np.array([uniform(node, 4 * number), uniform(node, 4 * number + 1)]) - 0.5) * pitch
            places = moves[node] + grid + shift
            likely = []
            for place in places:
                logarithm = 0.0 if (np.abs(place) <= most).all() else -np.inf
                for side, other in enumerate(neighbours[node]):
                    if other >= 0:
                        away = (moves[other] - place) * (1 if side < 4 else -1)
                        logarithm += float(bilinear(tables[side % 4], *(middle + away / step)))
                likely.append(logarithm)
            if max(likely) == -np.inf:
                continue
            weights = np.cumsum([math.exp(value - max(likely)) for value in likely])
            chosen = int(np.searchsorted(weights, uniform(node, 4 * number + 2) * weights[-1], side="right"))
            moves[node] = places[chosen]
    return moves


def course_sums(
    plane: np.ndarray,
    across: np.ndarray,
    along: np.ndarray,
    bins: int,
    segments: tuple[int, float],
    sums: np.ndarray,
) -> None:
    """Numbers and values of pixels by segment and bin; ``across`` and ``along``, (h, w), begin at 0."""
    for place, value in np.ndenumerate(plane):
        segment = min(int(along[place] * segments[1]), segments[0] - 1)
        share, slot = math.modf(across[place] * bins)
        for number, one in enumerate((1.0, float(value))):
            sums[number, :, segment, int(slot)] += one, share * one
