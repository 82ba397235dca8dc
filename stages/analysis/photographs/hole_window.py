"""The part of a photograph around a hole, for completion."""

import dataclasses

import numpy as np
from jaxtyping import Bool, Float32, Int64, UInt32
from pydantic import Field

from texloom.stages.analysis.photographs.flattening import charted
from texloom.stages.vocabulary.arrays import Jacobian, Mask
from texloom.stages.vocabulary.declare import InputError, Params, stage


class HoleWindowParams(Params):
    """Size of the window around a hole."""

    margin: int = Field(64, ge=1, le=4096)
    """px around the hole that belong to the window; known pixels among them are continued"""


@dataclasses.dataclass(frozen=True)
class HoleWindow:
    """The hole and its surroundings."""

    jacobian: Jacobian
    """that of the photograph in the window"""
    hole: Mask
    """the pixels to be filled"""
    fixed: Bool[np.ndarray, "H W"]
    """the known pixels of the exemplar, which are kept; pixels in neither are ignored"""
    fixed_match: UInt32[np.ndarray, "H W 2"]
    """row and column in the exemplar of every kept pixel, else 0"""
    corner: Int64[np.ndarray, "2"]
    """row and column in the photograph of the window's first pixel"""
    chart: Float32[np.ndarray, "H W 2"]
    """position of each pixel in the flat texture: that of the nearest pixel of the exemplar, if it is in the same
    photograph, else by the window's own Jacobians"""


@stage(version=1)
def hole_window(
    hole: Mask,
    jacobian: Jacobian,
    params: HoleWindowParams,
    region: Mask | None = None,
    exemplar_corner: Int64[np.ndarray, "2"] | None = None,
    chart: Float32[np.ndarray, "rows columns 2"] | None = None,
) -> HoleWindow:
    """Cut the surroundings of a hole out of a photograph, so that synthesis can continue them into the hole.

    Parameters
    ----------
    hole, jacobian : see `jacobian_field`.
    region : the exemplar's region, if it is in the same photograph.
    exemplar_corner : the exemplar's first pixel in the photograph, see `gaussian_stack`; needed with ``region``.
    chart : positions of the exemplar's pixels in the flat texture, see `unroll`, if it is in the same photograph.

    Raises
    ------
    InputError
        there is no hole.
    ValueError
        the shapes of the inputs do not match.

    References
    ----------
    [Eisenacher2008]_ section 4, completion: known pixels are kept at all levels.
    """
    if hole.shape != jacobian.shape[:2] or (region is not None and region.shape != hole.shape):
        raise ValueError(f"hole of shape {hole.shape} does not match the other arrays")
    if (region is None) != (exemplar_corner is None) or (chart is not None and region is None):
        raise ValueError("region, exemplar_corner and chart must be given together")
    if not hole.any():
        raise InputError("hole: empty; give its polygons in the geometry file, hole: [polygon, ...]")
    rows, columns = (np.flatnonzero(hole.any(axis=axis)) for axis in (1, 0))
    top, left = (max(0, int(line[0]) - params.margin) for line in (rows, columns))
    window = np.s_[top : rows[-1] + 1 + params.margin, left : columns[-1] + 1 + params.margin]
    inside = np.ascontiguousarray(hole[window])
    own = np.moveaxis(np.indices(inside.shape), 0, 2)
    fixed, places = np.zeros_like(inside), np.zeros((*inside.shape, 2), np.uint32)
    if region is not None and exemplar_corner is not None:
        fixed = np.ascontiguousarray(region[window]) & ~inside
        own = own + (np.array([top, left]) - exemplar_corner)
        places = np.where(fixed[..., None], own, 0).astype(np.uint32)
    field = np.ascontiguousarray(jacobian[window])
    if chart is None:
        laid_out = charted(field, inside).astype(np.float32)
    else:
        near = np.clip(own, 0, np.array(chart.shape[:2]) - 1)
        laid_out = chart[near[..., 0], near[..., 1]]
    corner = np.array([top, left], np.int64)
    return HoleWindow(field, inside, fixed, places, corner, laid_out)
