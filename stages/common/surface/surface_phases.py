"""Phases of a repeating texture over a surface."""

import numpy as np
from jaxtyping import Float, Float64, UInt32

from texloom.stages.common.geometry.jacobians import inverted
from texloom.stages.common.surface.chart_seams import linked, within
from texloom.stages.common.surface.texels import Texels
from texloom.stages.kernels.core.elementary_functions import phase_of, phasor, squared_size
from texloom.stages.kernels.core.loading import loaded
from texloom.stages.numerics.matrices import inverse_of, matrix_product

_MAX_TURN = 0.25  # of a repetition between neighbouring texels
_MAX_NODES = 2**17  # texels of the level at which phases are computed, for memory
_DAMPING = 1e-3
_ROUNDS = 24


def surface_phases(levels: list[Texels], generators: Float[np.ndarray, "2 2"]) -> UInt32[np.ndarray, "texels 2"]:
    """Of all texels of the coarsest level, in 2**-32 of each generator; 0 where a texel is not on the surface.

    Neighbours differ by their distance in the texture as well as it is possible everywhere at once. A repetition
    more or less is inserted where the direction or the length of a way around the surface needs it.

    Parameters
    ----------
    levels : finest first.
    generators : displacements by which the texture repeats, px.

    References
    ----------
    [Knoeppel2015]_ section 3, on texels instead of vertices, with vectors of length 1 instead of an eigenvector.
    """
    to_cycles = inverse_of(np.asarray(generators, np.float64))
    nodes = levels[-1]
    for finer in reversed(levels[:-1]):
        step = 2**nodes.number * np.abs(to_cycles).sum(axis=0).max()
        if step <= _MAX_TURN or finer.flat.size > _MAX_NODES:
            break
        nodes = finer
    parts = [*within(nodes, np.arange(nodes.flat.size)), *linked(nodes)]
    one, other, offset = (np.concatenate(part) for part in zip(*parts, strict=True))
    cycles = np.stack(
        [_synchronised(nodes.flat.size, one, other, turn) for turn in matrix_product(offset, to_cycles).T], axis=1
    )
    coarse = levels[-1]
    at, moved = _nearest(nodes, coarse)
    phases = np.zeros((coarse.tiles.shape[0] * coarse.tiles.shape[1], 2), np.uint32)
    phases[coarse.flat] = (
        np.rint((cycles[at] + matrix_product(moved, to_cycles)) % 1 * 2**32).astype(np.int64) % 2**32
    )
    return phases


def _synchronised(count: int, one: np.ndarray, other: np.ndarray, turn: np.ndarray) -> Float64[np.ndarray, "*n"]:
    """A phase for each node, in cycles, so that those of others are ``turn`` more than those of ones."""
    sparse = loaded("scipy.sparse")
    linalg = loaded("scipy.sparse.linalg")
    relation = phasor(2 * np.pi * turn)
    pairs = np.concatenate([other, one]), np.concatenate([one, other])
    agreed = sparse.coo_array((np.concatenate([relation, relation.conj()]), pairs), shape=(count, count)).tocsc()
    degree = np.bincount(pairs[0], minlength=count)
    laplacian = sparse.coo_array((degree + _DAMPING, (np.arange(count), np.arange(count))), shape=(count, count))
    solver = linalg.splu((laplacian - agreed).tocsc())
    vector = np.ones(count, np.complex128)
    for _ in range(_ROUNDS):
        vector = solver.solve(vector)
        vector /= np.maximum(np.sqrt(squared_size(vector)), 1e-300)
    return np.asarray(phase_of(vector) / (2 * np.pi))


def _nearest(nodes: Texels, coarse: Texels) -> tuple[np.ndarray, np.ndarray]:
    """The node of the same chart nearest to each coarse texel, and the way from there in texture, px."""
    spatial = loaded("scipy.spatial")

    def places(texels: Texels) -> np.ndarray:
        return np.asarray((texels.in_result(texels.flat, texels.place) + 0.5) * 2**texels.number - 0.5)

    there, here = places(nodes), places(coarse)
    far = 4.0 * max(np.abs(there).max(), np.abs(here).max())
    apart = spatial.KDTree(np.column_stack([there, nodes.place * far]))
    at = np.asarray(apart.query(np.column_stack([here, coarse.place * far]))[1])
    to_texture = inverted(nodes.jacobian[:, at])[0].reshape(-1, 2, 2).astype(np.float64)
    return at, np.einsum("nij,nj->ni", to_texture, here - there[at])
