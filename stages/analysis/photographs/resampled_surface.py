"""A surface seen at other places of it."""

import numpy as np
from jaxtyping import Float64

from texloom.stages.vocabulary.arrays import Image
from texloom.stages.vocabulary.masks import fill_excluded, valid_pixels, with_usable

_WHOLE = 0.999  # share of a pixel from usable ones


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
