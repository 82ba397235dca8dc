"""Wang tiles laid out: a preview, and how much the borders between tiles show."""

import dataclasses
import logging
from typing import Any

import numpy as np
from jaxtyping import Float32
from pydantic import Field

from texloom.stages.common.features.maps import map_channels
from texloom.stages.common.grids.wang import WangSet, laid
from texloom.stages.vocabulary.arrays import Image
from texloom.stages.vocabulary.color import lab_from_linear
from texloom.stages.vocabulary.declare import Params, stage
from texloom.stages.vocabulary.masks import fill_excluded

_MOST = 2**14  # px along each side of what is laid out
_LOG = logging.getLogger(__name__)


class WangTilingParams(Params):
    """What is laid out."""

    cells: int = Field(16, ge=2, le=64)
    """tiles along each side of the preview; fewer where they are larger than 16384 px together"""
    seed: int = Field(0, ge=0, lt=2**16)
    """another one gives another tiling; 0 is that of the shaders"""
    side: int = Field(2048, ge=64, le=8192)
    """longest side of the preview, px; larger ones are reduced"""


@dataclasses.dataclass(frozen=True)
class WangTiling:
    """The preview and its measures."""

    image: Image
    """R G B, linear light"""
    table: dict[str, Any]
    """for `albedo` and each map, whose differences between neighbouring pixels are averaged over its channels:
    `across` borders of tiles, `overall`, and their `ratio`; CIELAB units, or those of the map. `worst` is the ratio
    of the line through tiles, parallel to a side, across which most changes: much above 1 where borders and
    interiors do not fit, or features of a lattice lie along it"""


@stage(version=1)
def wang_tiling(image: Image, layout: dict[str, Any], params: WangTilingParams) -> WangTiling:
    """Lay Wang tiles at random, and compare the change across their borders with that anywhere.

    Borders do not show where the ratio is about 1 or less.

    Parameters
    ----------
    image, layout : the atlas and its table, see `wang_tiles`.

    References
    ----------
    [Cohen2003]_. The colour of each side is a hash of its place, as in [Wei2004]_, so that any part of the plane
    can be laid out by itself.
    """
    tiles, size = WangSet.of(layout), int(layout["size"])
    along = max(2, min(params.cells, _MOST // size))
    if along < params.cells:
        _LOG.warning(
            "cells: %d tiles of %d px along a side, as %d are too large together", along, size, params.cells
        )
    cells = np.indices((along, along))
    places = tiles.covering(cells[0], cells[1], params.seed)
    planes = {"albedo": lab_from_linear(fill_excluded(image).color)}
    planes |= {name: image.pixels[..., own] for name, own in map_channels(image.channels).items()}
    table = {name: _measured(laid(plane, places, size), size) for name, plane in planes.items()}
    color = laid(image.color, places, size)
    if max(color.shape) > params.side:
        import cv2

        color = cv2.resize(color, (params.side, params.side), interpolation=cv2.INTER_AREA)
    return WangTiling(Image(np.ascontiguousarray(color), ("R", "G", "B")), table)


def _measured(plane: Float32[np.ndarray, "H W c"], size: int) -> dict[str, float]:
    """Mean differences of neighbours in both directions, at the borders of tiles and everywhere."""
    changes = [np.abs(np.diff(plane, axis=axis)).mean(axis=(1 - axis, 2), dtype=np.float64) for axis in (0, 1)]
    across = float(np.mean([change[size - 1 :: size].mean() for change in changes]))
    overall = float(np.mean([change.mean() for change in changes]))
    worst = max(float(change[line::size].mean()) for change in changes for line in range(size))
    scale = overall or 1.0
    return {"across": across, "overall": overall, "ratio": across / scale, "worst": worst / scale}
