"""The regular lattice of a result, whose steps may go around a torus."""

import itertools
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float64, Int64

from texloom.stages.declare import InputError

_MARGIN = 2.0  # cells beyond the result that have nodes too
_LARGEST = 1 << 20  # nodes
_BENT = 0.25  # most that the lattice of a tileable result may differ, squared, in generators
_SLANT = np.array([[1.0, 9.0], [9.0, 1.0]])  # rows that slope are seen sooner than ones that are wider apart


@dataclass(frozen=True)
class OutputLattice:
    """Nodes stand for vertices, and for the cells that begin there."""

    generators: Float64[np.ndarray, "2 2"]
    """px"""
    size: tuple[int, int]
    """of the result, px"""
    tileable: bool
    steps: Int64[np.ndarray, "nodes 2"]
    """along the generators from (0, 0) at pixel (0, 0); of a tileable result one of each node's"""
    first: Int64[np.ndarray, "2"]
    """the step of ``ids[0, 0]``"""
    ids: Int64[np.ndarray, "I J"]
    """node at each step; -1 far from the result"""

    _turns: Int64[np.ndarray, "2 2"] | None
    _kinds: Int64[np.ndarray, " kinds"]
    """of a tileable result, for each node a number that all its steps have in common"""

    @classmethod
    def of(cls, generators: np.ndarray, size: tuple[int, int], tileable: bool) -> "OutputLattice":
        """The lattice for a result.

        That of a tileable one is the nearest that repeats with it; `InputError` if a cell is larger than that.
        """
        own, turns = np.asarray(generators, np.float64), None
        if tileable:
            turns = _turns(own, size)
            own = np.linalg.inv(turns) @ np.diag(size).astype(np.float64)
        corners = np.array([(0, 0), (0, size[1]), (size[0], 0), size]) @ np.linalg.inv(own)
        low = np.floor(corners.min(axis=0) - _MARGIN).astype(np.int64)
        high = np.ceil(corners.max(axis=0) + _MARGIN).astype(np.int64)
        if np.prod(high - low + 1) > _LARGEST:
            raise InputError(f"size: {size[0]}x{size[1]} px are too many cells of the lattice")
        grid = np.moveaxis(np.indices(high - low + 1), 0, -1) + low
        flat = grid.reshape(-1, 2)
        if turns is not None:
            kinds, which, ids = np.unique(_kind(flat, turns), return_index=True, return_inverse=True)
            return cls(own, size, tileable, flat[which], low, ids.reshape(grid.shape[:2]), turns, kinds)
        margin = _MARGIN * np.abs(own).max(axis=0)
        places = flat @ own
        near = ((places >= -margin) & (places <= np.array(size) + margin)).all(axis=1)
        ids = np.where(near, np.cumsum(near) - 1, -1).reshape(grid.shape[:2])
        return cls(own, size, tileable, flat[near], low, ids, None, np.zeros(0, np.int64))

    @property
    def places(self) -> Float64[np.ndarray, "nodes 2"]:
        """Where the nodes are, px; of a tileable result within it."""
        places = self.steps @ self.generators
        return np.asarray(places % self.size if self.tileable else places)

    def neighbours(self, directions: tuple[tuple[int, int], ...]) -> Int64[np.ndarray, "nodes directions"]:
        """Node one step away in each direction; -1 where none is."""
        steps = self.steps[:, None] + np.array(directions)
        if self._turns is not None:
            return np.searchsorted(self._kinds, _kind(steps, self._turns))
        at = np.clip(steps - self.first, 0, np.array(self.ids.shape) - 1)
        inside = (at == steps - self.first).all(axis=-1)
        return np.where(inside, self.ids[at[..., 0], at[..., 1]], -1)


def _kind(steps: Int64[np.ndarray, "*n 2"], turns: Int64[np.ndarray, "2 2"]) -> Int64[np.ndarray, "*n"]:
    """Equal for steps that differ by turns around the torus, and for no others."""
    cells = int(turns[0, 0] * turns[1, 1] - turns[0, 1] * turns[1, 0])
    adjugate = np.array([[turns[1, 1], -turns[0, 1]], [-turns[1, 0], turns[0, 0]]])
    shares = (steps @ adjugate) % abs(cells)
    return np.asarray(shares[..., 0] * abs(cells) + shares[..., 1])


def _turns(generators: Float64[np.ndarray, "2 2"], size: tuple[int, int]) -> Int64[np.ndarray, "2 2"]:
    """How many steps along each generator lead once down and once across the result, by which it is bent least."""
    exact = np.diag(size) @ np.linalg.inv(generators)
    best, least, possible = None, np.inf, False
    for change in itertools.product((-1, 0, 1), repeat=4):
        turns = np.rint(exact).astype(np.int64) + np.array(change).reshape(2, 2)
        if abs(np.linalg.det(turns)) < 0.5:
            continue
        own = np.linalg.inv(turns) @ np.diag(size)
        possible |= float(((own @ np.linalg.inv(generators) - np.eye(2)) ** 2).sum()) <= _BENT
        bend = np.linalg.inv(generators) @ own - np.eye(2)
        bent = float((bend**2 * _SLANT).sum())
        if bent < least:
            best, least = turns, bent
    if best is None or not possible:
        raise InputError(f"size: {size[0]}x{size[1]} px is smaller than a cell of the lattice, so it cannot tile")
    return best
