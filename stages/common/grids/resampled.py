"""A picture seen at other places of it."""

import numpy as np
from jaxtyping import Float64

from texloom.stages.vocabulary.arrays import Image
from texloom.stages.vocabulary.masks import fill_excluded, valid_pixels, with_usable
from texloom.stages.vocabulary.normals import stretched

_WHOLE = 0.999  # share of a pixel from usable ones
_REACH = 2  # px beyond a border that it continues across


def resampled(image: Image, positions: Float64[np.ndarray, "h w 2"]) -> Image:
    """The image at sub-pixel positions, px; what is beyond it or excluded is black and excluded."""
    from texloom.stages.kernels.core.resample import sampled

    sides = np.array([image.height, image.width])
    shown = ((positions >= 0) & (positions <= sides - 1)).all(axis=2)
    if (valid := valid_pixels(image)) is not None:
        shown &= sampled(valid[..., None].astype(np.float32), positions)[..., 0] > _WHOLE
    pixels = sampled(fill_excluded(image).pixels, positions)
    pixels[~shown] = 0
    made = image.elsewhere(pixels)
    return made if valid is None and shown.all() else with_usable(made, shown)


def scaled_to(image: Image, sides: tuple[int, int]) -> Image:
    """The image with other sides, px, which continues across its borders where it did; normals lean with it."""
    before, around = (image.height, image.width), image.wraps
    reach = around.where_closed(_REACH)
    down, across = (after / side for after, side in zip(sides, before, strict=True))
    beyond = [np.arange(-more, side + more) % side for more, side in zip(reach, before, strict=True)]
    wider = image.elsewhere(np.ascontiguousarray(image.pixels[np.ix_(*beyond)]))
    lines = [
        np.clip((np.arange(after) + 0.5) / (after / side) - 0.5 + more, 0, side + 2 * more - 1)
        for after, side, more in zip(sides, before, reach, strict=True)
    ]
    made = resampled(wider, np.stack(np.meshgrid(*lines, indexing="ij"), axis=2))
    return made.with_pixels(stretched(made.pixels, made.channels, down, across)).wrapping(around)
