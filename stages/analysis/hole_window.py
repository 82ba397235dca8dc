"""Where in a photograph texture is to be made, and what it continues."""

import dataclasses

import numpy as np
from jaxtyping import Bool, Float32, Int64, UInt32
from pydantic import Field

from texloom.stages.arrays import Jacobian, Mask
from texloom.stages.declare import InputError, Params, stage


class HoleWindowParams(Params):
    """How much around a hole is looked at."""

    around: int = Field(64, ge=1, le=4096)
    """px around the hole that are made with it; what is known among them is continued"""


@dataclasses.dataclass(frozen=True)
class HoleWindow:
    """The hole and some of what is around it."""

    jacobian: Jacobian
    """the photograph's there"""
    hole: Mask
    """the pixels to be filled"""
    fixed: Bool[np.ndarray, "H W"]
    """the pixels that stay, each of which is itself; what is neither there nor in the hole does not matter"""
    fixed_match: UInt32[np.ndarray, "H W 2"]
    """row and column of every pixel in the exemplar; 0 where it is not in it"""
    corner: Int64[np.ndarray, "2"]
    """row and column in the photograph of the window's first pixel"""
    chart: Float32[np.ndarray, "H W 2"]
    """where each pixel lies in the flat texture, as the exemplar's nearest does; 0 where no chart is given"""


@stage(version=1)
def hole_window(
    hole: Mask,
    jacobian: Jacobian,
    params: HoleWindowParams,
    region: Mask | None = None,
    exemplar_corner: Int64[np.ndarray, "2"] | None = None,
    chart: Float32[np.ndarray, "rows columns 2"] | None = None,
) -> HoleWindow:
    """Cut out of a photograph where a hole is, with the texture around it, so that what fills it continues that.

    Parameters
    ----------
    hole, jacobian : see `jacobian_field`.
    region : the texture that is continued, if it is that of the same photograph.
    exemplar_corner : where in the photograph the exemplar begins, see `gaussian_stack`; needed with ``region``.
    chart : where the exemplar's pixels lie in the flat texture, see `unroll`.

    Raises
    ------
    InputError : there is no hole.
    ValueError : inputs that do not belong together.

    References
    ----------
    [Eisenacher2008]_ section 4, completion: the pixels that are known stay at all levels.
    """
    if hole.shape != jacobian.shape[:2] or (region is not None and region.shape != hole.shape):
        raise ValueError(f"hole of shape {hole.shape} for other arrays of another")
    if (region is None) != (exemplar_corner is None):
        raise ValueError("region and exemplar_corner: one is missing")
    if not hole.any():
        raise InputError("hole: nothing is to be filled; the file of patches says what, hole: [polygon, ...]")
    rows, columns = (np.flatnonzero(hole.any(axis=axis)) for axis in (1, 0))
    top, left = (max(0, int(line[0]) - params.around) for line in (rows, columns))
    window = np.s_[top : rows[-1] + 1 + params.around, left : columns[-1] + 1 + params.around]
    inside = np.ascontiguousarray(hole[window])
    own = np.moveaxis(np.indices(inside.shape), 0, 2)
    laid = np.zeros((*inside.shape, 2), np.float32)
    fixed, places = np.zeros_like(inside), np.zeros((*inside.shape, 2), np.uint32)
    if region is not None and exemplar_corner is not None:
        fixed = np.ascontiguousarray(region[window]) & ~inside
        own = own + (np.array([top, left]) - exemplar_corner)
        places = np.where(fixed[..., None], own, 0).astype(np.uint32)
        if chart is not None:
            near = np.clip(own, 0, np.array(chart.shape[:2]) - 1)
            laid = chart[near[..., 0], near[..., 1]]
    corner = np.array([top, left], np.int64)
    return HoleWindow(np.ascontiguousarray(jacobian[window]), inside, fixed, places, corner, laid)
