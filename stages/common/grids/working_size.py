"""The size at which a large exemplar is analysed: its means over squares of whole pixels."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float32

from texloom.stages.common.grids.pyramid import resize
from texloom.stages.vocabulary.arrays import Image
from texloom.stages.vocabulary.masks import EXCLUSION_CHANNELS, HALF, valid_pixels
from texloom.stages.vocabulary.scratch import release

MOST_PIXELS = 3 << 19
"""pixels of an exemplar up to which it is analysed as it is"""


def reduction(height: int, width: int) -> int:
    """Side of the squares whose means are analysed, px: 1 up to `MOST_PIXELS`, about 3 for 12 million pixels."""
    step = 1
    while (height // step) * (width // step) > MOST_PIXELS:
        step += 1
    return step


def square_means(planes: Float32[np.ndarray, "h w *c"], step: int) -> Float32[np.ndarray, "p q *c"]:
    """Means over squares of ``step`` px; rows and columns that fill none are dropped."""
    from texloom.stages.kernels.core.square_means import fill_means

    height, width = (side // step for side in planes.shape[:2])
    means = np.empty((height, width, *planes.shape[2:]), np.float32)
    fill_means(planes.reshape(*planes.shape[:2], -1), step, means.reshape(height, width, -1))
    return means


def working_image(image: Image) -> tuple[Image, int]:
    """The image as it is analysed, and the side of its pixels, px of ``image``; see `reduction`.

    Excluded pixels have no influence. A square is excluded where most of its pixels are, unless all would be.

    Raises
    ------
    InputError
        all pixels are excluded.
    """
    step = reduction(image.height, image.width)
    return (image if step == 1 else image_of_means(image, step)), step


def image_of_means(image: Image, step: int) -> Image:
    """The image's means over squares of ``step`` px; see `working_image`."""
    valid = valid_pixels(image)
    if valid is None:
        return image.with_pixels(square_means(image.pixels, step)).wrapping(False)
    counted = valid.astype(np.float32)
    share = square_means(counted, step)
    pixels = square_means(image.pixels * counted[..., None], step) / np.maximum(share, np.float32(1e-6))[..., None]
    known = share >= HALF
    known = known if known.any() else share > 0
    for name in EXCLUSION_CHANNELS:
        if name in image.channels:
            pixels[..., image.channels.index(name)] = known
    return image.with_pixels(pixels).wrapping(False)


class Halvings:
    """Planes that are resampled at many sizes; large ones are halved before, as often as leaves twice the size."""

    def __init__(self, planes: Float32[np.ndarray, "h w c"]):
        self._levels = [planes]
        self._is_large = reduction(*planes.shape[:2]) > 1

    def resized(self, height: int, width: int) -> Float32[np.ndarray, "H W c"]:
        """See `resize`."""
        if self._levels[0].shape[:2] == (height, width):
            del self._levels[1:]  # the finest scale comes last
        level = 0
        while self._is_large and (np.array(self._levels[level].shape[:2]) >= (4 * height, 4 * width)).all():
            level += 1
            if level == len(self._levels):
                self._levels.append(square_means(self._levels[-1], 2))
        made = resize(self._levels[level], height, width)
        release(self._levels[0])
        return made


def in_full(plane: Float32[np.ndarray, "p q"], step: int, height: int, width: int) -> Float32[np.ndarray, "h w"]:
    """A plane of a `working_image` at full size, between the middles of its squares linearly."""
    import cv2

    if step == 1:
        return plane
    whole = cv2.resize(plane, (plane.shape[1] * step, plane.shape[0] * step), interpolation=cv2.INTER_LINEAR)
    return np.pad(whole, ((0, height - whole.shape[0]), (0, width - whole.shape[1])), "edge")
