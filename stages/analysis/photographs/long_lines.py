"""Long straight lines of a surface: string courses, rims of windows and doors, beams."""

import numpy as np

from texloom.stages.analysis.photographs.reduced_surface import without_rim
from texloom.stages.common.features.line_segments import Frame, line_segments
from texloom.stages.kernels.core.elementary_functions import arctan2
from texloom.stages.vocabulary.arrays import Image, Mask

_STRAIGHT = np.radians(3.0)  # of a side
_LONG = 0.15  # of the surface, by the root of its area


def long_lines(image: Image, usable: Mask) -> float:
    """Length of the straight lines of a surface that are long, in sides of a square of its area.

    A line counts if it runs along a side of the picture, is longer than a seventh of the surface, and its middle
    and what is around that is usable.

    Parameters
    ----------
    image : the surface from the front.
    usable : where it counts.

    References
    ----------
    Ours; lines by [Gioi2010]_.
    """
    frame = Frame((image.height, image.width))
    segments = line_segments(image)
    along = np.abs(segments.ends[:, 1] - segments.ends[:, 0])
    side = float(np.sqrt(np.count_nonzero(usable))) / frame.unit
    straight = arctan2(along.min(axis=1), along.max(axis=1)) < _STRAIGHT
    inner = without_rim(usable, max(1, round(max(usable.shape) / 128)))
    lengths = segments.lengths[straight & segments.within(inner) & (segments.lengths > _LONG * side)]
    return float(lengths.sum()) / side if side else 0.0
