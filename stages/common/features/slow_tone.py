"""Slow tone of colours: what it consists of, and how it changes them."""

from typing import Annotated

import numpy as np
from jaxtyping import Float32

from texloom.stages.kernels.core.elementary_functions import exp, log
from texloom.stages.vocabulary.arrays import Channels, ColorField, Image
from texloom.stages.vocabulary.color import lab_from_linear, linear_from_lab
from texloom.stages.vocabulary.facts import Wraps

BLACK = np.float32(16)
"""CIELAB's lightness plus this is proportional to the cube root of light, except for the darkest colours"""

ToneField = Annotated[Float32[np.ndarray, "p q 3"], Channels(("L", "a", "b"))]
"""Changes of tone, without unit: L is the logarithm of a factor on lightness + 16, a and b are shifts of chroma as
shares of lightness + 16; 0 changes nothing. Samples are spread evenly over a picture of any size."""


def relative_tone(lab: ColorField) -> Float32[np.ndarray, "h w 3"]:
    """Logarithm of lightness + 16, and chroma as shares of that: uneven light is a sum in these planes."""
    lightness = np.maximum(lab[..., 0], 0) + BLACK
    return np.stack([log(lightness), lab[..., 1] / lightness, lab[..., 2] / lightness], axis=2)


def with_tone(image: Image, change: ToneField) -> Image:
    """``image`` with colours changed by ``change``, which is stretched over it; other maps are unchanged."""
    field = _stretched(change, (image.height, image.width), image.wraps)
    pixels = image.pixels.copy()
    colors = 1 if image.channels[0] == "Y" else 3
    pixels[..., :colors] *= exp(3 * field[..., :1])
    if colors == 3 and field[..., 1:].any():
        lab = lab_from_linear(pixels[..., :3])
        lab[..., 1:] += (lab[..., :1] + BLACK) * field[..., 1:]
        pixels[..., :3] = np.maximum(linear_from_lab(lab), 0)
    return image.with_pixels(pixels)


def _stretched(field: ToneField, shape: tuple[int, int], wrap: Wraps) -> Float32[np.ndarray, "h w 3"]:
    """``field`` at ``shape``, interpolated linearly; wrapped, or extrapolated beyond the outermost samples."""
    if field.shape[:2] == shape:
        return field
    for axis in (0, 1):
        count = field.shape[axis]
        at = (np.arange(shape[axis]) + 0.5) * count / shape[axis] - 0.5
        first = np.floor(at).astype(int) if wrap[axis] else np.clip(np.floor(at).astype(int), 0, max(count - 2, 0))
        share = (at - first).astype(np.float32).reshape([-1 if place == axis else 1 for place in range(3)])
        ends = [np.take(field, (first + step) % count, axis=axis) for step in (0, 1)]
        field = ends[0] * (1 - share) + ends[1] * share
    return field
