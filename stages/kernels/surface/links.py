"""Exemplar positions carried over the borders of charts."""

import numpy as np

from texloom.stages.kernels.core.compiled import compiled
from texloom.stages.kernels.per_pixel.positions import advect


@compiled
def carry(states, targets, sources, offsets, jacobian, pitch, rows, first, last):
    """Give texels outside their chart what continues a texel of the surface there.

    Parameters
    ----------
    states : (n,) int64, positions, see `texloom.stages.kernels.per_pixel.arguments`; in and out
    targets, sources : (m,) int64, indices of ``states``; no target is a source
    offsets : (m, 2) float32, from source to target in texture, px
    jacobian, pitch, rows : of the exemplar
    """
    for at in range(first, last):
        u, v = offsets[at, 0], offsets[at, 1]
        states[targets[at]] = advect(states[sources[at]], np.float32(u), np.float32(v), jacobian, pitch, rows)
