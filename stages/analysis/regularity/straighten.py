"""Warp an exemplar so that its deformed lattice becomes regular."""

import dataclasses
from typing import Annotated

import numpy as np
from jaxtyping import Float32, Float64, Int64

from texloom.stages.analysis.regularity.deformed_lattice import Points
from texloom.stages.common.geometry.free_form_deformation import FreeForm, fitted
from texloom.stages.vocabulary.arrays import Channels, Image
from texloom.stages.vocabulary.declare import InputError, NoParams, stage

Positions = Annotated[Float32[np.ndarray, "h w 2"], Channels(("row", "column"))]
"""for every pixel a sub-pixel position in another image, px"""


@dataclasses.dataclass(frozen=True)
class Straightened:
    """The exemplar with a regular lattice."""

    image: Image
    """of the exemplar's size; black where it maps outside the exemplar"""
    source: Positions
    """for every pixel of ``image`` its position in the exemplar, px; some lie outside"""


@stage(version=1)
def straighten(image: Image, vertices: Points, regular: Points, params: NoParams) -> Straightened:  # noqa: ARG001
    """Warp an exemplar so that given points lie on a regular lattice.

    The map is a multilevel free-form deformation through the points, smooth and one-to-one. All channels are
    warped.

    Parameters
    ----------
    image : the exemplar.
    vertices : positions of points of the exemplar, px, as from `deformed_lattice`.
    regular : their target positions, px, the same number.

    Raises
    ------
    InputError
        there are fewer than three points.

    References
    ----------
    [Lin2004]_ appendix A; [Lee1996]_.
    """
    from texloom.stages.kernels.core.resample import sampled

    if len(regular) < 3:
        raise InputError(f"regular: want three points or more, got {len(regular)}")
    sides = np.array([image.height, image.width])
    warp = straightening(vertices.astype(np.float64), regular.astype(np.float64), sides)
    positions = warp(np.moveaxis(np.indices((image.height, image.width)), 0, -1).reshape(-1, 2).astype(np.float64))
    pixels = sampled(image.pixels, positions)
    outside = ((positions < -0.5) | (positions > sides - 0.5)).any(axis=1)
    pixels[outside] = 0
    source = positions.astype(np.float32).reshape(*sides, 2)
    return Straightened(image.elsewhere(pixels.reshape(*sides, -1)), source)


def straightening(
    vertices: Float64[np.ndarray, "n 2"], regular: Float64[np.ndarray, "n 2"], sides: Int64[np.ndarray, "2"]
) -> FreeForm:
    """The map from an image of these sides with a regular lattice to the one that has it at ``vertices``."""
    box = (np.minimum(regular.min(axis=0), 0), np.maximum(regular.max(axis=0), sides - 1))
    # Half the spacing of a square lattice of this density; finer splines would only bend between points.
    finest = 0.5 * float(np.sqrt(np.prod(box[1] - box[0]) / len(regular)))
    return fitted(regular, vertices, box, finest)
