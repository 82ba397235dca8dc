"""A part of a plane that is laid by hex tiling."""

import dataclasses
from typing import Any

import numpy as np
from pydantic import Field

from texloom.stages.synthesis.endless.hex_tiling import HexTiling
from texloom.stages.vocabulary.arrays import Image
from texloom.stages.vocabulary.declare import Params, stage


class HexPlaneParams(Params):
    """What is shown."""

    side: int = Field(2048, ge=64, le=8192)
    """sides of the preview, px of the texture"""


@dataclasses.dataclass(frozen=True)
class HexPlane:
    """The preview."""

    image: Image
    """R G B, linear light, as the shaders compute it"""


@stage(version=1)
def hex_plane(texture: Image, layout: dict[str, Any], params: HexPlaneParams) -> HexPlane:
    """Compute a part of the plane that shaders of hex tiling cover.

    Parameters
    ----------
    texture, layout : see `hex_shaders`.

    References
    ----------
    [Mikkelsen2022]_.
    """
    rows, columns = (one.astype(np.float32) for one in np.mgrid[: params.side, : params.side])
    color = texture.with_pixels(np.ascontiguousarray(texture.color), ("R", "G", "B"))
    return HexPlane(Image(HexTiling.of(color, layout).pixels(rows, columns), ("R", "G", "B")))
