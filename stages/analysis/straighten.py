"""The straightened exemplar: warped so that its deformed lattice becomes regular."""

import dataclasses
from typing import Annotated

import numpy as np
from jaxtyping import Float32

from texloom.stages.analysis.deformed_lattice import Points
from texloom.stages.arrays import Channels, Image
from texloom.stages.common.free_form import fitted
from texloom.stages.declare import InputError, NoParams, stage

Positions = Annotated[Float32[np.ndarray, "h w 2"], Channels(("row", "column"))]
"""for every pixel a place in another picture, px, between pixels too"""


@dataclasses.dataclass(frozen=True)
class Straightened:
    """The exemplar with a regular lattice."""

    image: Image
    """as large as the exemplar; black where it would show what lies beyond"""
    source: Positions
    """for every pixel of ``image`` the place of the exemplar that it shows, px; some lie beyond its borders"""


@stage(version=1)
def straighten(image: Image, vertices: Points, regular: Points, params: NoParams) -> Straightened:  # noqa: ARG001
    """Warp an exemplar so that given points come to lie on a regular lattice.

    The map is a multilevel free-form deformation through the points, so smooth and one-to-one; all channels follow.

    Parameters
    ----------
    vertices : where points of the exemplar are, px, as from `deformed_lattice`.
    regular : where they shall be, px, as many.

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
    to, wanted = regular.astype(np.float64), vertices.astype(np.float64)
    sides = np.array([image.height, image.width])
    box = (np.minimum(to.min(axis=0), 0), np.maximum(to.max(axis=0), sides - 1))
    # Half the distance of neighbours on a square lattice as dense; finer splines would bend between points only.
    finest = 0.5 * float(np.sqrt(np.prod(box[1] - box[0]) / len(to)))
    warp = fitted(to, wanted, box, finest)
    places = warp(np.moveaxis(np.indices((image.height, image.width)), 0, -1).reshape(-1, 2).astype(np.float64))
    pixels = sampled(image.pixels, places)
    beyond = ((places < -0.5) | (places > sides - 0.5)).any(axis=1)
    pixels[beyond] = 0
    source = places.astype(np.float32).reshape(*sides, 2)
    return Straightened(Image(pixels.reshape(*sides, -1), image.channels), source)
