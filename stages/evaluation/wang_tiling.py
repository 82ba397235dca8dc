"""Wang tiles laid out: a preview, and how much the borders between tiles show."""

import dataclasses
import logging
from collections.abc import Iterator
from typing import Any

import numpy as np
from jaxtyping import Float32, Int32, Int64
from pydantic import Field

from texloom.stages.common.features.maps import map_channels
from texloom.stages.common.grids.wang import WangSet, laid, tiles_of
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
    table = {name: _measured(plane, materials, places, size) for name, plane in planes.items()}
    color = laid(image.color, places, size)
    if max(color.shape) > params.side:
        import cv2

        color = cv2.resize(color, (params.side, params.side), interpolation=cv2.INTER_AREA)
    return WangTiling(Image(np.ascontiguousarray(color), ("R", "G", "B")), table)


def _measured(
    plane: Float32[np.ndarray, "H W c"],
    materials: Int32[np.ndarray, "H W"],
    places: Int64[np.ndarray, "p q 2"],
    size: int,
) -> dict[str, float]:
    """Mean differences of neighbours in both directions, at the borders of tiles and everywhere, of tiles laid out.

    Each tile, and each pair of tiles side by side, is measured once, and counted as often as it occurs.
    """
    kinds = (int(materials.max()) + 1) ** 2
    counts, totals = np.zeros(kinds, np.int64), np.zeros(kinds)
    lines = []
    for axis in (0, 1):
        order = places if axis == 0 else places.swapaxes(0, 1)[..., ::-1]
        for change, kind, times in _changes(plane.swapaxes(0, axis), materials.swapaxes(0, axis), order, size):
            lines.append((change, kind, times))
            for own, number, often in zip(change, kind, times.tolist(), strict=True):
                counts += often * np.bincount(number.ravel(), minlength=kinds)
                totals += often * np.bincount(number.ravel(), own.ravel(), kinds)
    usual = totals / np.maximum(counts, 1)
    found = [
        np.stack(
            [np.average(own.mean(axis=2, dtype=np.float64), axis=0, weights=times) for own in (change, usual[kind])]
        )
        for change, kind, times in lines
    ]  # of the lines within tiles and of that between them, down and across: their change and what is usual
    across, overall = ((found[1] + found[3]) / 2)[:, 0].tolist()
    worst = max(float(line) / (float(own) or 1.0) for each in found for line, own in each.T)
    return {"across": across, "overall": overall, "ratio": across / (overall or 1.0), "worst": worst}


def _changes(
    plane: Float32[np.ndarray, "H W c"],
    materials: Int32[np.ndarray, "H W"],
    places: Int64[np.ndarray, "p q 2"],
    size: int,
) -> Iterator[tuple[np.ndarray, np.ndarray, np.ndarray]]:
    """Change from line to line, the pair of materials, and how often they occur: of tiles, and of pairs of them."""
    kinds = int(materials.max()) + 1
    tiles, times = np.unique(places.reshape(-1, 2), axis=0, return_counts=True)
    change, kind = _between(_tiles(plane, tiles, size), _tiles(materials, tiles, size), kinds)
    yield change, kind, times
    both = np.concatenate([places[:-1], places[1:]], axis=2).reshape(-1, 4)
    pairs, times = np.unique(both, axis=0, return_counts=True)
    ends = [
        np.concatenate([_tiles(own, pairs[:, :2], size)[:, -1:], _tiles(own, pairs[:, 2:], size)[:, :1]], axis=1)
        for own in (plane, materials)
    ]
    change, kind = _between(ends[0], ends[1], kinds)
    yield change, kind, times


def _tiles(atlas: np.ndarray, places: Int64[np.ndarray, "n 2"], size: int) -> np.ndarray:
    """The tiles at these rows and columns of an atlas of tiles, one after another."""
    return np.asarray(tiles_of(atlas, size)[places[:, 0], places[:, 1]])


def _between(
    plane: Float32[np.ndarray, "n m size c"], materials: Int32[np.ndarray, "n m size"], kinds: int
) -> tuple[np.ndarray, np.ndarray]:
    """Change from each line to the next, and a number for the materials of both pixels, in either order."""
    above, below = materials[:, :-1], materials[:, 1:]
    change = np.abs(np.diff(plane, axis=1)).mean(axis=3)
    return change, np.minimum(above, below) * kinds + np.maximum(above, below)
