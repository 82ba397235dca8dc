"""Laying textons on a lattice."""

from typing import Any, NamedTuple

import numpy as np

from texloom.stages.kernels.core.compiled import compiled
from texloom.stages.kernels.core.resample import add_sample, bilinear


class LatticeNodes(NamedTuple):
    """The regular lattice of a result, and the node of each of its cells."""

    inverse: Any
    """(2, 2) float64: places less ``origin``, times this, are lattice coordinates"""
    origin: Any
    """(2,) float64, px"""
    first: Any
    """(2,) int64, lattice step of ``ids[0, 0]``"""
    ids: Any
    """(I, J) int64, nodes; -1 for none"""


class TextonPlaces(NamedTuple):
    """Where the textons of nodes lie in the straightened exemplar."""

    places: Any
    """(nodes, 2) float64, lattice coordinates"""
    generators: Any
    """(2, 2) float64: lattice coordinates times these, plus ``start``, are places, px"""
    start: Any
    """(2,) float64, px"""
    cells: Any
    """(k, 2) int64, steps to the cells that reach into the parallelogram of the generators"""
    weights: Any
    """(m, n, k) float64, of each of them, for samples of the parallelogram"""


@compiled
def lay_textons(pixels, source, places, lattice, textons, out, match):
    """Fill ``out`` with the textons at ``places`` of a regular lattice, blended across borders of cells.

    Parameters
    ----------
    pixels : (h, w, c) float32, the exemplar
    source : (h, w, 2) float32, places in the exemplar of the pixels of the straightened exemplar, px
    places : (n, 2) float64, px in the result before its deformation
    lattice : LatticeNodes
    textons : TextonPlaces
    out : (n, c) float32, output
    match : (n, 2) uint32, output: the exemplar's pixel nearest to that of largest weight
    """
    inverse, origin, first, ids = lattice
    nodes, generators, start, cells, weights = textons
    for index in range(places.shape[0]):
        away_row, away_column = places[index, 0] - origin[0], places[index, 1] - origin[1]
        u = away_row * inverse[0, 0] + away_column * inverse[1, 0]
        v = away_row * inverse[0, 1] + away_column * inverse[1, 1]
        i, j = np.int64(np.floor(u)), np.int64(np.floor(v))
        p = min(np.int64((u - i) * weights.shape[0]), weights.shape[0] - 1)
        q = min(np.int64((v - j) * weights.shape[1]), weights.shape[1] - 1)
        total, most = 0.0, 0.0
        out[index] = 0.0
        for k in range(cells.shape[0]):
            weight = weights[p, q, k]
            y, x = i + cells[k, 0], j + cells[k, 1]
            row, column = y - first[0], x - first[1]
            if weight <= 0.0 or row < 0 or column < 0 or row >= ids.shape[0] or column >= ids.shape[1]:
                continue
            if ids[row, column] < 0:
                continue
            a = nodes[ids[row, column], 0] + (u - y)
            b = nodes[ids[row, column], 1] + (v - x)
            straight_row = a * generators[0, 0] + b * generators[1, 0] + start[0]
            straight_column = a * generators[0, 1] + b * generators[1, 1] + start[1]
            at_row = bilinear(source[:, :, 0], straight_row, straight_column)
            at_column = bilinear(source[:, :, 1], straight_row, straight_column)
            add_sample(pixels, at_row, at_column, weight, out[index])
            total += weight
            if weight > most:
                most = weight
                match[index, 0] = np.uint32(min(max(np.rint(at_row), 0.0), pixels.shape[0] - 1.0))
                match[index, 1] = np.uint32(min(max(np.rint(at_column), 0.0), pixels.shape[1] - 1.0))
        if total > 0.0:
            for channel in range(out.shape[1]):
                out[index, channel] /= total
