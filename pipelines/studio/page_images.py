"""Images as the page shows them."""

from __future__ import annotations

import numpy as np

from texloom.stages.evaluation.thumbnail import ThumbnailParams, thumbnail
from texloom.stages.vocabulary.arrays import Image


def rgba(image: Image) -> bytes:
    """The pixels of an image for a canvas of the page: R G B A in sRGB, 8 bits."""
    pixels = np.full((image.height, image.width, 4), 255, np.uint8)
    pixels[..., :3] = image.srgb
    return pixels.tobytes()


def small(image: Image, side: int) -> Image:
    """The colour of an image, reduced to a longest side of ``side`` px."""
    made: Image = thumbnail(image, ThumbnailParams(side=side)).image
    return made
