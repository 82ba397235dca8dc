"""What of a photograph stays as it is while a hole in it is filled."""

import dataclasses

import numpy as np
from jaxtyping import Bool, UInt32

from stages.arrays import Mask
from stages.declare import InputError, stage


@dataclasses.dataclass(frozen=True)
class KnownPixels:
    """The pixels that synthesis continues, each of which is itself."""

    fixed: Bool[np.ndarray, "H W"]
    """the region's pixels; what is neither there nor in the hole does not matter"""
    fixed_match: UInt32[np.ndarray, "H W 2"]
    """row and column of every pixel"""


@stage(version=1)
def known_pixels(region: Mask, hole: Mask) -> KnownPixels:
    """Fix the texture around a hole in a photograph, so that what fills it continues what is there.

    Parameters
    ----------
    region, hole : see `jacobian_field`.

    Raises
    ------
    InputError : there is no hole.
    ValueError : region and hole are of different photographs.

    References
    ----------
    [Eisenacher2008]_ section 4, completion.
    """
    if hole.shape != region.shape:
        raise ValueError(f"hole of shape {hole.shape} for a region of {region.shape}")
    if not hole.any():
        raise InputError('hole: nothing is to be filled; the file of patches says what, "hole": [polygon, ...]')
    places = np.moveaxis(np.indices(hole.shape, np.uint32), 0, 2)
    return KnownPixels(region & ~hole, places)
