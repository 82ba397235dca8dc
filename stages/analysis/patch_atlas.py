"""The patches of a photograph as seen from the front, side by side in one image."""

import dataclasses
from typing import Any

import numpy as np
from jaxtyping import Bool, Float32
from pydantic import Field

from texloom.stages.analysis._distortion import bezier
from texloom.stages.arrays import Image, Mask
from texloom.stages.common.footprints import resampled
from texloom.stages.common.packing import arranged
from texloom.stages.declare import InputError, Params, stage
from texloom.stages.masks import USABLE


class PatchAtlasParams(Params):
    """Size of the atlas."""

    gap: int = Field(16, ge=1, le=256)
    """px between two patches"""
    max_side: int = Field(1024, ge=16, le=8192)
    """maximum side of a patch, px; with a larger one all are reduced"""


@dataclasses.dataclass(frozen=True)
class PatchAtlas:
    """The patches."""

    image: Image
    """R G B, and ``usable``, which is 0 where the photograph does not show the texture"""
    keep: Bool[np.ndarray, "H W"]
    """whether the photograph shows it"""
    table: dict[str, Any]
    """``patches``: row, column, height and width of each in the atlas, px, in the order of the geometry file"""


@stage(version=1)
def patch_atlas(
    image: Image,
    region: Mask,
    controls: Float32[np.ndarray, "patches 4 4 3"],
    spaces: Float32[np.ndarray, "patches 4 4 3"],
    sizes: Float32[np.ndarray, "patches 2"],
    scale: float,
    params: PatchAtlasParams,
) -> PatchAtlas:
    """Show every patch from the front, at one scale, in an atlas.

    Parameters
    ----------
    image : the photograph.
    region, controls, spaces, sizes, scale : see `jacobian_field`; a px of the atlas is an element of texture.

    Raises
    ------
    InputError
        no patch shows any of the region.

    References
    ----------
    [Eisenacher2008]_ section 3.1, the patches; [Heckbert1989]_ elliptical weighted averages.
    """
    factor = scale * min(1.0, params.max_side / (scale * float(sizes.max())))
    shapes = [(max(1, round(height)), max(1, round(width))) for height, width in (sizes * factor).tolist()]
    rectangles, (rows, columns) = arranged(shapes, params.gap)
    canvas = np.zeros((rows, columns, 4), np.float32)
    for patch, space, (top, left, height, width) in zip(
        controls.astype(np.float64), spaces.astype(np.float64), rectangles.tolist(), strict=True
    ):
        places = bezier.even_points(patch, space, (height, width))
        down, across = (np.gradient(places, axis=axis) if places.shape[axis] > 1 else 0 * places for axis in (0, 1))
        feet = np.stack([down[..., 0], across[..., 0], down[..., 1], across[..., 1]], axis=2).reshape(-1, 4)
        nearest = np.rint(places).astype(int)
        inside = ((nearest >= 0) & (nearest < region.shape)).all(axis=2)
        row, column = np.moveaxis(np.clip(nearest, 0, np.array(region.shape) - 1), 2, 0)
        shown = (inside & region[row, column])[..., None]
        pixels = resampled(image.color.astype(np.float32), region, places.reshape(-1, 2), feet)
        part = np.concatenate([pixels.reshape(height, width, 3) * shown, shown], axis=2)
        canvas[top : top + height, left : left + width] = part
    keep = canvas[..., 3] > 0
    if not keep.any():
        raise InputError("region: no patch shows any of it")
    names = ("row", "column", "height", "width")
    table = {"patches": [dict(zip(names, rectangle, strict=True)) for rectangle in rectangles.tolist()]}
    return PatchAtlas(Image(canvas, ("R", "G", "B", USABLE)), keep, table)
