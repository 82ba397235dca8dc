"""Structure that is painted instead of detected."""

import dataclasses

import numpy as np

from texloom.stages.common.grids.size_checks import same_size
from texloom.stages.numerics.matrices import matrix_product
from texloom.stages.vocabulary.arrays import Image, Mask
from texloom.stages.vocabulary.declare import InputError, stage
from texloom.stages.vocabulary.masks import valid_pixels

_MIDDLE_GREY = 0.2140  # linear light of sRGB's 0.5


@dataclasses.dataclass(frozen=True)
class PaintedStructure:
    """The features."""

    structure: Mask
    """true on a feature"""


@stage(version=1, check=same_size("painted", "image", "exemplar"))
def painted_structure(image: Image, detected: Mask, painted: Image | None = None) -> PaintedStructure:
    """Take painted features where there are any, else the detected ones.

    Parameters
    ----------
    image : the exemplar; its excluded pixels are no features.
    detected : true on features; see `otsu`.
    painted : of the exemplar's size; features are brighter than middle grey, and not transparent.

    Raises
    ------
    InputError
        ``painted`` has another size, or nothing is painted.

    References
    ----------
    [Kaspar2015]_ section 3.1 for what features do.
    """
    if painted is None:
        return PaintedStructure(detected)
    structure = matrix_product(painted.color, np.array([0.2126, 0.7152, 0.0722], np.float32)) >= _MIDDLE_GREY
    for shown in (valid_pixels(painted), valid_pixels(image)):
        if shown is not None:
            structure &= shown
    if not structure.any() or structure.all():
        raise InputError("painted: has no features; paint them white on black")
    return PaintedStructure(structure)
