"""Unroll a distorted texture: the position of every pixel in the flat texture, and the flat texture itself."""

import dataclasses
from typing import Annotated

import numpy as np
from jaxtyping import Bool, Float32
from pydantic import Field

from texloom.stages.analysis.photographs.flattening import charted, photo_positions
from texloom.stages.vocabulary.arrays import Channels, Image, Jacobian
from texloom.stages.vocabulary.declare import InputError, Params, stage
from texloom.stages.vocabulary.masks import USABLE

_MARGIN = 1 / 16  # elements beyond a border pixel's middle that need no further row


class UnrollParams(Params):
    """Size of the flat texture."""

    max_side: int = Field(1024, ge=16, le=4096)
    """maximum side of the flat image, px; a larger texture is cropped to its centre"""


@dataclasses.dataclass(frozen=True)
class Unroll:
    """The flat texture and its chart."""

    image: Image
    """one element a pixel; black where the photograph does not show the texture, and the channel ``usable`` is 0"""
    chart: Annotated[Float32[np.ndarray, "h w 2"], Channels(("row", "column"))]
    """for every pixel of the photograph its sub-pixel row and column in the flat image"""


@stage(version=1)
def unroll(image: Image, jacobian: Jacobian, valid: Bool[np.ndarray, "levels h w"], params: UnrollParams) -> Unroll:
    """Unroll a distorted texture.

    Positions in the texture are the least squares solution for the Jacobians: developable surfaces are unrolled
    exactly, others with a small distortion everywhere. The distance between separate parts follows the Jacobians
    between them, which are extrapolated.

    Parameters
    ----------
    image, jacobian, valid : see `gaussian_stack`; the finest level of ``valid`` is used.

    Raises
    ------
    InputError
        no pixel of the finest level is valid, or the texture's centre is outside the photograph.

    References
    ----------
    Ours; [Eisenacher2008]_ never unrolls a texture.
    """
    from texloom.stages.kernels.core.resample import sampled

    sharp = valid[0]
    if not sharp.any():
        raise InputError("valid: no pixel of the finest level is valid")
    chart = charted(jacobian, sharp)
    low, high = (getattr(chart[sharp], name)(axis=0) for name in ("min", "max"))
    sides = np.clip(np.ceil(high - low - _MARGIN).astype(int) + 1, 1, params.max_side)
    chart -= np.rint((low + high) / 2 - (sides - 1) / 2)
    positions, shown = photo_positions(chart, jacobian, sharp, (int(sides[0]), int(sides[1])))
    pixels = sampled(image.color.astype(np.float64), positions)
    pixels = np.concatenate([pixels * shown[..., None], shown[..., None]], axis=2, dtype=np.float32)
    return Unroll(Image(pixels, ("R", "G", "B", USABLE)), chart.astype(np.float32))
