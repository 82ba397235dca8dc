"""Small pictures for contact sheets."""

import dataclasses

import numpy as np
from pydantic import Field

from texloom.stages.vocabulary.arrays import Image
from texloom.stages.vocabulary.declare import Params, stage


class ThumbnailParams(Params):
    """Size of the picture."""

    side: int = Field(320, ge=1, le=2048)
    """longest side, px; smaller pictures stay as they are"""
    enlarge: bool = False
    """enlarge the result to the picture's own size again, which shows what is left of it"""


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
    if params.enlarge:
        color = cv2.resize(color, (image.width, image.height), interpolation=cv2.INTER_LINEAR)
    return Thumbnail(Image(color, ("R", "G", "B")))
