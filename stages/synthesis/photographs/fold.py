"""Fold a flat texture back onto the surface that its exemplar was unrolled from."""

import dataclasses
from typing import Annotated

import numpy as np
from jaxtyping import Float32

from texloom.stages.vocabulary.arrays import Channels, Correspondence
from texloom.stages.vocabulary.declare import stage


@dataclasses.dataclass(frozen=True)
class Fold:
    """The way from the surface to the photograph."""

    positions: Annotated[Float32[np.ndarray, "h w 2"], Channels(("row", "column"))]
    """row and column in the photograph of the source of every pixel of the surface, in fractions of a px"""


@stage(version=1)
def fold(
    match: Correspondence,
    chart: Float32[np.ndarray, "h w 2"],
    positions: Float32[np.ndarray, "rows columns 2"],
) -> Fold:
    """Find the places of a photograph that a texture made of its unrolled surface shows on that surface.

    Parameters
    ----------
    match : source of each pixel of the flat texture in the flat exemplar.
    chart, positions : see `unroll_hole`.

    References
    ----------
    Ours.
    """
    from texloom.stages.kernels.core.resample import sampled

    last = np.array(match.shape[:2]) - 1
    nearest = np.clip(np.rint(chart).astype(np.int64), 0, last)
    row, column = np.moveaxis(nearest, 2, 0)
    flat = match[row, column].astype(np.float64) + (chart - nearest)
    return Fold(sampled(positions.astype(np.float64), flat).astype(np.float32))
