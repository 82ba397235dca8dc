"""A distorted texture laid flat: where in it every pixel of its picture lies, and what it looks like there."""

import dataclasses
from typing import Annotated

import numpy as np
from jaxtyping import Bool, Float32
from pydantic import Field

from texloom.stages.arrays import Channels, Image, Jacobian, Mask
from texloom.stages.common.jacobians import inverted
from texloom.stages.declare import InputError, Params, stage
from texloom.stages.masks import USABLE

_NODES = 20_000  # that places are found at, about
_APART = 8  # px between nodes, at most
_ELSEWHERE = 1e-3  # weight of what lies outside of the texture
_TURNS = 4  # of Newton's method
_NEAR = 0.5  # elements by which a pixel may miss its place


class UnrollParams(Params):
    """How much is laid flat."""

    longest: int = Field(1024, ge=16, le=4096)
    """px of the flat picture's sides, at most; of a larger texture its middle is shown"""


@dataclasses.dataclass(frozen=True)
class Unroll:
    """The texture without its distortion."""

    image: Image
    """one element a pixel; the channel ``usable`` is 0 where the photograph does not show the texture"""
    chart: Annotated[Float32[np.ndarray, "h w 2"], Channels(("row", "column"))]
    """for every pixel of the photograph its row and column in the flat picture, in fractions of a pixel"""


@stage(version=1)
def unroll(image: Image, jacobian: Jacobian, valid: Bool[np.ndarray, "levels h w"], params: UnrollParams) -> Unroll:
    """Lay a distorted texture flat.

    Places in the texture are the least squares solution of what the Jacobians say of the steps between pixels: a
    plane and whatever else can be laid flat is, and the rest is bent a little everywhere. Parts that do not meet
    are as far apart as the Jacobians between them say, which is a guess.

    Parameters
    ----------
    image, jacobian, valid : see `gaussian_stack`; of ``valid`` the finest level counts.

    Raises
    ------
    InputError : no pixel can be used.

    References
    ----------
    Ours; [Eisenacher2008]_ never lays a texture flat.
    """
    from texloom.stages.kernels.core.resample import sampled

    sharp = valid[0]
    if not sharp.any():
        raise InputError("valid: no pixel of the finest level can be used")
    chart = _chart(jacobian, sharp)
    low, high = (getattr(chart[sharp], name)(axis=0) for name in ("min", "max"))
    sides = np.clip(np.ceil(high - low - _NEAR / 8).astype(int) + 1, 1, params.longest)
    chart -= np.rint((low + high) / 2 - (sides - 1) / 2)
    places, usable = _places(chart, jacobian, sharp, (int(sides[0]), int(sides[1])))
    pixels = sampled(image.color.astype(np.float64), places)
    pixels = np.concatenate([pixels, usable[..., None]], axis=2, dtype=np.float32)
    return Unroll(Image(pixels, ("R", "G", "B", USABLE)), chart.astype(np.float32))


def _chart(jacobian: Jacobian, sharp: Mask) -> np.ndarray:
    """Places in the texture of all pixels, (h, w, 2); found at nodes and continued between them by splines."""
    from scipy.interpolate import CubicSpline
    from scipy.sparse import coo_matrix
    from scipy.sparse.linalg import splu

    height, width = sharp.shape
    every = int(np.clip(np.sqrt(sharp.size / _NODES), 1, min(_APART, height // 4, width // 4)))
    rows, columns = (np.arange(-(-(size - 1) // every) + 1) * every for size in (height, width))
    edge = ((0, rows[-1] + 1 - height), (0, columns[-1] + 1 - width))
    inverse = np.pad(inverted(jacobian.astype(np.float64)), (*edge, (0, 0)), mode="edge")
    inside = np.pad(sharp, edge)[::every, ::every]
    number = np.arange(inside.size).reshape(inside.shape)
    begins, ends, steps, weights = [], [], [], []
    for axis in (0, 1):
        along = np.moveaxis(inverse[..., axis::2], axis, 0)  # texture that a px down, or across, is long
        sums = np.concatenate([np.zeros((1, *along.shape[1:])), np.cumsum((along[1:] + along[:-1]) / 2, axis=0)])
        nodes = np.diff(sums[::every], axis=0)[:, ::every]
        first, last = (np.moveaxis(number, axis, 0)[part].ravel() for part in (np.s_[:-1], np.s_[1:]))
        both = np.moveaxis(inside, axis, 0)
        weight = np.where((both[:-1] & both[1:]).ravel(), 1, _ELSEWHERE)
        begins.append(first)
        ends.append(last)
        steps.append(nodes.reshape(-1, 2))
        weights.append(weight / np.maximum((nodes.reshape(-1, 2) ** 2).sum(axis=1), 1e-6))
    begin, end, step, weight = (np.concatenate(parts) for parts in (begins, ends, steps, weights))
    index = np.arange(begin.size)
    ones = np.ones(begin.size)
    differences = coo_matrix((np.r_[ones, -ones], (np.r_[index, index], np.r_[end, begin])))
    weighted = differences.T.multiply(weight).tocsr()
    # one node is pinned: places are known but for a shift
    fixed = coo_matrix(([weight.mean()], ([0], [0])), shape=(inside.size, inside.size))
    found = splu((weighted @ differences + fixed).tocsc()).solve(weighted @ step)
    found = CubicSpline(rows, found.reshape(*inside.shape, 2), axis=0)(np.arange(height))
    return np.asarray(CubicSpline(columns, found, axis=1)(np.arange(width)))


def _places(
    chart: np.ndarray, jacobian: Jacobian, sharp: Mask, shape: tuple[int, int]
) -> tuple[np.ndarray, Bool[np.ndarray, "rows columns"]]:
    """Where in the photograph each pixel of a flat picture is, and whether it is there."""
    from texloom.stages.kernels.core.resample import sampled
    from texloom.stages.masks import nearest_valid

    own = np.argwhere(sharp)
    to = np.rint(chart[sharp]).astype(int)
    inside = ((to >= 0) & (to < shape)).all(axis=1)
    started = np.zeros(shape, np.bool_)
    start = np.zeros((*shape, 2))
    started[tuple(to[inside].T)] = True
    start[tuple(to[inside].T)] = own[inside]
    if not started.any():
        raise InputError("jacobian: the middle of the texture does not lie in the picture")
    around = nearest_valid(started)
    place = start[around[0], around[1]]
    wanted = np.moveaxis(np.indices(shape), 0, 2)
    most = np.array(sharp.shape) - 1
    for _ in range(_TURNS):
        left = wanted - sampled(chart, place)
        row, column = np.moveaxis(np.rint(place).astype(int), 2, 0)
        a, b, c, d = np.moveaxis(jacobian[row, column], 2, 0)
        step = np.stack([a * left[..., 0] + b * left[..., 1], c * left[..., 0] + d * left[..., 1]], axis=2)
        place = np.clip(place + step, 0, most)
    left = wanted - sampled(chart, place)
    row, column = np.moveaxis(np.rint(place).astype(int), 2, 0)
    return place, sharp[row, column] & (np.abs(left) < _NEAR).all(axis=2)
