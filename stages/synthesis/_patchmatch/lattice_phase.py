"""Lattice phase: features that keep a result on the exemplar's lattice."""

import numpy as np
from jaxtyping import Float32

from texloom.stages.arrays import Correspondence, Vectors


class LatticePhase:
    """Position within a lattice cell of exemplar and target pixels, as points on two circles.

    Pixels at the same position in their cells have the same four values; half a cell apart they are opposite. The
    target's phase continues the mean one of the start; on a torus its generators are stretched to whole cells.
    With one generator, that of courses, there is one circle, and positions along the courses do not matter.

    Parameters
    ----------
    generators : px, two rows or one.
    start : exemplar pixel of every target pixel.
    wrap : the target is a torus.
    """

    def __init__(self, generators: Vectors, start: Correspondence, wrap: bool):
        self.exemplar = _inverse(generators.astype(np.float64))  # pixel (row, column) @ this = cells
        self.target = self.exemplar
        if wrap:
            sides = np.array(start.shape[:2], np.float64)
            cells = np.rint(self.exemplar * sides[:, None])
            if np.linalg.matrix_rank(cells) == len(generators):
                self.target = cells / sides[:, None]
        total = np.zeros(len(generators), np.complex128)
        columns = np.arange(start.shape[1])
        for row, line in enumerate(start):  # one by one, as intermediate values take many times the memory
            own = np.stack([np.full_like(columns, row), columns], axis=1)
            drift = line @ self.exemplar - own @ self.target
            total += np.exp(2j * np.pi * drift).sum(axis=0)
        self.origin = np.angle(total / (start.shape[0] * start.shape[1])) / (2 * np.pi)

    def of_exemplar(self, height: int, width: int, factor: float) -> Float32[np.ndarray, "h w k"]:
        """Phases of an exemplar's pixels at the scale of ``factor``."""
        return _circles(height, width, factor, 0, self.exemplar, np.zeros(self.exemplar.shape[1]))

    def of_target(self, height: int, width: int, factor: float, margin: int) -> Float32[np.ndarray, "H W k"]:
        """Phases of a target's pixels at the scale of ``factor``; it begins ``margin`` px before the start."""
        return _circles(height, width, factor, margin, self.target, self.origin)


def min_spacing(generators: Vectors) -> float:
    """The shorter distance between neighbouring lattice lines, or that between courses, px."""
    longest = float(np.hypot(*generators.T).max())
    return (
        longest if len(generators) == 1 else float(abs(np.linalg.det(generators)) / np.hypot(*generators.T).max())
    )


def _inverse(generators: np.ndarray) -> np.ndarray:
    """Matrix (2, k) from positions to steps along the k generators."""
    if len(generators) == 2:
        return np.linalg.inv(generators)
    return np.asarray(generators.T / (generators**2).sum())


def _circles(
    height: int, width: int, factor: float, margin: int, cells: np.ndarray, origin: np.ndarray
) -> Float32[np.ndarray, "h w k"]:
    rows, columns = (((np.arange(side) + 0.5) / factor - 0.5 - margin) for side in (height, width))
    angle = 2 * np.pi * (rows[:, None, None] * cells[0] + columns[None, :, None] * cells[1] + origin)
    return np.concatenate([np.cos(angle), np.sin(angle)], axis=2).astype(np.float32)
