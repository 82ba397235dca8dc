"""A part of a plane that is laid of the cells of a lattice, and how its values compare with the exemplar's."""

import dataclasses
from typing import Any

import numpy as np
from pydantic import Field

from texloom.stages.evaluation.endless_plane import compared
from texloom.stages.synthesis.semi_procedural.cell_tiling import CellTiling
from texloom.stages.vocabulary.arrays import Image, ScalarMap
from texloom.stages.vocabulary.declare import Params, stage


class CellPlaneParams(Params):
    """What is shown."""

    side: int = Field(2048, ge=64, le=8192)
    """sides of the preview, px of the exemplar"""


@dataclasses.dataclass(frozen=True)
class CellPlane:
    """The preview and its measures."""

    image: Image
    """R G B, linear light, as the shaders compute it"""
    table: dict[str, Any]
    """of colour: `contrast`, its standard deviation over the exemplar's, and `histogram`, the largest difference of
    their cumulative histograms, 0..1; `joints`, the contrast where cells are blended over that of the cells; and
    the number of `cells`"""


@stage(version=1)
def cell_plane(
    exemplar: Image, texture: Image, window: ScalarMap, layout: dict[str, Any], params: CellPlaneParams
) -> CellPlane:
    """Compute a part of the plane that shaders lay of the cells of a lattice.

    Parameters
    ----------
    exemplar : with the lattice.
    texture, window, layout : see `cell_texture`.

    References
    ----------
    [Guehl2020]_.
    """
    rows, columns = (one.astype(np.float32) for one in np.mgrid[: params.side, : params.side])
    color = texture.with_pixels(np.ascontiguousarray(texture.color), ("R", "G", "B"))
    pixels = CellTiling.of(color, window, layout).pixels(rows, columns)
    table = {**compared(pixels, exemplar.color), "joints": layout["joints"], "cells": layout["cells"]}
    return CellPlane(Image(pixels, ("R", "G", "B")), table)
