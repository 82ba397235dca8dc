"""The regular lattice of a result, which may be a torus."""

import itertools
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float64, Int64

from texloom.stages.common.regularity.lattice_strain import lattice_strain, visibility
from texloom.stages.numerics.matrices import determinant, inverse_of, matrix_product
from texloom.stages.vocabulary.declare import InputError
from texloom.stages.vocabulary.facts import Wraps
from texloom.stages.vocabulary.sizes import format_size

_MARGIN = 2.0  # cells around the result that have nodes
_MAX_NODES = 1 << 20
_MAX_CHANGE = 0.25  # squared change of the lattice of a tileable result, relative to the generators


@dataclass(frozen=True)
class OutputLattice:
    """Nodes represent vertices, and the cells whose first corner they are."""

    generators: Float64[np.ndarray, "2 2"]
    """px"""
    size: tuple[int, int]
    """of the result, px"""
    tileable: bool
    steps: Int64[np.ndarray, "nodes 2"]
    """along the generators from (0, 0) at pixel (0, 0); in a tileable result one of each node's equivalent steps"""
    first: Int64[np.ndarray, "2"]
    """the step of ``ids[0, 0]``"""
    ids: Int64[np.ndarray, "I J"]
    """node at each step; -1 far from the result"""

    _periods: Int64[np.ndarray, "2 2"] | None
    """of a tileable result, steps from its top to its bottom and from its left to its right"""
    _classes: Int64[np.ndarray, " classes"]
    """of a tileable result, the equivalence class of each node's steps"""

    @classmethod
    def of(cls, generators: np.ndarray, size: tuple[int, int], tileable: bool) -> "OutputLattice":
        """The lattice for a result; for a tileable one the most similar lattice with its periods.

        Raises
        ------
        InputError
            a tileable result is smaller than a cell, or there are too many cells.
        """
        own, periods = np.asarray(generators, np.float64), None
        if tileable:
            periods = _periods(own, size)
            own = matrix_product(inverse_of(periods), np.diag(size).astype(np.float64))
        corners = matrix_product(np.array([(0, 0), (0, size[1]), (size[0], 0), size]), inverse_of(own))
        low = np.floor(corners.min(axis=0) - _MARGIN).astype(np.int64)
        high = np.ceil(corners.max(axis=0) + _MARGIN).astype(np.int64)
        if np.prod(high - low + 1) > _MAX_NODES:
            raise InputError(f"size: {format_size(size)} are too many cells of the lattice")
        grid = np.moveaxis(np.indices(high - low + 1), 0, -1) + low
        flat = grid.reshape(-1, 2)
        if periods is not None:
            classes, first, ids = np.unique(_step_class(flat, periods), return_index=True, return_inverse=True)
            return cls(own, size, tileable, flat[first], low, ids.reshape(grid.shape[:2]), periods, classes)
        margin = _MARGIN * np.abs(own).max(axis=0)
        places = matrix_product(flat, own)
        near = ((places >= -margin) & (places <= np.array(size) + margin)).all(axis=1)
        ids = np.where(near, np.cumsum(near) - 1, -1).reshape(grid.shape[:2])
        return cls(own, size, tileable, flat[near], low, ids, None, np.zeros(0, np.int64))

    @property
    def places(self) -> Float64[np.ndarray, "nodes 2"]:
        """Positions of the nodes, px; inside a tileable result."""
        places = matrix_product(self.steps, self.generators)
        return np.asarray(places % self.size if self.tileable else places)

    def neighbours(self, directions: tuple[tuple[int, int], ...]) -> Int64[np.ndarray, "nodes directions"]:
        """Node one step away in each direction; -1 for none."""
        steps = self.steps[:, None] + np.array(directions)
        if self._periods is not None:
            return np.searchsorted(self._classes, _step_class(steps, self._periods))
        at = np.clip(steps - self.first, 0, np.array(self.ids.shape) - 1)
        inside = (at == steps - self.first).all(axis=-1)
        return np.where(inside, self.ids[at[..., 0], at[..., 1]], -1)


def _step_class(steps: Int64[np.ndarray, "*n 2"], periods: Int64[np.ndarray, "2 2"]) -> Int64[np.ndarray, "*n"]:
    """Numbers that are equal for steps which differ by periods of the torus, and for no others."""
    cells = int(periods[0, 0] * periods[1, 1] - periods[0, 1] * periods[1, 0])
    adjugate = np.array([[periods[1, 1], -periods[0, 1]], [-periods[1, 0], periods[0, 0]]])
    remainders = matrix_product(steps, adjugate) % abs(cells)
    return np.asarray(remainders[..., 0] * abs(cells) + remainders[..., 1])


def _periods(generators: Float64[np.ndarray, "2 2"], size: tuple[int, int]) -> Int64[np.ndarray, "2 2"]:
    """Steps along each generator that span the result's height, and its width, with the least visible change."""
    exact = matrix_product(np.diag(size), inverse_of(generators))
    best, least, possible = None, np.inf, False
    for change in itertools.product((-1, 0, 1), repeat=4):
        periods = np.rint(exact).astype(np.int64) + np.array(change).reshape(2, 2)
        if abs(determinant(periods)) < 0.5:
            continue
        own = matrix_product(inverse_of(periods), np.diag(size))
        possible |= float(((matrix_product(own, inverse_of(generators)) - np.eye(2)) ** 2).sum()) <= _MAX_CHANGE
        cost = visibility(lattice_strain(generators, own))
        if cost < least:
            best, least = periods, cost
    if best is None or not possible:
        raise InputError(f"size: {format_size(size)} is smaller than a cell of the lattice, so it cannot tile")
    return best


def torus_of(generators: np.ndarray, size: tuple[int, int], wrap: Wraps) -> tuple[int, int]:
    """Sides of the torus on which a tileable result is made, px: a cell larger where it need not continue."""
    cell = np.ceil(np.abs(generators).sum(axis=0))
    height, width = (side + (0 if around else int(one)) for side, one, around in zip(size, cell, wrap, strict=True))
    return height, width
