"""Excluded pixels of an exemplar: how an image marks them, and what replaces them.

Arrays called ``valid`` are true where a pixel may be used.
"""

from __future__ import annotations

import dataclasses
import functools
import logging

import numpy as np
from jaxtyping import Float32, Int32

from texloom.stages.kernels.core.loading import loaded
from texloom.stages.vocabulary.arrays import Image, Mask
from texloom.stages.vocabulary.color import lab_from_linear
from texloom.stages.vocabulary.declare import InputError

USABLE = "usable"
"""name of the channel that marks excluded pixels by values below a half"""

EXCLUSION_CHANNELS = ("A", USABLE)
"""a pixel is excluded where one of these channels is below `HALF`"""

HALF = 0.5


def valid_pixels(image: Image) -> Mask | None:
    """True where ``image`` may be used; None where no pixel is excluded.

    Raises
    ------
    InputError
        all pixels are excluded.
    """
    valid = np.ones((image.height, image.width), bool)
    for name in EXCLUSION_CHANNELS:
        if name in image.channels:
            valid &= image.pixels[..., image.channels.index(name)] >= HALF
    if not valid.any():
        raise InputError("image: its mask or alpha excludes every pixel")
    return None if valid.all() else valid


def tell_holes(log: logging.Logger, made: Image) -> None:
    """Tell that a result has holes: pixels whose alpha is below a half."""
    if "A" in made.channels:
        share = float((made.pixels[..., made.channels.index("A")] < HALF).mean())
        if share > 0:
            log.warning(
                "the result has holes: %.2g %% of its pixels are transparent, as they were kept; the flow fill "
                "fills the transparent pixels of a picture",
                100 * share,
            )


def nearest_valid(valid: Mask) -> Int32[np.ndarray, "2 h w"]:
    """Row and column of the valid pixel nearest to every pixel; at least one is valid."""
    places = np.indices(valid.shape, np.int32)
    if valid.all():
        return places
    ndimage = loaded("scipy.ndimage")
    # The nearest to any pixel is in the rectangle around all that are not valid, or beside it.
    lines = [np.flatnonzero(~valid.all(axis=axis)) for axis in (1, 0)]
    near = tuple(slice(max(0, int(line[0]) - 1), int(line[-1]) + 2) for line in lines)
    found = ndimage.distance_transform_edt(~valid[near], return_distances=False, return_indices=True)
    places[:, *near] = found + np.array([line.start for line in near])[:, None, None]
    return places


def count_excluded(valid: Mask, height: int, width: int) -> Int32[np.ndarray, "p q"]:
    """Number of pixels that are not valid in each window of ``height`` x ``width`` px, by its top-left pixel."""
    sums = np.zeros((valid.shape[0] + 1, valid.shape[1] + 1), np.int32)
    np.cumsum(np.cumsum(~valid, axis=0, dtype=np.int32), axis=1, out=sums[1:, 1:])
    down = sums[height:] - sums[:-height]
    return down[:, width:] - down[:, :-width]


def fill_excluded(image: Image) -> Image:
    """``image`` with every excluded pixel replaced by the nearest valid one.

    The values of excluded pixels thus cannot influence anything computed from the result.
    """
    valid = valid_pixels(image)
    if valid is None:
        return image
    row, column = nearest_valid(valid)
    return image.with_pixels(image.pixels[row, column])


def without_usable(image: Image) -> Image:
    """``image`` without the channel `USABLE`, which describes an exemplar and not what is made from it."""
    if USABLE not in image.channels:
        return image
    kept = [index for index, name in enumerate(image.channels) if name != USABLE]
    names = tuple(image.channels[index] for index in kept)
    return image.with_pixels(np.ascontiguousarray(image.pixels[..., kept]), names)


def with_usable(image: Image, valid: Mask) -> Image:
    """``image`` with a last channel `USABLE` that is 1 where ``valid`` and else 0, instead of its own."""
    plain = without_usable(image)
    pixels = np.concatenate([plain.pixels, valid[..., None].astype(np.float32)], axis=2)
    return plain.with_pixels(pixels, (*plain.channels, USABLE))


@dataclasses.dataclass(frozen=True)
class FilledExemplar:
    """An exemplar as stages compare and copy it, prepared once."""

    image: Image
    """without the channel `USABLE`; excluded pixels hold the values of the nearest valid one"""
    valid: Mask | None
    """as of `valid_pixels`"""

    @classmethod
    def of(cls, image: Image) -> FilledExemplar:
        """Prepare an exemplar; `InputError` where all pixels are excluded."""
        return cls(without_usable(fill_excluded(image)), valid_pixels(image))

    @functools.cached_property
    def lab(self) -> Float32[np.ndarray, "h w 3"]:
        """Its colour in CIELAB."""
        return lab_from_linear(self.image.color)
