"""Wang tiles laid out: a preview, and how much the borders between tiles show."""

import dataclasses
import logging
from typing import Any

import numpy as np
from jaxtyping import Float32, Int32
from pydantic import Field

from texloom.stages.common.features.maps import map_channels
from texloom.stages.common.grids.wang import WangSet, laid
from texloom.stages.common.similarity.neighbourhoods import Rectangles, numbers_in
from texloom.stages.vocabulary.arrays import Correspondence, Image
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
    interiors do not fit, or features of a lattice lie along it. Between several materials, one of which is rougher
    than others, `overall` is of pixels with the materials of those that it is compared with"""


@stage(version=1)
def wang_tiling(
    image: Image,
    layout: dict[str, Any],
    params: WangTilingParams,
    match: Correspondence | None = None,
    rectangles: Rectangles | None = None,
) -> WangTiling:
    """Lay Wang tiles at random, and compare the change across their borders with that anywhere.

    Borders do not show where the ratio is about 1 or less.

    Parameters
    ----------
    image, layout : the atlas and its table, see `wang_tiles`.
    match, rectangles : of several exemplars, from whose rectangles its pixels come, see `wang_tiles`.

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
    materials = np.zeros((image.height, image.width), np.int32)
    if match is not None and rectangles is not None:
        height, width = (rectangles[:, :2] + rectangles[:, 2:]).max(axis=0).tolist()
        materials = numbers_in(rectangles, height, width)[match[..., 0], match[..., 1]]
    own = laid(materials, places, size)
    table = {name: _measured(laid(plane, places, size), own, size) for name, plane in planes.items()}
    color = laid(image.color, places, size)
    if max(color.shape) > params.side:
        import cv2

        color = cv2.resize(color, (params.side, params.side), interpolation=cv2.INTER_AREA)
    return WangTiling(Image(np.ascontiguousarray(color), ("R", "G", "B")), table)


def _measured(
    plane: Float32[np.ndarray, "H W c"], materials: Int32[np.ndarray, "H W"], size: int
) -> dict[str, float]:
    """Mean differences of neighbours in both directions, at the borders of tiles and everywhere."""
    changes = [np.abs(np.diff(plane, axis=axis)).mean(axis=2) for axis in (0, 1)]
    pairs = [_pairs(materials, axis) for axis in (0, 1)]
    kinds = 1 + max(int(own.max()) for own in pairs)
    counts = sum(np.bincount(own.ravel(), minlength=kinds) for own in pairs)
    totals = sum(
        np.bincount(own.ravel(), change.ravel(), kinds) for own, change in zip(pairs, changes, strict=True)
    )
    usual = totals / np.maximum(counts, 1)
    lines = [change.mean(axis=1 - axis, dtype=np.float64) for axis, change in enumerate(changes)]
    expected = [usual[own].mean(axis=1 - axis) for axis, own in enumerate(pairs)]
    across, overall = (float(np.mean([of[size - 1 :: size].mean() for of in own])) for own in (lines, expected))
    worst = max(
        float(line[at::size].mean()) / (float(own[at::size].mean()) or 1.0)
        for line, own in zip(lines, expected, strict=True)
        for at in range(size)
    )
    return {"across": across, "overall": overall, "ratio": across / (overall or 1.0), "worst": worst}


def _pairs(materials: Int32[np.ndarray, "H W"], axis: int) -> Int32[np.ndarray, "p q"]:
    """A number for each pair of neighbours, the same for all between the same two materials."""
    ahead = np.take(materials, np.arange(1, materials.shape[axis]), axis)
    behind = np.take(materials, np.arange(materials.shape[axis] - 1), axis)
    return np.asarray(np.minimum(ahead, behind) * (materials.max() + 1) + np.maximum(ahead, behind), np.int32)
