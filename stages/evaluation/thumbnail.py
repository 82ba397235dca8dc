"""Small pictures for contact sheets."""

import dataclasses

import numpy as np
from pydantic import Field

from texloom.stages.arrays import Image
from texloom.stages.declare import Params, stage


class ThumbnailParams(Params):
    """Size of the picture."""

    side: int = Field(320, ge=16, le=2048)
    """longest side, px; smaller pictures stay as they are"""


@dataclasses.dataclass(frozen=True)
class Thumbnail:
    """The small picture."""

    image: Image
    """R G B, linear light"""


@stage(version=1)
def thumbnail(image: Image, params: ThumbnailParams) -> Thumbnail:
    """Reduce the colour of a picture by averaging areas.

    Parameters
    ----------
    image : the picture that is reduced.
    """
    import cv2

    color = np.ascontiguousarray(image.color)
    factor = params.side / max(image.height, image.width)
    if factor < 1:
        sides = (max(1, round(image.width * factor)), max(1, round(image.height * factor)))
        color = np.asarray(cv2.resize(color, sides, interpolation=cv2.INTER_AREA), np.float32)
    return Thumbnail(Image(color, ("R", "G", "B")))
