"""Blocks of any shape, painted in a picture of the result's size."""

import numpy as np
from jaxtyping import Bool, Int32

from texloom.stages.kernels.core.loading import loaded
from texloom.stages.numerics.matrices import matrix_product
from texloom.stages.vocabulary.arrays import Image

Blocks = list[tuple[tuple[slice, slice], Bool[np.ndarray, "m n"]]]
"""rows and columns of each block's bounding box, and its pixels in there"""


def painted_blocks(layout: Image) -> Blocks:
    """The connected areas of one colour, in scan order of their first pixels."""
    ndimage = loaded("scipy.ndimage")
    codes = matrix_product(
        np.rint(np.clip(layout.color, 0, 1) * 65535).astype(np.int64), np.array([1, 2**16, 2**32])
    )
    numbers: Int32[np.ndarray, "h w"] = np.zeros(codes.shape, np.int32)
    count = 0
    for code in np.unique(codes):
        parts, found = ndimage.label(codes == code)
        numbers[parts > 0] = parts[parts > 0] + count
        count += found
    order = np.unique(numbers, return_index=True)[1].argsort(kind="stable")
    boxes = ndimage.find_objects(numbers)
    return [(boxes[index], numbers[boxes[index]] == index + 1) for index in order]
