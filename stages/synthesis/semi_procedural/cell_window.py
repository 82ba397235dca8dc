"""The window function of a lattice's cells: how much each of them counts around its outline."""

import math

import numpy as np
from jaxtyping import Float32, Float64, Int64

from texloom.stages.numerics.matrices import determinant, inverse_of, matrix_product
from texloom.stages.synthesis.near_regular.cell_outline import CellOutline
from texloom.stages.synthesis.near_regular.lattice_tiles import Window


def window_of(outline: CellOutline, band: float) -> tuple[Float32[np.ndarray, "m n"], Int64[np.ndarray, "2"]]:
    """Weights of a cell, 0..1, and the offset of the first one from its point of the lattice, px.

    They fall from 1 to 0 across ``band`` px on either side of the outline, by the distance from it. With their
    copies at all points of the lattice they add up to 1. Those of rectangles are products of one along each side,
    so that they do so too where rows of cells are displaced.

    Parameters
    ----------
    outline : of a lattice whose generators are whole px.

    References
    ----------
    [Guehl2020]_: a window function around each point of a process.
    """
    around = Window.of(outline, band)
    first = around.offsets.min(axis=0) - 1  # with a border of zeros, for bilinear interpolation
    weights = np.zeros(around.offsets.max(axis=0) + 2 - first)
    if outline.phase is None:
        weights[tuple((around.offsets - first).T)] = _rising(around.depth, band)
    else:
        places = (np.moveaxis(np.indices(weights.shape), 0, -1) + first).astype(np.float64)
        shares = matrix_product(places, inverse_of(outline.generators)) - np.array(outline.phase)
        base = float(np.hypot(*outline.generators[1]))
        sides = np.array([abs(determinant(outline.generators)) / base, base])
        weights = np.prod(_rising(np.minimum(shares, 1 - shares) * sides, band), axis=2)
    total = _with_copies(weights, outline.generators)
    return np.where(weights > 0, weights / np.maximum(total, 1e-9), 0).astype(np.float32), first


def reach(
    window: Float32[np.ndarray, "m n"], first: Int64[np.ndarray, "2"], generators: Float64[np.ndarray, "2 2"]
) -> tuple[list[float], list[int]]:
    """The least step from a point whose cell reaches a place to that place, and how many may, by generator."""
    corners = np.array([(-1, -1), (-1, 1), (1, -1), (1, 1)])
    places = (np.argwhere(window > 0) + first)[:, None] + corners
    steps = matrix_product(places.reshape(-1, 2), inverse_of(generators))
    low = steps.min(axis=0).astype(np.float32)
    return low.tolist(), [math.floor(one) + 1 for one in steps.max(axis=0) - low]


def _rising(depth: np.ndarray, band: float) -> np.ndarray:
    """From 0 to 1 across the band, smoothly."""
    share = np.clip((depth + band) / (2 * band), 0, 1)
    return np.asarray(share * share * (3 - 2 * share), np.float64)


def _with_copies(weights: Float64[np.ndarray, "m n"], generators: np.ndarray) -> Float64[np.ndarray, "m n"]:
    """The sum with its copies at all points of the lattice."""
    m, n = weights.shape
    corners = matrix_product(np.array([(0, 0), (0, n), (m, 0), (m, n)]), inverse_of(generators))
    far = np.ceil(np.ptp(corners, axis=0)).astype(int) + 1
    total = np.zeros_like(weights)
    for i, j in np.ndindex(*(2 * far + 1)):
        down, across = np.rint(matrix_product(np.array([i, j]) - far, generators)).astype(int).tolist()
        if abs(down) < m and abs(across) < n:
            to, of = (
                np.s_[max(0, y) : m + min(0, y), max(0, x) : n + min(0, x)]
                for y, x in ((down, across), (-down, -across))
            )
            total[to] += weights[of]
    return total
