"""Heights of a normal map."""

import dataclasses
import logging

import numpy as np

from texloom.stages.analysis.relief.added_maps import HEIGHT, has_map, with_map
from texloom.stages.common.grids.screened_poisson import neighbours, screened_poisson
from texloom.stages.vocabulary.arrays import Image
from texloom.stages.vocabulary.declare import InputError, stage
from texloom.stages.vocabulary.facts import DISPLACEMENT, MapFacts
from texloom.stages.vocabulary.masks import fill_excluded
from texloom.stages.vocabulary.normals import NORMAL

_LOG = logging.getLogger(__name__)

_STEEPEST = 0.1  # z of a unit normal, below which it counts as no steeper
_REACH = 100.0  # widths of the picture, over which heights return to the middle


@dataclasses.dataclass(frozen=True)
class HeightFromNormal:
    """The material with heights."""

    image: Image
    """with a channel `height` around 0.5: high is bright, and 1 is a twentieth of the picture's width, as exported
    documents assume; a map that was there is kept"""


@stage(version=1)
def height_from_normal(image: Image) -> HeightFromNormal:
    """Integrate normals to the heights whose slopes are nearest to theirs.

    Slopes between two pixels are the means of theirs. Heights beyond 0..1, those of more than a twentieth of the
    width, are scaled to it, which a note says.

    Parameters
    ----------
    image : a material with normals; excluded pixels count as the nearest others do.

    Raises
    ------
    InputError
        there are no normals, or all pixels are excluded.

    References
    ----------
    [FrankotChellappa1988]_ for the nearest integrable slopes by Fourier transforms, here with [Bhat2008]_.
    """
    if has_map(image, HEIGHT):
        return HeightFromNormal(image)
    if not set(NORMAL) <= set(image.channels):
        raise InputError(f"image: has no normals; it has {', '.join(image.channels)}")
    filled = fill_excluded(image).pixels
    x, y, z = (filled[..., image.channels.index(name)] for name in NORMAL)
    steep = np.maximum(z, np.float32(_STEEPEST))
    excess = np.zeros(x.shape, np.float32)
    for axis, slope in enumerate((y / steep, -x / steep)):
        for first, second in neighbours(image.height, axis, image.wraps):
            rise = (slope[first] + slope[second]) / 2
            excess[first] += rise
            excess[second] -= rise
    excess -= np.float32(excess.mean(dtype=np.float64))  # rounding, which would lift all
    height = screened_poisson(excess, _REACH * image.width, image.wraps) / np.float32(DISPLACEMENT * image.width)
    height -= (height.max() + height.min()) / 2
    span = float(np.ptp(height))
    if span > 1:
        _LOG.warning(
            "heights span %.2g of the width; they were scaled to %g, so that normals are %.2g times as steep",
            span * DISPLACEMENT, DISPLACEMENT, span,
        )  # fmt: skip
        height /= np.float32(span)
    height += np.float32(0.5)
    return HeightFromNormal(with_map(image, HEIGHT, np.clip(height, 0, 1)[..., None], (HEIGHT,), MapFacts()))
