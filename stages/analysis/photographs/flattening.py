"""Positions of a photograph's pixels in the flat texture, and of the flat texture's in the photograph."""

import numpy as np
from jaxtyping import Bool

from texloom.stages.common.geometry.jacobians import inverted
from texloom.stages.kernels.core.loading import loaded
from texloom.stages.numerics.matrices import cubic_spline, solve_symmetric
from texloom.stages.vocabulary.arrays import Jacobian, Mask
from texloom.stages.vocabulary.declare import InputError

_NODES = 20_000  # approximate number at which positions are solved
_MAX_NODE_SPACING = 8  # px
_OUTSIDE_WEIGHT = 1e-3  # of steps outside the texture
_NEWTON_STEPS = 4
_PIECES = 16
_MAX_MISS = 0.5  # elements between a pixel's position and the nearest one in the photograph


def charted(jacobian: Jacobian, sharp: Mask) -> np.ndarray:
    """Positions in the texture of all pixels, (h, w, 2): solved at nodes and interpolated by cubic splines."""
    sparse = loaded("scipy.sparse")
    height, width = sharp.shape
    every = int(np.clip(np.sqrt(sharp.size / _NODES), 1, min(_MAX_NODE_SPACING, height // 4, width // 4)))
    rows, columns = (np.arange(-(-(size - 1) // every) + 1) * every for size in (height, width))
    edge = ((0, rows[-1] + 1 - height), (0, columns[-1] + 1 - width))
    inverse = np.pad(inverted(jacobian.astype(np.float64)), (*edge, (0, 0)), mode="edge")
    inside = np.pad(sharp, edge)[::every, ::every]
    number = np.arange(inside.size).reshape(inside.shape)
    begins, ends, steps, weights = [], [], [], []
    for axis in (0, 1):
        along = np.moveaxis(inverse[..., axis::2], axis, 0)  # elements per px down, or across
        sums = np.concatenate([np.zeros((1, *along.shape[1:])), np.cumsum((along[1:] + along[:-1]) / 2, axis=0)])
        nodes = np.diff(sums[::every], axis=0)[:, ::every]
        first, last = (np.moveaxis(number, axis, 0)[part].ravel() for part in (np.s_[:-1], np.s_[1:]))
        both = np.moveaxis(inside, axis, 0)
        weight = np.where((both[:-1] & both[1:]).ravel(), 1, _OUTSIDE_WEIGHT)
        begins.append(first)
        ends.append(last)
        steps.append(nodes.reshape(-1, 2))
        weights.append(weight / np.maximum((nodes.reshape(-1, 2) ** 2).sum(axis=1), 1e-6))
    begin, end, step, weight = (np.concatenate(parts) for parts in (begins, ends, steps, weights))
    index = np.arange(begin.size)
    ones = np.ones(begin.size)
    differences = sparse.coo_matrix((np.r_[ones, -ones], (np.r_[index, index], np.r_[end, begin])))
    weighted = differences.T.multiply(weight).tocsr()
    # One node is fixed, since positions are determined up to a shift.
    fixed = sparse.coo_matrix(([weight.mean()], ([0], [0])), shape=(inside.size, inside.size))
    solution = solve_symmetric(weighted @ differences + fixed, weighted @ step)
    down = cubic_spline(solution.reshape(rows.size, -1), every, height).reshape(height, columns.size, 2)
    across = cubic_spline(down.swapaxes(0, 1).reshape(columns.size, -1), every, width)
    return np.ascontiguousarray(across.reshape(width, height, 2).swapaxes(0, 1))


def photo_positions(
    chart: np.ndarray, jacobian: Jacobian, sharp: Mask, shape: tuple[int, int]
) -> tuple[np.ndarray, Bool[np.ndarray, "rows columns"]]:
    """The position in the photograph of each pixel of the flat image, and whether the photograph shows it."""
    from texloom.stages.kernels.core.threads import run_spans
    from texloom.stages.kernels.distortion.flat_positions import find_positions
    from texloom.stages.vocabulary.masks import nearest_valid

    own = np.argwhere(sharp)
    to = np.rint(chart[sharp]).astype(int)
    inside = ((to >= 0) & (to < shape)).all(axis=1)
    started = np.zeros(shape, np.bool_)
    start = np.zeros((*shape, 2))
    started[tuple(to[inside].T)] = True
    start[tuple(to[inside].T)] = own[inside]
    if not started.any():
        raise InputError("jacobian: the centre of the texture is outside the photograph")
    nearest = nearest_valid(started)
    position, shown = start[nearest[0], nearest[1]], np.empty(shape, np.bool_)
    shared = (chart, jacobian, sharp, _NEWTON_STEPS, _MAX_MISS, position, shown)
    run_spans(find_positions, shared, shape[0], _PIECES)
    return position, shown
