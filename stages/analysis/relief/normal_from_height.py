"""Normals of a height map."""

import dataclasses

import numpy as np

from texloom.stages.analysis.relief.added_maps import Relief, has_map, heights, with_map
from texloom.stages.vocabulary.arrays import Image, ScalarMap
from texloom.stages.vocabulary.declare import Params, stage
from texloom.stages.vocabulary.facts import DISPLACEMENT, MapFacts, Wraps
from texloom.stages.vocabulary.normals import NORMAL, unit


class NormalFromHeightParams(Params):
    """How deep the heights are."""

    relief: Relief = DISPLACEMENT


@dataclasses.dataclass(frozen=True)
class NormalFromHeight:
    """The material with normals."""

    image: Image
    """with channels `normal.X`, `normal.Y`, `normal.Z`: green points up; a map that was there is kept"""


@stage(version=1)
def normal_from_height(image: Image, params: NormalFromHeightParams) -> NormalFromHeight:
    """Compute the normals of the surface that a height map describes: those of its central differences.

    Since they are differences of one map, they are integrable, and with the same ``relief`` give its heights again.

    Parameters
    ----------
    image : a material with a map ``height``; excluded pixels count as the nearest others do.

    Raises
    ------
    InputError
        there is no map ``height``, or all pixels are excluded.

    References
    ----------
    Ours.
    """
    if has_map(image, "normal"):
        return NormalFromHeight(image)
    height = heights(image, params.relief)
    down, across = (_slope(height, axis, image.wraps) for axis in (0, 1))
    vectors = unit(np.stack([-across, down, np.ones_like(down)], axis=2))
    return NormalFromHeight(with_map(image, "normal", vectors, NORMAL, MapFacts(green="up")))


def _slope(height: ScalarMap, axis: int, wraps: Wraps) -> ScalarMap:
    """Rise from pixel to pixel along an axis; at borders that do not wrap it is that of the last two."""
    if height.shape[axis] == 1:
        return np.zeros_like(height)
    sides = [(1, 1) if one == axis else (0, 0) for one in (0, 1)]
    wide = np.pad(height, sides, "wrap") if wraps[axis] else np.pad(height, sides, "reflect", reflect_type="odd")
    before, after = (np.take(wide, range(start, start + height.shape[axis]), axis) for start in (0, 2))
    return np.asarray((after - before) / 2)
