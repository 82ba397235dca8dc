"""Pixels of an exemplar that must not be used: how an image says so, and what stands in for them."""

from __future__ import annotations

import numpy as np
from jaxtyping import Int32

from texloom.stages.arrays import Image, Mask
from texloom.stages.declare import InputError

USABLE = "usable"
"""name of the channel that marks pixels: those below a half are never used"""

EXCLUSION_CHANNELS = ("A", USABLE)
"""a pixel is excluded where one of these channels is below a half"""

_HALF = 0.5


def usable_pixels(image: Image) -> Mask | None:
    """True where ``image`` may be used; none where all of it may.

    A pixel may be used unless its alpha ``A`` or its channel `USABLE` is below a half.

    Raises
    ------
    InputError
        no pixel may be used.
    """
    usable = np.ones((image.height, image.width), bool)
    for name in EXCLUSION_CHANNELS:
        if name in image.channels:
            usable &= image.pixels[..., image.channels.index(name)] >= _HALF
    if not usable.any():
        raise InputError("image: its mask or alpha leaves no pixel that may be used")
    return None if usable.all() else usable


def nearest(usable: Mask) -> Int32[np.ndarray, "2 h w"]:
    """Row and column of the nearest true pixel of every pixel; ``usable`` is true somewhere."""
    from scipy.ndimage import distance_transform_edt

    return np.asarray(distance_transform_edt(~usable, return_distances=False, return_indices=True), dtype=np.int32)


def masked_in(mask: Mask, height: int, width: int) -> Int32[np.ndarray, "p q"]:
    """How many pixels ``mask`` leaves out of each box of ``height`` x ``width`` px, by its top-left pixel."""
    sums = np.zeros((mask.shape[0] + 1, mask.shape[1] + 1), np.int32)
    np.cumsum(np.cumsum(~mask, axis=0, dtype=np.int32), axis=1, out=sums[1:, 1:])
    down = sums[height:] - sums[:-height]
    return down[:, width:] - down[:, :-width]


def filled(image: Image) -> Image:
    """``image`` with the values of the nearest usable pixel in place of each that is not.

    What masked pixels hold so makes no difference to anything that is computed from the result.
    """
    usable = usable_pixels(image)
    if usable is None:
        return image
    row, column = nearest(usable)
    return Image(image.pixels[row, column], image.channels)


def unmarked(image: Image) -> Image:
    """``image`` without the channel `USABLE`, which tells of an exemplar and not of what is made from it."""
    if USABLE not in image.channels:
        return image
    kept = [index for index, name in enumerate(image.channels) if name != USABLE]
    return Image(np.ascontiguousarray(image.pixels[..., kept]), tuple(image.channels[index] for index in kept))
