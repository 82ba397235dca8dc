"""From which of several pictures in one each pixel comes, and from where in it."""

from typing import Annotated, TypeAlias

import numpy as np
from jaxtyping import Integer, UInt32

from texloom.stages.common.similarity.neighbourhoods import Rectangles
from texloom.stages.vocabulary.arrays import Channels

Origin: TypeAlias = Annotated[UInt32[np.ndarray, "H W 3"], Channels(("texture", "row", "column"))]
"""number of the texture, and the place in it"""


def origin_of(source: Integer[np.ndarray, "2 H W"], rectangles: Rectangles) -> Origin:
    """Of pixels that come from rows and columns ``source`` of a picture with textures in ``rectangles``."""
    row, column, height, width = rectangles.T[:, :, None, None]
    within = (source[0] >= row) & (source[0] < row + height) & (source[1] >= column) & (source[1] < column + width)
    texture = within.argmax(axis=0)
    place = source - np.moveaxis(rectangles[texture, :2], 2, 0)
    return np.stack([texture, *place], axis=2).astype(np.uint32)
