"""Texture in a photograph: antialiased sampling of a distorted result."""

import dataclasses

import numpy as np
from jaxtyping import Bool, Float32, Int64

from texloom.stages.arrays import Correspondence, Image
from texloom.stages.declare import InputError, stage


@dataclasses.dataclass(frozen=True)
class PlaceTexture:
    """The photograph with the texture in it."""

    image: Image
    """R G B; outside the hole the photograph's own pixels"""
    texture: Image
    """the texture over the whole rectangle of the result"""


@stage(version=1)
def place_texture(
    match: Correspondence,
    colors: Float32[np.ndarray, "levels h w 3"],
    target_jacobian: Float32[np.ndarray, "H W 4"],
    photo: Image,
    hole: Bool[np.ndarray, "H W"],
    corner: Int64[np.ndarray, "2"] | None = None,
) -> PlaceTexture:
    """Sample the exemplar for every pixel of a distorted result at the level of detail of the distortion.

    The level is that at which a texel covers a pixel's area in the exemplar, interpolated between two levels,
    so that minified texture does not alias.

    Parameters
    ----------
    match : source of each pixel of the result in the exemplar; see `per_pixel`.
    colors : the exemplar's Gaussian stack; see `gaussian_stack`.
    target_jacobian : distortion of the result with which ``match`` was synthesised.
    photo : photograph that the texture is placed in.
    hole : pixels of the result that are replaced in the photograph.
    corner : row and column of the result's first pixel in the photograph; [0, 0] if not given.

    Raises
    ------
    InputError
        the hole is empty.
    ValueError
        ``match``, ``target_jacobian`` and ``hole`` differ in size, or exceed the photograph.

    References
    ----------
    [Eisenacher2008]_ section 3.3, antialiased synthesis, and section 4.
    """
    height, width = match.shape[:2]
    top, left = (0, 0) if corner is None else (int(part) for part in corner)
    for name, sides in (("target_jacobian", target_jacobian.shape), ("hole", hole.shape)):
        if sides[:2] != (height, width):
            raise ValueError(f"{name} of shape {sides} for a result of {height}x{width} px")
    if top + height > photo.height or left + width > photo.width:
        raise ValueError(f"result of {height}x{width} px at {top}, {left} goes beyond the photograph")
    if not hole.any():
        raise InputError("hole: no pixel is marked for replacement; add hole: [polygon, ...] to the patch file")
    rows, columns = np.moveaxis(match.astype(np.int64), 2, 0)
    a, b, c, d = np.moveaxis(target_jacobian.astype(np.float64), 2, 0)
    level = np.clip(-0.5 * np.log2(np.maximum(np.abs(a * d - b * c), 1e-30)), 0, len(colors) - 1)
    lower = np.floor(level).astype(np.int64)
    share = (level - lower)[..., None].astype(np.float32)
    upper = np.minimum(lower + 1, len(colors) - 1)
    texture = (1 - share) * colors[lower, rows, columns] + share * colors[upper, rows, columns]
    image = np.array(photo.color, np.float32)
    image[top : top + height, left : left + width][hole] = texture[hole]
    names = ("R", "G", "B")
    return PlaceTexture(Image(image, names), Image(texture.astype(np.float32), names))
